"""Configurations of tile designs, and the problems built of them."""

import numpy as np
import pytest
from helpers.tiles import SMALL, small_case
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.products.tile_design.case import tile_problem


def test_parts_of_the_problem(alone: MPI.Comm) -> None:
    """Only requested parts are built, with the numbers of the configuration."""
    case = small_case(alone)
    config = SMALL.updated(constrained=False, beta=7.0, eta=0.4)
    plain = tile_problem(alone, case, config)
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
        alone, case, SMALL.updated(filter="helmholtz", perimeter_weight=1e-3, line_width=2.2e-3)
    )
    assert whole.perimeter is not None
    assert whole.perimeter_weight == 1e-3
    assert whole.filter.name == "helmholtz"
    same = tile_problem(alone, case, SMALL.updated(filter="helmholtz"))
    # A wider line has a higher threshold; the one for gaps stays.
    assert whole.length_scale.solid_threshold > same.length_scale.solid_threshold
    assert whole.length_scale.void_threshold == same.length_scale.void_threshold


def test_radius_of_a_small_tile(alone: MPI.Comm) -> None:
    with pytest.raises(ParameterError, match="than twice the radius"):
        tile_problem(alone, small_case(alone), SMALL.updated(filter_radius=6e-3))
