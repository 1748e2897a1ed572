"""Options of a fit."""

from __future__ import annotations

from dataclasses import dataclass

from toros_fem.base.config import Config, quantity
from toros_fem.products.fitting.robust_fit import LOSSES
from toros_fem.products.fitting.tensile_test import BRANCHES

INTERVALS = ("bootstrap", "hessian")


@dataclass(frozen=True)
class FitOptions(Config):
    """How a material is fitted to tensile tests."""

    branch: str = quantity(
        "last-loading", "branch of the load cycles that is fitted", choices=BRANCHES
    )
    up_to: float | None = quantity(None, "largest stretch that is fitted; none takes all", above=1)
    loss: str = quantity(
        "soft-l1", "loss of the residuals; the first two bound what an outlier counts",
        choices=tuple(LOSSES),
    )  # fmt: skip
    intervals: str = quantity(
        "bootstrap",
        "source of the 95 % intervals: tests drawn again, or the curvature of the loss",
        choices=INTERVALS,
    )
    draws: int = quantity(400, "draws of the bootstrap", at_least=40, at_most=100_000)
    seed: int = quantity(0, "seed of the bootstrap", at_least=0)
    points: int = quantity(
        60, "points that each curve is averaged to, even over the stretch", at_least=10,
        at_most=10_000,
    )  # fmt: skip
