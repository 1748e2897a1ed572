"""Densities start from the print of another design."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.designs import TWO_LEVELS
from helpers.scenes import shared, square
from mpi4py import MPI

from toros_fem.base.errors import PanelError
from toros_fem.base.mpi import on_first_rank
from toros_fem.design.loop.fields import CarriedDesign
from toros_fem.design.loop.levels import optimize_levels
from toros_fem.design.loop.loop import DesignResult
from toros_fem.making.printability import DEFAULT_LIMITS, PRINT, write_print_polygons
from toros_fem.products.actuators import designer

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("without_pictures")]

SMALL = TWO_LEVELS.updated(
    levels=1,
    edge_length=2.2e-3,
    filter_radius=5e-3,
    iterations=2,
    polish_iterations=0,
    corrections=0,
)


def test_a_print_of_another_size_is_the_start(
    comm: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a longer tube for another angle, and of one whose lines would be laid else."""
    begun: list[CarriedDesign] = []

    def designed(*given: Any, after: CarriedDesign, **more: Any) -> DesignResult:
        begun.append(after)
        return optimize_levels(*given, after=after, **more)

    folder = shared(comm, tmp_path)
    first = SMALL.run_design(comm, folder / "first").printed
    wall = first.pattern.panel_index("wall")
    fraction = first.regions[wall].area / first.pattern.areas[first.pattern.cells_of("wall")].sum()
    other = SMALL.updated(length=0.06, angle=60.0)
    lines = SMALL.updated(start="relaxed", print_edge_length=2.2e-3, laid_width=2.5e-3)
    monkeypatch.setattr(designer, "optimize_levels", designed)
    for scene in (other, lines):
        place = folder / scene.design.start
        found = scene.run_design(comm, place, {"start_from": folder / "first"})
        rows = found.design.history
        assert found.search.start == "print"
        assert "from the print of another design" in found.description()
        assert len(rows) == 2
        assert rows[1].change > 0
        cells, areas = begun[-1].pattern.cells_of("wall"), begun[-1].pattern.areas
        mean = np.average(begun[-1].density[cells], weights=areas[cells])
        assert mean == pytest.approx(fraction, abs=0.01)


def test_a_print_of_another_skin_is_refused(comm: MPI.Comm, tmp_path: Path) -> None:
    folder, pattern = shared(comm, tmp_path), square(n=2)
    regions = [shapely.box(0, 0, *np.ptp(pattern.flat_points, axis=0) / 2)]
    on_first_rank(
        comm, lambda: write_print_polygons(folder / PRINT, pattern, regions, DEFAULT_LIMITS)
    )
    with pytest.raises(PanelError, match="is the design of another skin"):
        SMALL.run_design(comm, folder / "run", {"start_from": folder})
