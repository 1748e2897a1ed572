"""Options of a fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from toros_fem.base.keys import In, Number, OneOf, Stretch, Table, key
from toros_fem.products.fitting.robust_fit import LOSSES
from toros_fem.products.fitting.tensile_test import BRANCHES

INTERVALS = ("bootstrap", "hessian")


@dataclass(frozen=True)
class FitOptions(Table):
    """How a material is fitted to tensile tests."""

    branch: Annotated[str, OneOf(BRANCHES)] = key(
        "last-loading", "branch of the load cycles that is fitted"
    )
    up_to: Stretch | None = key(None, "largest stretch that is fitted; none takes all")
    loss: Annotated[str, OneOf(tuple(LOSSES))] = key(
        "soft-l1", "loss of the residuals; the first two bound what an outlier counts"
    )
    intervals: Annotated[str, OneOf(INTERVALS)] = key(
        "bootstrap", "source of the 95 % intervals: tests drawn again, or the curvature of the loss"
    )
    draws: Annotated[int, In(at_least=40, at_most=100000)] = key(400, "draws of the bootstrap")
    seed: Number = key(0, "seed of the bootstrap")
    points: Annotated[int, In(at_least=10, at_most=10000)] = key(
        60, "points that each curve is averaged to, even over the stretch"
    )
