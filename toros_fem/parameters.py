"""Parameters as frozen dataclasses, validated on construction. SI units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem.errors import ParameterError


def require_positive(*, at_most: float = math.inf, **values: float) -> None:
    """Check that each value is a finite number in (0, at_most].

    Raises:
        ParameterError: Naming the value and the bound.
    """
    for name, value in values.items():
        if not (math.isfinite(value) and 0 < value <= at_most):
            bound = "" if math.isinf(at_most) else f" and at most {at_most:.6g}"
            raise ParameterError(f"{name} = {value} must be a finite number greater than 0{bound}.")


def require_between(low: float, high: float, **values: float) -> None:
    """Check that each value is a finite number in [low, high].

    Raises:
        ParameterError: Naming the value and the bounds.
    """
    for name, value in values.items():
        if not (math.isfinite(value) and low <= value <= high):
            bound = f"at least {low:g}" if math.isinf(high) else f"between {low:g} and {high:g}"
            raise ParameterError(f"{name} = {value} must be a finite number, {bound}.")


def require_count(least: int, **values: int) -> None:
    """Check that each value is a whole number, at least so large.

    Raises:
        ParameterError: Naming the value and the bound.
    """
    for name, value in values.items():
        if not (isinstance(value, (int, np.integer)) and value >= least):
            raise ParameterError(f"{name} = {value} must be a whole number, at least {least}.")


def require_choice(name: str, value: str, choices: Sequence[str]) -> None:
    """Check that a value is one of the given words.

    Raises:
        ParameterError: Naming the value and the choices.
    """
    if value not in choices:
        raise ParameterError(f"{name} = {value!r} must be one of {', '.join(map(repr, choices))}.")


@dataclass(frozen=True)
class Material:
    """One isotropic sheet.

    Attributes:
        young: Young's modulus in Pa at small strain.
        poisson: Poisson's ratio, 0 to 0.5: below 0 the barrier of eq. (1) would turn attractive.
        thickness: Thickness h in m; membrane stiffness goes with h, bending with h³/12.
    """

    young: float
    poisson: float
    thickness: float

    def __post_init__(self) -> None:
        require_positive(young=self.young, thickness=self.thickness)
        require_between(0.0, 0.5, poisson=self.poisson)

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


CURVATURES = ("average", "quadratic", "midedge")
SEAMS = ("continuous", "hinged")
RESTS = ("flat", "assembled")


@dataclass(frozen=True)
class Bending:
    """How a sheet resists bending, eqs. (4-6); docs/accuracy.md compares the terms.

    Attributes:
        curvature: How a triangle's curvature follows from the angles at its edges. "average" is
            the paper's; under load it converges only where neighbouring triangles pair up to
            parallelograms: with one diagonal direction, or equilateral. "quadratic" goes through
            the six vertices around, at the same cost; where they lie on a conic it is the
            average. "midedge" has one rotation more for each edge and converges on any mesh.
        seams: Whether a seam carries moments ("continuous") or is "hinged" as sewn cloth is.
        rest: In which shape there is no moment: "flat" as the panels are cut, or "assembled", as
            if moulded in the shape that the pattern is assembled to.
    """

    curvature: str = "midedge"
    seams: str = "continuous"
    rest: str = "flat"

    def __post_init__(self) -> None:
        require_choice("curvature", self.curvature, CURVATURES)
        require_choice("seams", self.seams, SEAMS)
        require_choice("rest", self.rest, RESTS)


@dataclass(frozen=True)
class Bladder:
    """A thin airtight layer of incompressible rubber that moves with the skin.

    It is neo-Hookean, in plane stress, and so thin that its own bending does not count.

    Attributes:
        young: Young's modulus in Pa at small strain; the shear modulus is a third of it.
        thickness: In m, undeformed.
    """

    young: float
    thickness: float

    def __post_init__(self) -> None:
        require_positive(young=self.young, thickness=self.thickness)

    @property
    def membrane_stiffness(self) -> float:
        """E h in N/m."""
        return self.young * self.thickness


@dataclass(frozen=True)
class Composite:
    """A fabric and what it becomes where it is reinforced, eqs. (1-3).

    The paper publishes no material constants; the defaults are ours (docs/materials.md): a
    light jersey calibrated on what the paper tells of its tube, and printed TPU 95A.

    Attributes:
        fabric: The plain fabric.
        reinforcement: Fabric and printed layer together.
        c1: Bound on a principal stretch, > 1; the stretches stay in (2 − c₁, c₁).
        c2: Bound on their sum, > 1; the sum stays in (3 − c₂, 1 + c₂).
        bending: How the sheet resists bending; None makes the skin a membrane.
        bladder: A rubber layer under both materials; None for none.
    """

    fabric: Material = Material(young=0.1e6, poisson=0.3, thickness=0.5e-3)
    reinforcement: Material = Material(young=26e6, poisson=0.3, thickness=0.5e-3)
    c1: float = 1.9
    c2: float = 2.6
    bending: Bending | None = Bending()
    bladder: Bladder | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.bladder, Bladder | None):
            raise ParameterError(f"bladder = {self.bladder!r} must be a Bladder, or None.")
        if not isinstance(self.bending, Bending | None):
            raise ParameterError(
                f"bending = {self.bending!r} must be a Bending, or None for a membrane."
            )
        for name, value in (("c1", self.c1), ("c2", self.c2)):
            if not (math.isfinite(value) and value > 1):
                raise ParameterError(
                    f"{name} = {value} must be a finite number greater than 1: it bounds "
                    + ("a principal stretch." if name == "c1" else "λ₁ + λ₂ − 1.")
                )

    @property
    def least_stiffness(self) -> float:
        """E h in N/m of the plain fabric, with the bladder if there is one."""
        bladder = 0.0 if self.bladder is None else self.bladder.membrane_stiffness
        return self.fabric.membrane_stiffness + bladder


@dataclass(frozen=True)
class NewtonOptions:
    """How hard the equilibrium solver tries.

    Attributes:
        tolerance: Residual over the applied load at which a state counts as equilibrium.
        max_steps: Newton steps for one pressure level.
        fraction_to_barrier: Largest share of the way to the stretch bounds that one step takes.
        min_increment: Smallest increment of a continuation, over the level reached, before it
            gives up.
    """

    tolerance: float = 1e-10
    max_steps: int = 240
    fraction_to_barrier: float = 0.5
    min_increment: float = 0.05

    def __post_init__(self) -> None:
        require_positive(tolerance=self.tolerance, at_most=1e-2)
        require_positive(max_steps=self.max_steps)
        require_positive(fraction_to_barrier=self.fraction_to_barrier, at_most=0.99)
        require_positive(min_increment=self.min_increment, at_most=1.0)
