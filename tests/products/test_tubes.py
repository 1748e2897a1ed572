"""Tubes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem import errors
from toros_fem.meshes import Pattern, bend, contract, cylinder, twist
from toros_fem.products.tubes import (
    BendScene,
    SectionTubeScene,
    TubeScene,
    bend_metric,
    length_metric,
    plain_planes,
    plain_tube,
    shortening_metric,
    twist_metric,
)

SHORT = {"length": 0.06, "edge_length": 3e-3}
SMALL = BendScene.of(length=0.06, edge_length=6e-3, filter_radius=9e-3, iterations=1)


@pytest.fixture(scope="module")
def prism(alone: MPI.Comm) -> Pattern:
    return cylinder(alone, 0.06, 0.02, 1.5e-3, mesh="structured")


def test_tube_case_weighs_the_plate(alone: MPI.Comm) -> None:
    """A small turn about y costs what `orientation_length` says, wherever the ring is."""
    config = TubeScene.of(**SHORT, orientation_length=0.03, tip_weight=0.5)  # type: ignore[arg-type]
    case = config.tube_case(alone, config.finest_level, lambda points: points, [])
    pattern = case.pattern
    shape: Any = case.parts[0]
    area, angle = pattern.vertex_areas, 1e-3
    plate = pattern.vertices_of("tip")
    extra = (area * (shape.weights - 1))[plate].sum() / area.sum()
    assert extra == pytest.approx(0.5)
    x, _, z = pattern.points.T
    gap = np.stack([angle * (z - 0.06), 0 * x, -angle * x], axis=1) * (z > 0.0599)[:, None]
    gap -= (shape.relative * area) @ gap / (shape.relative * area).sum()
    cost = (shape.relative * area) @ (gap**2).sum(axis=1) / (shape.weights * area).sum()
    assert np.sqrt(cost) == pytest.approx(0.03 * angle, rel=0.02)


def test_caps_are_printed_and_the_wall_is_designed(alone: MPI.Comm) -> None:
    config = TubeScene.of(**SHORT)  # type: ignore[arg-type]
    case = config.tube_case(alone, config.finest_level, lambda points: points, [])
    wall = case.pattern.panel == case.pattern.panel_index("wall")
    assert np.array_equal(np.isnan(case.passive), wall)
    assert np.all(case.passive[~wall] == 1.0)
    pattern, supports, density = plain_tube(alone, config.skin)
    assert np.array_equal(density, np.where(wall, 0.0, 1.0))
    assert np.array_equal(np.flatnonzero(supports.fixed.all(axis=1)), pattern.vertices_of("base"))


def test_cross_section_case(alone: MPI.Comm) -> None:
    config = SectionTubeScene.of(
        length=0.06, edge_length=3e-3, cross_sections=4, axial_weight=0.25, tip_weight=3.0
    )
    level = config.finest_level
    case = config.tube_case(alone, level, twist(1.0, 0.06), [twist_metric(60.0)])
    found: Any = case.parts[0]
    assert found.labels.max() == 4, "the tip is a cross-section of its own"
    wall = case.pattern.vertices_of("wall")
    assert np.array_equal(np.flatnonzero(found.labels >= 0), wall)
    assert np.allclose(case.pattern.points[found.labels == 4, 2], 0.06)
    assert found.position_weights[:, 0] == pytest.approx([0.25] * 4 + [3.0])
    assert found.position_weights[:, 2] == pytest.approx(0.25 * found.position_weights[:, 0])
    ratio = (config.objective.orientation_length / case.pattern.size) ** 2
    assert found.orientation_weights == pytest.approx(5 * 3.0 * ratio)


def test_metrics_of_exact_targets(prism: Pattern) -> None:
    """Metrics are in degrees and per cent, and zero for the assembled tube."""
    for metric, target in (
        (bend_metric(50.0), bend(np.radians(50), 0.06, neutral=0.01)),
        (twist_metric(70.0), twist(np.radians(70), 0.06)),
        (shortening_metric(12.0), contract(0.88)),
    ):
        assert metric.measure(prism, prism.points) == pytest.approx(0.0, abs=1e-6)
        assert metric.measure(prism, target(prism.points)) == pytest.approx(metric.target, rel=0.01)
    length = length_metric(0.9)
    assert (length.key, length.formatted(0.9)) == ("length_ratio", "0.9×")
    assert length.measure(prism, prism.points) == pytest.approx(1.0)
    assert length.measure(prism, contract(0.9)(prism.points)) == pytest.approx(length.target)


def test_length_is_watched(alone: MPI.Comm) -> None:
    """Once, also where it has a target."""
    config = SectionTubeScene.of(**SHORT)  # type: ignore[arg-type]
    level, deform = config.finest_level, twist(1.0, 0.06)
    case = config.tube_case(alone, level, deform, [twist_metric(60.0)])
    assert [(m.key, m.target) for m in case.metrics] == [("twist_deg", 60), ("length_ratio", None)]
    kept = config.tube_case(alone, level, deform, [length_metric(1.0)])
    assert [(m.key, m.target) for m in kept.metrics] == [("length_ratio", 1.0)]


@pytest.mark.parametrize(
    ("size", "edge", "longest"), [(0.02, 1.4e-3, 2.8e-3), (0.006, 1e-3, 1.05e-3)]
)
def test_coarse_variant_is_of_the_skin_s_own_size(size: float, edge: float, longest: float) -> None:
    """Its edges are twice as long as far as that is of use, one mesh less, and all else stays."""
    config = TubeScene.of(length=0.1, diameter=size, edge_length=edge, levels=1, seed=5)
    coarse = config.coarse()
    changed = {k for k, v in coarse.as_dict().items() if v != config.as_dict()[k]}
    assert changed == {
        "edge_length", "filter_radius", "iterations", "constrained_iterations",
        "relaxed_edge_length", "print_edge_length", "laid_width", "curve_steps",
    }  # fmt: skip
    assert coarse.skin.edge_length == pytest.approx(longest, abs=1e-5)
    assert config.updated(diameter=0.04, levels=2).coarse().design.levels == 1


def test_planes_that_are_none_of_symmetry(alone: MPI.Comm) -> None:
    assert plain_planes("hinged") == (1,)
    assert plain_planes("continuous") == (0, 1)


def test_output_that_cannot_be_written(alone: MPI.Comm, tmp_path: Path) -> None:
    """Rank 0 alone writes, yet all ranks raise."""
    (tmp_path / "taken").write_text("a file, not a folder", encoding="utf-8")
    with pytest.raises(errors.OutputError, match="taken cannot be used as the folder of a run"):
        SMALL.run_design(alone, tmp_path / "taken")


def test_a_folder_that_is_not_empty_is_refused(alone: MPI.Comm, tmp_path: Path) -> None:
    """A script that designs says so before it designs; files that are there stay as they are."""
    names = ("summary.json", "history.csv", "pattern.svg")
    for name in names:
        (tmp_path / name).write_text(f"{name} of a run before", encoding="utf-8")
    with pytest.raises(errors.OutputError, match="is not empty"):
        SMALL.run_design(alone, tmp_path)
    for name in names:
        assert (tmp_path / name).read_text(encoding="utf-8") == f"{name} of a run before"
