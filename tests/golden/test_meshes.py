"""Geometry of patterns, surfaces and targets, and fields on them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.scenes import DATA
from helpers.surfaces import sphere
from mpi4py import MPI

from toros_fem import meshes as m
from toros_fem.design.density.filters import make_filter
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.loop.fields import random_density
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.sheets import disc, rectangle
from toros_fem.meshes.transfer import make_transfer, refine

pytestmark = pytest.mark.usefixtures("kept_meshes")
GEOMETRY = 1e-9


def figures_of(pattern: Pattern) -> dict[str, Any]:
    """Quantities of a pattern."""
    return {
        "panels": list(pattern.panel_names),
        "flat corners in m": pattern.flat_points,
        "places in m": pattern.points,
        "triangles": pattern.triangles,
        "sewn": pattern.sewn,
        "area by panel in m2": [
            float(pattern.areas[pattern.panel == k].sum()) for k in range(len(pattern.panel_names))
        ],
    }


PATTERNS: dict[str, Callable[[MPI.Comm], Pattern]] = {
    "tube": lambda comm: m.cylinder(comm, 0.06, 0.02, 5e-3),
    "half structured tube": lambda comm: m.cylinder(
        comm, 0.06, 0.02, 5e-3, mesh="structured", planes=(1,)
    ),
    "quarter crossed tube": lambda comm: m.cylinder(
        comm, 0.06, 0.02, 5e-3, mesh="crossed", caps="base", planes=(0, 1)
    ),
    "mirrored tube": lambda comm: (
        m.mirrored(m.cylinder(comm, 0.06, 0.02, 5e-3, planes=(0, 1)), (0, 1)).pattern
    ),
    "sheet": lambda comm: rectangle(comm, 0.06, 0.04, 8e-3, "equilateral"),
    "disc": lambda comm: disc(comm, 0.02, 5e-3),
    "walker": lambda comm: m.walker(comm, 8e-3),
    "gripper": lambda comm: m.gripper(comm, 8e-3),
    "finger": lambda comm: m.finger(comm, 6e-3, planes=(1,)),
    "tile": lambda comm: m.tile(comm, 0.01, 2e-3, "unstructured", "tetragonal").pattern,
    "refined tube": lambda comm: refine(m.cylinder(comm, 0.06, 0.02, 8e-3)).pattern,
}


@pytest.mark.parametrize("name", list(PATTERNS))
def test_pattern(comm: MPI.Comm, name: str, pinned: Callable[..., None]) -> None:
    pinned(f"patterns/{name}", figures_of(PATTERNS[name](comm)), rel=GEOMETRY)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bracket", "sphere"])
def test_unwrapped(comm: MPI.Comm, name: str, pinned: Callable[..., None]) -> None:
    """Flat panels are found by iterations to 1e-9 or so of their size."""
    surface = (
        sphere(2, 0.04) if name == "sphere" else m.read_surface(comm, DATA / "bracket.stl", 1e-3)
    )
    found = m.unwrap(comm, surface)
    figures = figures_of(found.pattern) | {"stretch": found.distortion.worst_stretch}
    pinned(f"patterns/unwrapped_{name}", figures, rel=1e-6, small=1e-9)


def test_targets(comm: MPI.Comm, pinned: Callable[..., None]) -> None:
    points = m.cylinder(comm, 0.06, 0.02, 5e-3, mesh="structured").points
    along = np.array([[1.0, 0.0]])
    targets = {
        "bend": m.bend(1.2, 0.06, neutral=0.01),
        "twist": m.twist(2.0, 0.06),
        "contract": m.contract(0.9),
        "both": m.compose(m.twist(2.0, 0.06), m.contract(0.9)),
        "stand": m.stand(0.8, 0.01, directions=along, root=0.004),
        "curl": m.curl(1.0, 0.02, origin=(0, 0, 0.01), along=(0, 0, 1), toward=(1, 0, 0)),
    }
    pinned("targets", {name: of(points) for name, of in targets.items()}, rel=GEOMETRY)


def test_fields(comm: MPI.Comm, pinned: Callable[..., None]) -> None:
    """Random fields by seed, filters with both passes, the perimeter, transfer between meshes."""
    pattern = m.cylinder(comm, 0.06, 0.02, 4.5e-3)
    skin = m.sew(comm, pattern)
    density = random_density(skin, 7)
    found = {"seed 7": skin.gather_cells(density)}
    found["seed 8"] = skin.gather_cells(random_density(skin, 8))
    for name in ("cone", "helmholtz"):
        smooth = make_filter(name, skin, 9e-3)
        found[f"{name} forward"] = skin.gather_cells(smooth.forward(density))
        found[f"{name} backward"] = skin.gather_cells(smooth.backward(density))
    border = Perimeter(skin, 9e-3)
    figures: dict[str, Any] = {"perimeter in m": border.forward(density)}
    figures["slope of the perimeter"] = skin.gather_cells(border.backward(density))
    finer = m.cylinder(comm, 0.06, 0.02, 3e-3, mesh="structured")
    transfer = make_transfer(pattern, finer)
    figures["on a finer mesh"] = transfer.at_cells(found["seed 7"])
    figures["places on a finer mesh"] = transfer.positions(pattern.points * [1.1, 1.2, 0.9])
    figures["laplacian"] = pattern.flat_laplacian().data
    pinned("fields", found | figures, rel=GEOMETRY)
