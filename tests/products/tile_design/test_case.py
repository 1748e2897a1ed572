"""Configurations of tile designs, and the problems built of them."""

from typing import Any

import numpy as np
import pytest
from helpers.tiles import CONTRAST, SMALL, small_case
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.products.tile_design.case import TileCase, TileConfig, tile_problem


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"strain": -1.5}, "strain = -1.5 must be a finite number, above -1"),
        ({"starts": 0}, "starts = 0 must be a finite number, at least 1"),
        ({"trial_iterations": 0}, "trial_iterations = 0"),
        ({"finish_iterations": 0}, "finish_iterations = 0"),
        ({"correction_iterations": 0}, "correction_iterations = 0"),
        ({"corrections": -1}, "corrections = -1"),
        ({"tolerance": 0.0}, "tolerance = 0.0 must be a finite number, above 0"),
        ({"filter": "box"}, "filter = 'box' must be one of"),
        ({"tolerence": 0.1}, "unknown parameter 'tolerence'; did you mean 'tolerance'"),
    ],
)
def test_bad_numbers(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        TileConfig().updated(**changes)


def test_parts_of_the_problem(comm: MPI.Comm) -> None:
    """Only requested parts are built, with the numbers of the configuration."""
    case = small_case(comm)
    config = SMALL.updated(constrained=False, beta=7.0, eta=0.4)
    plain = tile_problem(comm, case, config)
    assert plain.perimeter is None
    assert plain.perimeter_weight is None
    assert plain.length_scale is None
    assert (plain.projection.beta, plain.projection.eta) == (7.0, 0.4)
    assert plain.filter.radius == 2e-3
    assert plain.filter.name == "cone"
    assert plain.target is case.objective
    assert plain.solver.strain == 0.1
    assert plain.solver.angles == pytest.approx(np.radians([0, 15, 30, 45]))
    whole = tile_problem(
        comm, case, SMALL.updated(filter="helmholtz", perimeter_weight=1e-3, line_width=2.2e-3)
    )
    assert whole.perimeter is not None
    assert whole.perimeter_weight == 1e-3
    assert whole.filter.name == "helmholtz"
    assert whole.length_scale is not None
    same = tile_problem(comm, case, SMALL.updated(filter="helmholtz"))
    assert same.length_scale is not None
    # A wider line has a higher threshold; the one for gaps stays.
    assert whole.length_scale.solid_threshold > same.length_scale.solid_threshold
    assert whole.length_scale.void_threshold == same.length_scale.void_threshold


def test_case_without_a_target(comm: MPI.Comm) -> None:
    case = small_case(comm)
    other = TileCase(case.tile, case.angles, CONTRAST, case.symmetry)
    assert other.target is None
    assert tile_problem(comm, other, SMALL).target is None


def test_radius_of_a_small_tile(comm: MPI.Comm) -> None:
    with pytest.raises(ParameterError, match="than twice the radius"):
        tile_problem(comm, small_case(comm), SMALL.updated(filter_radius=6e-3))
