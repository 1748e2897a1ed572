"""Materials as frozen dataclasses, validated on construction. SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    is_number,
    require_between,
    require_choice,
    require_kind,
    require_positive,
    shown,
)

# Modulus in Pa beyond that of any solid.
STIFFEST = 1e13


def _store_floats(record: object, *names: str) -> None:
    """Turn fields of a frozen dataclass into floats: forms take no integers."""
    for name in names:
        object.__setattr__(record, name, float(getattr(record, name)))


def _require_bound(owner: str, name: str, value: Any) -> None:
    """Check a stretch bound c₁ or c₂ of eq. (1).

    Raises:
        ParameterError: It is not above 1.
    """
    if not (is_number(value) and math.isfinite(value) and value > 1):
        raise ParameterError(
            f"{owner}{name} = {shown(value)} must be a finite number greater than 1: it bounds "
            + ("a principal stretch." if name == "c1" else "λ₁ + λ₂ − 1.")
        )


@dataclass(frozen=True)
class Material:
    """Isotropic sheet.

    Attributes:
        young: Young's modulus in Pa at small strain.
        poisson: Poisson's ratio, 0 to 0.5: below 0 the barrier of eq. (1) would turn attractive.
        thickness: Thickness h in m; membrane stiffness goes with h, bending with h³/12.
        c1, c2: Its own stretch bounds of eq. (1), > 1; None takes those of the `Composite`.

    Raises:
        ParameterError: A value is no number, or out of its bounds.
    """

    young: float
    poisson: float
    thickness: float
    c1: float | None = None
    c2: float | None = None

    def __post_init__(self) -> None:
        for name in ("c1", "c2"):
            if getattr(self, name) is not None:
                _require_bound("Material.", name, getattr(self, name))
                _store_floats(self, name)
        require_positive(**{"Material.young": self.young}, at_most=STIFFEST)
        require_positive(**{"Material.thickness": self.thickness})
        require_between(0.0, 0.5, **{"Material.poisson": self.poisson})
        _store_floats(self, "young", "poisson", "thickness")

    @classmethod
    def from_lame(cls, mu: float, lam: float, thickness: float) -> Material:
        """Return the sheet of given Lamé parameters of plane stress, those of eq. (1).

        ν = λ/(λ + 2μ) and E = 2μ(1 + ν). λ is not that of the solid material: from λ₃ in three
        dimensions follows λ = 2μλ₃/(λ₃ + 2μ); μ is the same.

        Args:
            mu: μ in Pa.
            lam: λ in Pa, 0 to 2μ, which is Poisson's ratio 0 to 0.5.
            thickness: h in m.

        Raises:
            ParameterError: A value is out of its bounds.
        """
        require_positive(mu=mu)
        require_between(0.0, 2 * mu, lam=lam)
        poisson = lam / (lam + 2 * mu)
        return cls(2 * mu * (1 + poisson), poisson, thickness)

    @property
    def mu(self) -> float:
        """Plane-stress Lamé parameter μ = E/(2(1+ν)) in Pa."""
        return self.young / (2 * (1 + self.poisson))

    @property
    def lam(self) -> float:
        """Plane-stress Lamé parameter λ = Eν/(1−ν²) in Pa."""
        return self.young * self.poisson / (1 - self.poisson**2)

    @property
    def membrane_stiffness(self) -> float:
        """E h in N/m."""
        return self.young * self.thickness

    def course_stiffness(self, ratio: float) -> float:
        """Return the stiffness k in N/m of courses that give the moduli along and across a ratio.

        A sheet of modulus E, Poisson's ratio ν and thickness h with fibres m E h has the moduli
        (1 + m) E along them and E / (1 − ν² m/(1 + m)) across; their ratio is 1 + m (1 − ν²).

        Args:
            ratio: Modulus along the courses over that along the wales, as of `Knit`.
        """
        return (ratio - 1) / (1 - self.poisson**2) * self.membrane_stiffness


CURVATURES = ("average", "quadratic", "midedge")
SEAMS = ("continuous", "hinged")
RESTS = ("flat", "assembled")


@dataclass(frozen=True)
class Bending:
    """Bending resistance of a sheet, eqs. (4-6); docs/accuracy.md compares the terms.

    Attributes:
        curvature: Formula for a triangle's curvature from the angles at its edges. "average" is
            the paper's; under load it converges only where neighbouring triangles pair up to
            parallelograms: with one diagonal direction, or equilateral. "quadratic" goes through
            the six vertices around, at the same cost; where they lie on a conic it is the
            average. "midedge" has one rotation more for each edge and converges on any mesh.
        seams: Whether a seam carries moments ("continuous") or is "hinged" as sewn cloth is.
        rest: Shape without moments: "flat" as the panels are cut, or "assembled", as if moulded
            in the shape to which the pattern is assembled.

    Raises:
        ParameterError: A word is not one of the choices.
    """

    curvature: str = "midedge"
    seams: str = "continuous"
    rest: str = "flat"

    def __post_init__(self) -> None:
        require_choice("curvature", self.curvature, CURVATURES)
        require_choice("seams", self.seams, SEAMS)
        require_choice("rest", self.rest, RESTS)


PRINT_SIDES = ("outside", "inside")
WRINKLINGS = ("tension-field",)


@dataclass(frozen=True)
class Membrane:
    """Stretching of a sheet: whether it takes compression, eq. (1), or wrinkles.

    Attributes:
        wrinkling: "tension-field" lets the sheet wrinkle finely without resistance, so that it
            carries no compression (Pipkin 1986); None takes eq. (1) as it stands, and wrinkles
            are those that the mesh resolves.
        residual_stiffness: Fraction of the stiffness that a tension field keeps against
            compression, 1e-9 to 1e-2. Without any, the equilibrium of a slack sheet is not
            unique; docs/materials.md has its effect on results.

    Raises:
        ParameterError: The wrinkling is not one of the choices, or the fraction is out of bounds.
    """

    wrinkling: str | None = None
    residual_stiffness: float = 1e-5

    def __post_init__(self) -> None:
        if self.wrinkling is not None:
            require_choice("wrinkling", self.wrinkling, WRINKLINGS)
        require_between(1e-9, 1e-2, residual_stiffness=self.residual_stiffness)
        _store_floats(self, "residual_stiffness")

    @property
    def relaxed(self) -> bool:
        """Whether the sheet carries no compression."""
        return self.wrinkling is not None


@dataclass(frozen=True)
class Bladder:
    """Thin airtight layer of incompressible rubber that moves with the skin.

    It is neo-Hookean, in plane stress, and so thin that its own bending is neglected.

    Attributes:
        young: Young's modulus in Pa at small strain; the shear modulus is a third of it.
        thickness: In m, undeformed.
    """

    young: float
    thickness: float

    def __post_init__(self) -> None:
        require_positive(**{"Bladder.young": self.young, "Bladder.thickness": self.thickness})
        _store_floats(self, "young", "thickness")

    @property
    def membrane_stiffness(self) -> float:
        """E h in N/m."""
        return self.young * self.thickness


@dataclass(frozen=True)
class Knit:
    """Courses of a knitted fabric, along which it is stiffer than along its wales.

    The plain fabric gets the energy ½ k (λ − 1)² per flat area, λ the stretch along the courses,
    with k chosen so that the moduli of uniaxial tension at small strain have the given ratio. The
    fabric's own modulus then is nearly that of the wales (`Composite.moduli` has both). The
    reinforcement stays isotropic, and between both k is linear in ρ̄, as in eqs. (2, 3).

    Attributes:
        ratio: Modulus along the course over modulus along the wale, at least 1.
        grain: Angle in rad of the courses from the first axis of a panel's flat chart; one for all
            panels, or one for each panel by its name. On a part of a skin that symmetry planes
            complete, the other parts have the mirrored grain.

    Raises:
        ParameterError: The ratio is below 1, or an angle is not finite.
    """

    ratio: float
    grain: float | Mapping[str, float] = 0.0

    def __post_init__(self) -> None:
        require_between(1.0, math.inf, ratio=self.ratio)
        angles = self.grain if isinstance(self.grain, Mapping) else {"all panels": self.grain}
        for name, angle in angles.items():
            if not (is_number(angle) and math.isfinite(angle)):
                raise ParameterError(
                    f"grain of {name} = {shown(angle)} must be a finite angle in rad."
                )
        _store_floats(self, "ratio")
        if isinstance(self.grain, Mapping):
            by_name = {name: float(angle) for name, angle in self.grain.items()}
            object.__setattr__(self, "grain", by_name)
        else:
            _store_floats(self, "grain")


@dataclass(frozen=True)
class Composite:
    """Fabric, and fabric with reinforcement, eqs. (1-3).

    The paper publishes no material constants; the defaults are ours (docs/materials.md): a
    light jersey calibrated by the paper's statements about its tube, and printed TPU 95A.

    Attributes:
        fabric: The plain fabric.
        reinforcement: Fabric and printed layer together.
        c1: Bound on a principal stretch, > 1; the stretches stay in (2 − c₁, c₁). It is that of
            both materials, but of one that has its own.
        c2: Bound on their sum, > 1; the sum stays in (3 − c₂, 1 + c₂). As c₁.
        bending: Bending resistance; None makes the skin a membrane.
        bladder: A rubber layer under both materials; None for none.
        knit: Courses of the fabric; None for an isotropic fabric.
        membrane: Whether the sheet takes compression or wrinkles.
        print_side: Face of the fabric that carries the print. "outside" is the one from which the
            panels' triangles are counter-clockwise, away from the pressure in a closed skin;
            "inside" is the other. None takes the print in the middle of the fabric, so that strain
            and curvature are not coupled.
        print_offset: Distance in m from the middle of the fabric to that of the reinforcement;
            None takes (h_fabric + h_reinforcement)/2, a layer on the face. It acts with a
            `print_side` only.

    Raises:
        ParameterError: A bound is not above 1; membrane, bending, bladder or knit has another
            type; a sheet that wrinkles has a bladder or a knit, which take compression, or c₂ below
            c₁; or a print has a side on a sheet that wrinkles or does not bend.
    """

    fabric: Material = Material(young=0.1e6, poisson=0.3, thickness=0.5e-3)
    reinforcement: Material = Material(young=26e6, poisson=0.3, thickness=0.5e-3)
    c1: float = 1.9
    c2: float = 2.6
    bending: Bending | None = Bending()
    bladder: Bladder | None = None
    knit: Knit | None = None
    membrane: Membrane = Membrane()
    print_side: str | None = None
    print_offset: float | None = None

    def __post_init__(self) -> None:
        for name in ("fabric", "reinforcement"):
            what = "a Material, by Material(young, poisson, thickness)"
            require_kind(name, getattr(self, name), Material, what)
        require_kind("membrane", self.membrane, Membrane, "a Membrane")
        if self.membrane.relaxed and (self.bladder is not None or self.knit is not None):
            raise ParameterError(
                f"wrinkling = {self.membrane.wrinkling!r}: a bladder and a knit take compression "
                "and have no relaxed energy here. Use None for both, or wrinkling = None."
            )
        nothing = type(None)
        require_kind("knit", self.knit, (Knit, nothing), "a Knit, or None")
        require_kind("bladder", self.bladder, (Bladder, nothing), "a Bladder, or None")
        require_kind(
            "bending", self.bending, (Bending, nothing), "a Bending, or None for a membrane"
        )
        for name, value in (("c1", self.c1), ("c2", self.c2)):
            _require_bound("", name, value)
        _store_floats(self, "c1", "c2")
        for c1, c2 in (self.fabric_bounds, self.reinforcement_bounds):
            if self.membrane.relaxed and c2 < c1:
                raise ParameterError(
                    f"c2 = {c2} must be at least c1 = {c1} for wrinkling = "
                    f"{self.membrane.wrinkling!r}: a narrow bound on the sum would hold the width."
                )
        self._check_side()

    def _check_side(self) -> None:
        """Check side and offset of the print."""
        if self.print_offset is not None:
            require_positive(print_offset=self.print_offset)
            _store_floats(self, "print_offset")
        if self.print_side is None:
            return
        require_choice("print_side", self.print_side, PRINT_SIDES)
        if self.bending is None:
            raise ParameterError(
                f"print_side = {self.print_side!r}, but bending = None: a print on one face acts "
                "by bending the sheet. Give a Bending, or print_side = None."
            )
        if self.membrane.relaxed:
            raise ParameterError(
                f"print_side = {self.print_side!r} with wrinkling = {self.membrane.wrinkling!r}: a "
                "tension field has no strain across its wrinkles that a print could bend by. Use "
                "None for one of them."
            )

    @property
    def fabric_bounds(self) -> tuple[float, float]:
        """c₁ and c₂ of the plain fabric."""
        return self._bounds_of(self.fabric)

    @property
    def reinforcement_bounds(self) -> tuple[float, float]:
        """c₁ and c₂ of the reinforced fabric."""
        return self._bounds_of(self.reinforcement)

    def _bounds_of(self, material: Material) -> tuple[float, float]:
        return (
            self.c1 if material.c1 is None else material.c1,
            self.c2 if material.c2 is None else material.c2,
        )

    @property
    def widest_bounds(self) -> tuple[float, float]:
        """The larger c₁ and the larger c₂ of the two materials: outside, no mixture exists."""
        pairs = zip(self.fabric_bounds, self.reinforcement_bounds, strict=True)
        c1, c2 = (max(pair) for pair in pairs)
        return c1, c2

    @property
    def shares_bounds(self) -> bool:
        """Whether both materials have the same stretch bounds."""
        return self.fabric_bounds == self.reinforcement_bounds

    @property
    def mixes_linearly(self) -> bool:
        """Whether the energy is linear in ρ̄: bounds are shared, and no tension field is relaxed."""
        return self.shares_bounds and not self.membrane.relaxed

    @property
    def stated_bounds(self) -> str:
        """The stretch bounds as text, for messages."""
        fabric, printed = (
            f"c1 = {c1:g}, c2 = {c2:g}"
            for c1, c2 in (self.fabric_bounds, self.reinforcement_bounds)
        )
        return fabric if self.shares_bounds else f"{fabric} of the fabric, {printed} of the print"

    @property
    def eccentricity(self) -> float:
        """Offset in m of the reinforcement along the skin's outward normal; 0 without a side."""
        if self.print_side is None:
            return 0.0
        offset = self.print_offset
        if offset is None:
            offset = (self.fabric.thickness + self.reinforcement.thickness) / 2
        return offset if self.print_side == "outside" else -offset

    def require_refinable(self) -> None:
        """Check that the rest shape is known between the vertices of a mesh.

        Raises:
            ParameterError: The sheet is moulded in its assembled shape.
        """
        if self.bending is not None and self.bending.rest == "assembled":
            raise ParameterError(
                "rest = 'assembled': between its vertices the moulded shape is not known. Make the "
                "finer pattern yourself and compare."
            )

    @property
    def course_stiffness(self) -> float:
        """Stiffness k in N/m that courses add to the plain fabric; 0 for an isotropic one."""
        if self.knit is None:
            return 0.0
        return self.fabric.course_stiffness(self.knit.ratio)

    @property
    def moduli(self) -> tuple[float, float]:
        """Moduli of the plain fabric in Pa at small strain, along its courses and its wales."""
        along = self.fabric.young + self.course_stiffness / self.fabric.thickness
        return along, along / (1.0 if self.knit is None else self.knit.ratio)

    @property
    def least_stiffness(self) -> float:
        """E h in N/m of the plain fabric, with the bladder if there is one."""
        bladder = 0.0 if self.bladder is None else self.bladder.membrane_stiffness
        return self.fabric.membrane_stiffness + bladder
