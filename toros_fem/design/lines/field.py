"""What lines are to be laid: families by share and direction in each triangle, and settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    checked_floats,
    require_between,
    require_kind,
    require_positive,
)
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


@dataclass(frozen=True)
class LineOptions:
    """What lines to lay.

    The spacing of lines is their width over their share. It follows the mean of the share over
    the distance `even`; the local width takes up the rest. The more even the spacing, the fewer
    lines begin and end.

    Attributes:
        widths: Width of the lines in m: one for all families, or one for each.
        print_width: Least width of a line, and of a gap between two, in m.
        least_share: Where a family has less than this share it has no lines.
        even: Distance in m over which spacings and directions are averaged; None for the mean
            over one triangle only.
        hole_area: Area in m² of the smallest hole that stays open, and of the smallest piece.
        spread: Largest local width over the width asked, at least 1; so is the width asked over
            the smallest local one, which is never under `print_width`.
        spacings: Mean distance in m from line to line of each family, whose width then follows from
            its share in place of `widths`; None for one whose spacing follows. Empty: for all.

    Raises:
        ParameterError: A value is out of its bounds.
    """

    widths: Sequence[float] = (0.9e-3,)
    print_width: float = 0.6e-3
    least_share: float = 0.03
    even: float | None = 10e-3
    hole_area: float = 0.5e-6
    spread: float = 1.5
    spacings: Sequence[float | None] = ()

    def __post_init__(self) -> None:
        what = "a list of widths in m, one for all families or one for each"
        widths = checked_floats("widths", self.widths, what, lambda s: len(s) == 1 and s[0] > 0)
        object.__setattr__(self, "widths", tuple(float(width) for width in widths))
        require_positive(print_width=self.print_width, hole_area=self.hole_area)
        require_positive(least_share=self.least_share, at_most=1.0)
        require_between(1, 10, spread=self.spread)
        if self.even is not None:
            require_positive(even=self.even)
        for number, distance in enumerate(self.spacings):
            if distance is not None:
                require_positive(**{f"spacings[{number}]": distance})
        for number, width in enumerate(self.widths):
            require_positive(**{f"widths[{number}]": width})
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
