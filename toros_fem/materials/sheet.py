"""Materials as tables that check themselves, and sheets with a printed layer. SI units."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, replace
from typing import Annotated, Any

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import In, Length, Modulus, OneOf, Poisson, Stretch, Table, key
from toros_fem.base.validation import is_number, require_between, require_positive, shown

# Modulus in Pa beyond that of any solid.
STIFFEST = 1e13
CURVATURES = ("average", "midedge")
SEAMS = ("continuous", "hinged")
RESTS = ("flat", "assembled")
PRINT_SIDES = ("outside", "inside")
WRINKLINGS = ("tension-field",)


class Material(Table):
    """Isotropic sheet.

    Membrane stiffness goes with the thickness h, bending with h³/12. Below a Poisson's ratio of 0
    the barrier of eq. (1) would turn attractive.
    """

    young: Annotated[float, In("Pa", above=0, at_most=STIFFEST)] = key(
        MISSING, "Young's modulus at small strain"
    )
    poisson: Poisson = key(MISSING, "Poisson's ratio")
    thickness: Length = key(MISSING, "thickness h")
    c1: Stretch | None = key(
        None, "its own bound on a principal stretch, eq. (1); none takes that of the `Composite`"
    )
    c2: Stretch | None = key(
        None, "its own bound on λ₁ + λ₂ − 1, eq. (1); none takes that of the `Composite`"
    )

    @classmethod
    def from_lame(cls, mu: float, lam: float, thickness: float) -> Material:
        """Return the sheet of given Lamé parameters of plane stress, in Pa, and h in m, eq. (1).

        ν = λ/(λ + 2μ) and E = 2μ(1 + ν). λ is not that of the solid material: from λ₃ in three
        dimensions follows λ = 2μλ₃/(λ₃ + 2μ); μ is the same. λ from 0 to 2μ is ν from 0 to 0.5.
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
        """
        return (ratio - 1) / (1 - self.poisson**2) * self.membrane_stiffness


class Bending(Table):
    """Bending resistance of a sheet, eqs. (4-6); docs/accuracy.md compares the terms.

    The curvature "average" is the paper's; under load it converges only where neighbouring
    triangles pair up to parallelograms: with one diagonal direction, or equilateral. "midedge" has
    one rotation more for each edge and converges on any mesh.
    """

    curvature: Annotated[str, OneOf(CURVATURES)] = key(
        "midedge", "formula for a triangle's curvature from the angles at its edges"
    )
    seams: Annotated[str, OneOf(SEAMS)] = key(
        "continuous", "whether a seam carries moments or is hinged, as sewn cloth is"
    )
    rest: Annotated[str, OneOf(RESTS)] = key(
        "flat",
        "shape without moments: as the panels are cut, or as if moulded in the shape to which the "
        "pattern is assembled",
    )


class Membrane(Table):
    """Stretching of a sheet: whether it takes compression, eq. (1), or wrinkles.

    A tension field lets the sheet wrinkle finely without resistance, so that it carries no
    compression (Pipkin 1986). Without any residual stiffness the equilibrium of a slack sheet is
    not unique (docs/materials.md).
    """

    wrinkling: Annotated[str, OneOf(WRINKLINGS)] | None = key(
        None,
        "how the sheet wrinkles; none takes eq. (1) as it stands, and wrinkles are those that the "
        "mesh resolves",
    )
    residual_stiffness: Annotated[float, In(at_least=1e-9, at_most=1e-2)] = key(
        1e-5, "fraction of the stiffness that a tension field keeps against compression"
    )

    @property
    def relaxed(self) -> bool:
        """Whether the sheet carries no compression."""
        return self.wrinkling is not None


class Bladder(Table):
    """Thin airtight layer of incompressible rubber that moves with the skin.

    It is in plane stress, and so thin that its own bending is neglected. It is neo-Hookean, or with
    further constants of Yeoh's law: ψ = E/6 (I₁ − 3) + C₂₀ (I₁ − 3)² + C₃₀ (I₁ − 3)³ per volume.
    """

    young: Modulus = key(
        MISSING, "Young's modulus at small strain; the shear modulus is a third of it"
    )
    thickness: Length = key(MISSING, "thickness, undeformed")
    second: Annotated[float, In("Pa")] | None = key(
        None, "constant C₂₀ of Yeoh's law, by which the rubber softens or stiffens; none for none"
    )
    third: Annotated[float, In("Pa", at_least=0)] | None = key(
        None, "constant C₃₀ of Yeoh's law, by which it stiffens at large strain; none for none"
    )

    @property
    def membrane_stiffness(self) -> float:
        """E h in N/m."""
        return self.young * self.thickness


class Threads(Table):
    """Threads of a fabric in one direction, beside the isotropic sheet.

    Their energy per flat area is ½ k (λ − 1)², λ the stretch along them, or where they stiffen over
    a strain s, ½ k s² (exp(((λ − 1)/s)²) − 1): at the strain s they bear e times as much.
    """

    stiffness: Annotated[float, In("N/m", at_least=0)] = key(
        MISSING, "stiffness k at small strain, per width"
    )
    strain: Annotated[float, In(above=0, at_most=100)] | None = key(
        None, "strain s over which they stiffen; none: they do not"
    )


@dataclass(frozen=True)
class Knit:
    """Threads of a fabric along and across its courses, and a shear stiffness of its own.

    They act beside the plain fabric, which is isotropic. The reinforcement stays isotropic, and
    between both their stiffness is linear in ρ̄, as in eqs. (2, 3). A ratio alone stands for courses
    that do not stiffen, with k chosen so that the moduli of uniaxial tension at small strain have
    this ratio; the fabric's own modulus then is nearly that of the wales (`Composite.moduli` has
    both).

    Attributes:
        ratio: Modulus along the course over modulus along the wale, at least 1; 1 where `course`
            says their stiffness.
        grain: Angle in rad of the courses from the first axis of a panel's flat chart; one for all
            panels, or one for each panel by its name. On a part of a skin that symmetry planes
            complete, the other parts have the mirrored grain.
        course, wale: Threads along the courses and along the wales; None for none.
        shear: Stiffness k in N/m of ½ k γ² per flat area, γ = d · C n, d along the courses and n
            along the wales: at small strain the change of their angle. None for none.

    Raises:
        ParameterError: The ratio is below 1, or given beside a `course`; the shear stiffness is
            negative; or an angle is not finite.
    """

    ratio: float = 1.0
    grain: float | Mapping[str, float] = 0.0
    course: Threads | None = None
    wale: Threads | None = None
    shear: float | None = None

    def __post_init__(self) -> None:
        require_between(1.0, math.inf, ratio=self.ratio)
        if self.course is not None and self.ratio != 1:
            raise ParameterError(
                f"ratio = {self.ratio:g} and course = {self.course} both say how stiff the courses "
                "are; leave one out."
            )
        if self.shear is not None:
            require_between(0.0, math.inf, shear=self.shear)
        object.__setattr__(self, "ratio", float(self.ratio))
        if isinstance(self.grain, Mapping):
            grain: Any = {name: _angle(name, angle) for name, angle in self.grain.items()}
        else:
            grain = _angle("all panels", self.grain)
        object.__setattr__(self, "grain", grain)


def _angle(name: str, grain: Any) -> float:
    if not (is_number(grain) and math.isfinite(grain)):
        raise ParameterError(f"grain of {name} = {shown(grain)} must be a finite angle in rad.")
    return float(grain)


class Composite(Table):
    """Fabric, and fabric with reinforcement, eqs. (1-3).

    The paper publishes no material constants; the defaults are ours (docs/materials.md): a
    light jersey calibrated by the paper's statements about its tube, and printed TPU 95A. The
    stretches stay in (2 − c₁, c₁), their sum in (3 − c₂, 1 + c₂).

    Raises:
        ParameterError: A value is out of its bounds; a sheet that wrinkles has a bladder or a knit,
            which take compression, or c₂ below c₁; or a print has a side on a sheet that wrinkles
            or does not bend.
    """

    fabric: Material = key(Material(0.1e6, 0.3, 0.5e-3), "the plain fabric")
    reinforcement: Material = key(Material(70e6, 0.3, 0.4e-3), "fabric and printed layer together")
    c1: Stretch = key(1.9, "bound on a principal stretch of a material that has none of its own")
    c2: Stretch = key(2.6, "bound on λ₁ + λ₂ − 1 of a material that has none of its own")
    bending: Bending | None = key(Bending(), "bending resistance; none makes the skin a membrane")
    bladder: Bladder | None = key(None, "rubber layer under both materials; none leaves it out")
    knit: Knit | None = key(None, "courses of the fabric; none for an isotropic fabric")
    membrane: Membrane = key(Membrane(), "whether the sheet takes compression or wrinkles")
    print_side: Annotated[str, OneOf(PRINT_SIDES)] | None = key(
        None,
        'face of the fabric that carries the print; "outside" is the one from which the panels\' '
        "triangles are counter-clockwise, away from the pressure in a closed skin; none takes the "
        "print in the middle of the fabric, so that strain and curvature are not coupled",
    )
    print_offset: Length | None = key(
        None,
        "distance from the middle of the fabric to that of a reinforcement with a print_side; none "
        "takes (h_fabric + h_reinforcement)/2, a layer on the face",
    )

    def __post_init__(self) -> None:
        for refused, why in self._conflicts():
            if refused:
                raise ParameterError(why)

    def _conflicts(self) -> Iterator[tuple[bool, str]]:
        """Yield what does not go together: whether it is so, and the message."""
        wrinkling = f"wrinkling = {self.membrane.wrinkling!r}"
        relaxed, sided = self.membrane.relaxed, self.print_side is not None
        yield (
            relaxed and (self.bladder is not None or self.knit is not None),
            f"{wrinkling}: a bladder and a knit take compression and have no relaxed energy here. "
            "Use None for both, or wrinkling = None.",
        )
        for c1, c2 in (self.fabric_bounds, self.reinforcement_bounds):
            yield (
                relaxed and c2 < c1,
                f"c2 = {c2} must be at least c1 = {c1} for {wrinkling}: a narrow bound on the sum "
                "would hold the width.",
            )
        yield (
            sided and self.bending is None,
            f"print_side = {self.print_side!r}, but bending = None: a print on one face acts by "
            "bending the sheet. Give a Bending, or print_side = None.",
        )
        yield (
            sided and relaxed,
            f"print_side = {self.print_side!r} with {wrinkling}: a tension field has no strain "
            "across its wrinkles that a print could bend by. Use None for one of them.",
        )

    @property
    def fabric_bounds(self) -> tuple[float, float]:
        """c₁ and c₂ of the plain fabric."""
        return self.fabric.c1 or self.c1, self.fabric.c2 or self.c2

    @property
    def reinforcement_bounds(self) -> tuple[float, float]:
        """c₁ and c₂ of the reinforced fabric."""
        return self.reinforcement.c1 or self.c1, self.reinforcement.c2 or self.c2

    @property
    def widest_bounds(self) -> tuple[float, float]:
        """The larger c₁ and the larger c₂ of the two materials: outside, no mixture exists."""
        c1, c2 = map(max, self.fabric_bounds, self.reinforcement_bounds)
        return c1, c2

    @property
    def shares_bounds(self) -> bool:
        """Whether both materials have the same stretch bounds."""
        return self.fabric_bounds == self.reinforcement_bounds

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
        on_face = (self.fabric.thickness + self.reinforcement.thickness) / 2
        offset = self.print_offset or on_face
        return offset if self.print_side == "outside" else -offset

    def require_refinable(self) -> None:
        """Check that the sheet is not moulded, so that its rest shape is known between vertices."""
        if self.bending is not None and self.bending.rest == "assembled":
            raise ParameterError(
                "rest = 'assembled': between its vertices the moulded shape is not known. Make the "
                "finer pattern yourself and compare."
            )

    @property
    def threads(self) -> tuple[Threads | None, Threads | None]:
        """Threads along the courses and along the wales of the plain fabric; None for none."""
        if self.knit is None:
            return None, None
        course = self.knit.course
        if course is None and self.knit.ratio > 1:
            course = Threads(self.fabric.course_stiffness(self.knit.ratio))
        return course, self.knit.wale

    @property
    def moduli(self) -> tuple[float, float]:
        """Moduli of the plain fabric in Pa at small strain, along its courses and its wales."""
        fabric, (course, wale) = self.fabric, self.threads
        plane = fabric.membrane_stiffness / (1 - fabric.poisson**2)
        along, across = (
            plane + (0.0 if threads is None else threads.stiffness) for threads in (course, wale)
        )
        free = along - (fabric.poisson * plane) ** 2 / across
        return free / fabric.thickness, free * across / along / fabric.thickness

    @property
    def least_stiffness(self) -> float:
        """E h in N/m of the plain fabric, with the bladder if there is one."""
        bladder = 0.0 if self.bladder is None else self.bladder.membrane_stiffness
        return self.fabric.membrane_stiffness + bladder


def reinforced(fabric: Material, layer: Material) -> Material:
    """Return one sheet that stretches and bends as a fabric with a layer bonded to it.

    Lamé parameters times thickness add, those of plane stress. The thickness is the one with
    which the sheet is as stiff in bending as the laminate about its neutral plane: h = √(12 D/A)
    with A = Σ Aᵢ, Aᵢ = Eᵢ hᵢ/(1−νᵢ²) and D = Σ Aᵢ hᵢ²/12 + A₁A₂/A · (h₁ + h₂)²/4, the layers
    lying on each other. With equal Poisson's ratios this is classical laminate theory, exactly;
    otherwise Poisson's ratio in bending is that in stretching. Each bound on the stretches is the
    tighter one of both. `layer` is the printed layer alone.
    """
    first, second = _stiffnesses(fabric, layer)
    both = first + second
    bending = (
        first * fabric.thickness**2 / 12
        + second * layer.thickness**2 / 12
        + first * second / both * (fabric.thickness + layer.thickness) ** 2 / 4
    )
    thickness = math.sqrt(12 * bending / both)
    mu, lam = (
        sum(getattr(m, name) * m.thickness for m in (fabric, layer)) / thickness
        for name in ("mu", "lam")
    )
    sheet = Material.from_lame(mu, min(lam, 2 * mu), thickness)
    return replace(sheet, c1=_tighter(fabric.c1, layer.c1), c2=_tighter(fabric.c2, layer.c2))


def print_offset(fabric: Material, layer: Material) -> float:
    """Return the distance in m from the fabric's middle to the neutral plane of `reinforced`.

    It is A₂/(A₁ + A₂) · (h₁ + h₂)/2, the `print_offset` of a `Composite` whose print has a side.
    """
    first, second = _stiffnesses(fabric, layer)
    return second / (first + second) * (fabric.thickness + layer.thickness) / 2


def _stiffnesses(*layers: Material) -> tuple[float, ...]:
    """Return A = E h/(1−ν²) in N/m of each layer."""
    return tuple(m.young * m.thickness / (1 - m.poisson**2) for m in layers)


def _tighter(*bounds: float | None) -> float | None:
    """Return the smallest of the bounds that there are."""
    return min((bound for bound in bounds if bound is not None), default=None)
