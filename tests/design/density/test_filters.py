"""Both density filters alike: uniform densities, choice by name."""

import numpy as np
import pytest
from helpers.warned import warned

from toros_fem import errors
from toros_fem.design.density.filters import make_filter
from toros_fem.design.density.helmholtz import HelmholtzFilter
from toros_fem.meshes import Skin


@pytest.mark.parametrize("name", ["cone", "helmholtz"])
def test_a_uniform_density_stays(name: str, tube: Skin) -> None:
    flat = make_filter(name, tube, 8e-3)
    ones = np.ones(len(tube.owned_cells))
    assert flat.forward(ones) == pytest.approx(ones, rel=1e-11)
    assert flat.slope(ones) == pytest.approx(np.zeros((2, len(ones))), abs=1e-8)
    assert flat.at_points(ones) == pytest.approx(np.ones(len(tube.pattern.flat_points)), rel=1e-11)


def test_filters_by_name(tube: Skin) -> None:
    assert make_filter("cone", tube, 8e-3).name == "cone"
    with pytest.raises(errors.ParameterError, match="filter = 'gauss'"):
        make_filter("gauss", tube, 8e-3)
    with pytest.raises(errors.ParameterError, match="radius = 0"):
        make_filter("helmholtz", tube, 0.0)
    with warned(tube.comm, match="under 1.5 edge lengths"):
        HelmholtzFilter(tube, 3e-3)
