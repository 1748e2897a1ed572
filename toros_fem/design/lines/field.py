"""What lines are to be laid: families by share and direction in each triangle, and settings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Area, Fraction, In, Length, Table, key
from toros_fem.base.validation import checked_floats, require_kind
from toros_fem.meshes.pattern import Pattern


@dataclass(frozen=True, eq=False)
class LineField:
    """Families of fine parallel lines on a pattern, by triangle; the same on all ranks.

    Attributes:
        pattern: The pattern, with t triangles.
        shares: Part of the area that each of K families covers, shape (t, K), at least 0.
        angles: Direction of each family in rad, from the first axis of the triangle's panel
            chart, counter-clockwise, modulo π, shape (t, K).

    Raises:
        ParameterError: A shape is wrong, a value is not finite, or a share is negative.
    """

    pattern: Pattern
    shares: Floats
    angles: Floats

    def __post_init__(self) -> None:
        require_kind("pattern", self.pattern, Pattern, "a Pattern")
        count = len(self.pattern.panel)
        places = f"({count}, K), a value for each triangle and each of K ≥ 1 families"
        what = f"finite and of shape {places}"

        def fits(shape: tuple[int, ...]) -> bool:
            return len(shape) == 2 and shape[0] == count and shape[1] > 0

        for name in ("shares", "angles"):
            array = checked_floats(name, getattr(self, name), what, fits).copy()
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if self.shares.shape != self.angles.shape or self.shares.min() < 0:
            raise ParameterError(
                f"shares has {self.shares.shape[1]} families, of {self.shares.min():g} at least, "
                f"and angles {self.angles.shape[1]}; the numbers must be the same, and shares at "
                "least 0."
            )

    @property
    def families(self) -> int:
        """Number K of families."""
        return int(self.shares.shape[1])


Spread = Annotated[float, In(at_least=1, at_most=10)]


class LineOptions(Table):
    """What lines to lay.

    The spacing of lines is their width over their share. It follows the mean of the share over
    the distance `even`; the local width takes up the rest. The more even the spacing, the fewer
    lines begin and end.

    Raises:
        ParameterError: A value is out of its bounds.
    """

    widths: tuple[Length, ...] = key(
        (0.9e-3,), "width of the lines: one for all families, or one for each"
    )
    print_width: Length = key(0.6e-3, "least width of a line, and of a gap between two")
    least_share: Fraction = key(0.03, "where a family has less than this share it has no lines")
    even: Length | None = key(
        10e-3,
        "distance over which spacings and directions are averaged; none takes one triangle only",
    )
    hole_area: Area = key(0.5e-6, "area of the smallest hole that stays open, and of a piece")
    spread: Spread = key(
        1.5,
        "largest local width over the width asked, and that over the smallest local one, which is "
        "never under print_width",
    )
    spacings: tuple[Length | None, ...] = key(
        (),
        "mean distance from line to line of each family, whose width then follows from its share; "
        "none for one whose spacing follows, none at all for all",
    )

    def __post_init__(self) -> None:
        if not self.widths:
            raise self.described()["widths"].refusal((), "must hold at least one width")
        for number, width in enumerate(self.widths):
            if width < self.print_width:
                raise ParameterError(
                    f"widths[{number}] = {width} m is under print_width = {self.print_width} m, "
                    "the least that can be printed. Ask for wider lines."
                )

    def width_of(self, family: int, families: int, share: float | None = None) -> float:
        """Return the width in m that is asked of a family.

        Args:
            share: Its mean share, from which the width of lines at a given spacing follows; None
                takes that of `widths`.

        Raises:
            ParameterError: There is neither one width for all nor one for each family, or the
                number of spacings is another one.
        """
        if len(self.spacings) not in (0, families):
            raise ParameterError(
                f"spacings holds {len(self.spacings)} distances for {families} families; it must "
                "hold one for each, or none."
            )
        spacing = self.spacings[family] if self.spacings else None
        if spacing is not None and share is not None:
            return max(share * spacing, self.print_width)
        if len(self.widths) not in (1, families):
            raise ParameterError(
                f"widths holds {len(self.widths)} widths for {families} families; it must hold "
                "one for all, or one for each."
            )
        return self.widths[family if len(self.widths) > 1 else 0]
