"""A design whose printable lines lose the shape: it is tried otherwise, and told."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from helpers.designs import DESIGN_ALONE
from mpi4py import MPI

from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.products.actuators import designer
from toros_fem.products.actuators.designer import ANOTHER_SEED, DensityDesigner, other_ways
from toros_fem.products.tubes import BendScene

pytestmark = pytest.mark.usefixtures("without_pictures")

SCENE = BendScene.of(
    angle=45.0, length=0.06, edge_length=4.5e-3, filter_radius=7e-3, iterations=2, seed=4,
    constrained_iterations=1, polish_iterations=0, corrections=0, **DESIGN_ALONE,
)  # fmt: skip


def test_other_ways() -> None:
    """Softer constraints first, a sharper projection, then another seed; finer meshes stay."""
    stages = Stage(9), Stage(6, constrained=True)
    options = (DesignOptions(stages), DesignOptions((Stage(2, constrained=True),)))
    softer, sharper, seeded = other_ways(options, 4, 20.0)
    assert [name for name, _, _ in (softer, sharper, seeded)] == [
        "softer constraints", "a sharper projection first", "another seed",
    ]  # fmt: skip
    assert softer[1][0].stages == (stages[0], replace(stages[1], iterations=12, tighten=0.5**0.5))
    assert sharper[1][0].stages == (stages[0], Stage(2, beta=40.0), stages[1])
    assert seeded[1:] == (options, 4 + ANOTHER_SEED)
    assert all(rules[1] == options[1] for _, rules, _ in (softer, sharper, seeded))
    assert list(other_ways((DesignOptions((Stage(9),)),), 4, 20.0)) == []


@pytest.mark.parametrize(("kept_by", "tried"), [(2, 2), (9, 3)])
def test_a_lost_design_is_tried_otherwise(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept_by: int, tried: int
) -> None:
    """Until a way keeps the shape; the best of all is taken, and told with what was tried."""
    worsts, seen = iter([4.0, 3.0, 2.0, 5.0]), list[Any]()

    def worst(_: DensityDesigner, printed: Any) -> float:
        if not any(one is printed for one, _ in known):
            known.append((printed, next(worsts, 9.0)))
        return next(value for one, value in known if one is printed)

    def lost(self: DensityDesigner, result: Any, printed: Any) -> bool:
        self.worst(printed)
        seen.append(result)
        return len(seen) <= kept_by

    known = list[tuple[Any, float]]()
    monkeypatch.setattr(DensityDesigner, "worst", worst)
    monkeypatch.setattr(DensityDesigner, "lost", lost)
    found = SCENE.updated(island_area=2e-3).run_design(alone, tmp_path)  # none is bridged
    assert len(found.search.tried) == tried
    assert found.design.history == seen[2].history, "the third was the best"
    assert found.summary()["tried"] == list(found.search.tried)
    assert any("tried: softer constraints" in text for text in found.binding)


def test_a_design_that_keeps_its_shape_is_made_once(alone: MPI.Comm, tmp_path: Path) -> None:
    found = SCENE.run_design(alone, tmp_path)
    assert found.search.tried == ()
    assert "tried" not in found.summary()


@pytest.mark.parametrize(
    ("worsts", "areas", "taken"),
    [((3.0, 2.0), [20e-6, math.inf], 1), ((2.0, 3.0), [20e-6, math.inf], 0), ((0.9,), [20e-6], 0)],
)
def test_bridged_islands_are_left_out_where_that_is_better(
    alone: MPI.Comm,
    monkeypatch: pytest.MonkeyPatch,
    worsts: tuple[float, ...],
    areas: list[float],
    taken: int,
) -> None:
    """A print that misses with bridges is made without them too."""
    asked, prints = list[float](), list[Any]()

    def as_printed(*_: Any, island_area: float, **__: Any) -> Any:
        asked.append(island_area)
        prints.append(SimpleNamespace(cleaned=SimpleNamespace(bridged=("one",)), number=len(asked)))
        return prints[-1]

    monkeypatch.setattr(designer, "as_printed", as_printed)
    monkeypatch.setattr(designer, "problem_of", lambda result: None)
    monkeypatch.setattr(DensityDesigner, "trimmed", lambda _, printed: printed)
    monkeypatch.setattr(DensityDesigner, "worst", lambda _, one: worsts[one.number - 1])
    scene = SCENE.updated(island_area=20e-6)
    reporter: Any = None
    begun = DensityDesigner(comm=alone, scene=scene, reporter=reporter)
    result: Any = None
    assert begun.print_of(result) is prints[taken]
    assert asked == areas
