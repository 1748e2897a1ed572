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
    assert not plain.terms
    assert plain.length_scale is None
    assert (plain.fields.projection.beta, plain.fields.projection.eta) == (7.0, 0.4)
    assert plain.fields.filter.radius == 2e-3
    assert plain.fields.filter.name == "cone"
    assert plain.goal is case.objective
    assert plain.physics.solver.strain == 0.1
    assert plain.physics.solver.angles == pytest.approx(np.radians([0, 15, 30, 45]))
    whole = tile_problem(
        alone, case, SMALL.updated(filter="helmholtz", perimeter_weight=1e-3, line_width=2.2e-3)
    )
    (term,) = whole.terms
    assert term.price == 1e-3 / case.tile.pattern.size
    assert whole.fields.filter.name == "helmholtz"
    same = tile_problem(alone, case, SMALL.updated(filter="helmholtz"))
    # A wider line has a higher threshold; the one for gaps stays.
    assert whole.length_scale.solid_threshold > same.length_scale.solid_threshold
    assert whole.length_scale.void_threshold == same.length_scale.void_threshold


def test_radius_of_a_small_tile(alone: MPI.Comm) -> None:
    with pytest.raises(ParameterError, match="than twice the radius"):
        tile_problem(alone, small_case(alone), SMALL.updated(filter_radius=6e-3))
