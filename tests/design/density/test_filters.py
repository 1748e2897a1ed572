"""Both density filters alike: adjoints, distributed results, choice by name."""

import numpy as np
import pytest
from helpers.warned import warned
from mpi4py import MPI

from toros_fem import errors
from toros_fem.design.density.filters import make_filter
from toros_fem.design.density.helmholtz import HelmholtzFilter
from toros_fem.meshes import Skin, sew


@pytest.mark.parametrize("name", ["cone", "helmholtz"])
def test_forward_and_backward_are_adjoint(name: str, tube: Skin, comm: MPI.Comm) -> None:
    flat = make_filter(name, tube, 8e-3)
    rng = np.random.default_rng(1)
    a, b, p, q = (rng.random(len(tube.pattern.panel))[tube.owned_cells] for _ in range(4))
    inner = lambda x, y: comm.allreduce(float(np.vdot(x, y)))  # noqa: E731
    assert inner(flat.forward(a), b) == pytest.approx(inner(a, flat.backward(b)), rel=1e-12)
    slopes = np.array([p, q])
    there, back = inner(flat.slope(a), slopes), inner(a, flat.slope_backward(slopes))
    assert there == pytest.approx(back, rel=1e-12)
    ones = np.ones(len(tube.owned_cells))
    assert flat.forward(ones) == pytest.approx(ones, rel=1e-11)
    assert flat.slope(ones) == pytest.approx(np.zeros((2, len(ones))), abs=1e-8)
    assert flat.at_points(ones) == pytest.approx(np.ones(len(tube.pattern.flat_points)), rel=1e-11)


@pytest.mark.parametrize("name", ["cone", "helmholtz"])
def test_filter_does_not_depend_on_ranks(name: str, tube: Skin) -> None:
    alone = sew(MPI.COMM_SELF, tube.pattern)
    density = np.random.default_rng(0).random(len(tube.pattern.panel))
    results = []
    for skin in (tube, alone):
        flat, mine = make_filter(name, skin, 8e-3), density[skin.owned_cells]
        slope = skin.gather_cells(flat.slope(mine).T)
        results.append((skin.gather_cells(flat.forward(mine)), slope, flat.at_points(mine)))
    for one, other in zip(*results, strict=True):
        assert one == pytest.approx(other, rel=1e-10, abs=1e-10)


def test_filters_by_name(tube: Skin) -> None:
    assert make_filter("cone", tube, 8e-3).name == "cone"
    with pytest.raises(errors.ParameterError, match="filter = 'gauss'"):
        make_filter("gauss", tube, 8e-3)
    with pytest.raises(errors.ParameterError, match="radius = 0"):
        make_filter("helmholtz", tube, 0.0)
    with warned(tube.comm, match="under 1.5 edge lengths"):
        HelmholtzFilter(tube, 3e-3)
