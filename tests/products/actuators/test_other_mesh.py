"""A print begins from its shape on coarser meshes."""

from types import SimpleNamespace
from typing import Any

import pytest
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.products.actuators import estimates
from toros_fem.products.actuators.estimates import (
    COARSER_MESHES,
    SimulatedPrint,
    coarser_levels,
    near_on_coarser,
)


def levels_tried(
    monkeypatch: pytest.MonkeyPatch, meshes: int, without: tuple[int, ...] = ()
) -> tuple[list[tuple[int, Any]], Any]:
    """The levels in the order in which they are simulated, each with its start; and the result.

    Level 0 is the print's own, and each next one is coarser. The shape on one is its number.
    """
    tried: list[tuple[int, Any]] = []

    def coarser(level: int) -> tuple[float, int]:
        if level == meshes:
            raise ParameterError("there is no coarser mesh.")
        return 1.5, level + 1

    def simulated(_: Any, level: int, again: SimulatedPrint, ratio: float) -> Any:
        tried.append((level, again.near))
        assert ratio == pytest.approx(1.5**level)
        if level in without:
            raise NoEquilibriumError("none")
        skin = SimpleNamespace(pattern=level, gather_vertices=lambda positions: positions)
        problem = SimpleNamespace(skin=skin)
        return SimpleNamespace(problem=problem, equilibrium=SimpleNamespace(positions="shape"))

    monkeypatch.setattr(estimates, "simulated_on", simulated)
    job: Any = SimpleNamespace(scene=SimpleNamespace(coarser=coarser), comm=MPI.COMM_SELF)
    level: Any = 0
    near: Any = ("given", "far")
    return tried, near_on_coarser(job, level, SimulatedPrint(near, None, None))


def test_the_coarsest_mesh_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    tried, found = levels_tried(monkeypatch, meshes=9)
    assert COARSER_MESHES == 2
    assert tried == [(2, ("given", "far")), (1, (2, "shape"))]
    assert found == (1, "shape")


def test_a_mesh_without_equilibrium_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    tried, found = levels_tried(monkeypatch, meshes=9, without=(2,))
    assert tried == [(2, ("given", "far")), (1, ("given", "far"))]
    assert found == (1, "shape")


def test_ratios_of_edge_lengths_multiply() -> None:
    scene: Any = SimpleNamespace(coarser=lambda level: (2.0, level + 1))
    level: Any = 0
    found: dict[float, Any] = {**coarser_levels(scene, level)}
    assert found == {2.0: 1, 4.0: 2}


@pytest.mark.parametrize("meshes", [0, 1])
def test_a_skin_may_have_fewer_meshes(monkeypatch: pytest.MonkeyPatch, meshes: int) -> None:
    tried, found = levels_tried(monkeypatch, meshes)
    assert tried == [(1, ("given", "far"))][:meshes]
    assert found == ((1, "shape") if meshes else ("given", "far"))
