"""Intervals of a print from coarser meshes, of which some may have no equilibrium."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.mechanics.readings.error_estimate import LimitShape
from toros_fem.meshes import Pattern
from toros_fem.products.actuators import estimates
from toros_fem.products.actuators.estimates import MetricErrors, metric_errors


def found(
    monkeypatch: pytest.MonkeyPatch, meshes: int = 9, without: tuple[int, ...] = ()
) -> MetricErrors:
    """The errors of a mean, which each coarser mesh, a number, tells as 10 less than the last."""

    def coarser(level: int) -> tuple[float, int]:
        if level == meshes:
            raise ParameterError("there is no coarser mesh.")
        return 2.0, level + 1

    def simulated(_: Any, level: int, *__: Any) -> int:
        if level in without:
            raise NoEquilibriumError(f"none on mesh {level}.")
        return level

    monkeypatch.setattr(estimates, "simulated_on", simulated)
    monkeypatch.setattr(estimates, "_told", lambda level: {"x_mm": 100.0 - 10 * level})
    pattern = square(n=2)
    at = np.full_like(pattern.points, 0.1)
    job: Any = SimpleNamespace(scene=SimpleNamespace(coarser=coarser), comm=MPI.COMM_SELF)

    def mean(_: Pattern, positions: np.ndarray) -> float:
        return 1e3 * float(positions[:, 0].mean())

    level: Any = 0
    return metric_errors(job, level, LimitShape(pattern, at, at), {"x_mm": mean}, None, None)


def test_all_coarser_meshes_count(monkeypatch: pytest.MonkeyPatch) -> None:
    both = found(monkeypatch)
    assert both.coarser == {2.0: {"x_mm": 90.0}, 4.0: {"x_mm": 80.0}}
    assert both.failure is None
    near, far = found(monkeypatch, without=(2,)), found(monkeypatch, without=(1,))
    assert (list(near.coarser), list(far.coarser)) == ([2.0], [4.0])
    assert near.intervals["x_mm"] > both.intervals["x_mm"], "a single mesh counts as of order 1"
    rest = near.intervals["x_mm"] - 1.25 * 10 / (2 - 1)
    assert far.intervals["x_mm"] == pytest.approx(rest + 1.25 * 20 / (4 - 1))
    assert both.intervals["x_mm"] == pytest.approx(rest + 1.25 * 10 / (2**1.5 - 1))


def test_without_any_coarser_mesh_the_reason_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    none = found(monkeypatch, without=(1, 2))
    assert none.failure == "none on mesh 1."
    assert not none.intervals
    assert not none.coarser
    assert found(monkeypatch, meshes=0).failure == "there is no coarser mesh."
