"""History of a solve: a row for each step."""

from __future__ import annotations

from dataclasses import dataclass

from toros_fem.mechanics.equilibrium.continuation import Attempt


@dataclass(frozen=True)
class NewtonStep:
    """One row of a solve's history.

    Attributes:
        pressure: Largest pressure of the level, in Pa.
        residual: Norm of the first variation over the applied load before the step.
        energy: Energy in J before the step.
        shift: Regularisation added to the tangent, over its material part; 0 for pure Newton.
        step: Fraction of the step that was taken; 0 where it was refused, and in the row that ends
            a level.
        kind: "newton" with factors of this state, "cg" with older factors, "modified" with older
            tangent and factors, "coupled" with the derivative of friction by normal forces,
            "escape" from a saddle, "end".
        iterations: Number of Krylov iterations, those that were not enough included.
        seconds: Wall time of the step on this rank.
    """

    pressure: float
    residual: float
    energy: float
    shift: float
    step: float
    kind: str
    iterations: int
    seconds: float

    def __str__(self) -> str:
        kind = f"cg {self.iterations}" if self.kind == "cg" else self.kind
        return (
            f"{self.pressure:10.4g} Pa  {kind:8s}  residual {self.residual:8.2e}  "
            f"energy {self.energy:+.9e} J  shift {self.shift:7.1e}  step {self.step:7.1e}  "
            f"{self.seconds:6.3f} s"
        )


@dataclass(frozen=True, eq=False)
class NewtonResult(Attempt):
    """Result of one solve.

    Attributes:
        history: One row for each step, and the row that ends the solve.
        definite: Whether no shift was needed and no saddle was met on the way.
    """

    history: tuple[NewtonStep, ...]
    definite: bool
