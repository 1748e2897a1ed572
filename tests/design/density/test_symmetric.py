"""Filter of symmetric designs."""

import numpy as np
import pytest
from helpers.tiles import SIDE, random_cells, solver_of, tile_of

from toros_fem.design.density.filters import cone_filter, group_mean, helmholtz_filter
from toros_fem.meshes import SYMMETRIES

EDGES = 6


RADIUS = 1.6 * SIDE / EDGES


@pytest.mark.parametrize("symmetry", SYMMETRIES)
@pytest.mark.parametrize("kind", ["cone", "helmholtz"])
def test_symmetric_filter(symmetry: str, kind: str) -> None:
    """ρ̃ is symmetric for any density; a symmetric density is only filtered."""
    found = tile_of(EDGES)
    skin = solver_of(found).skin
    inner = (cone_filter(skin, RADIUS, found.lattice) if kind == "cone"
             else helmholtz_filter(skin, RADIUS))  # fmt: skip
    symmetry_maps = found.symmetry_maps(symmetry)
    group = group_mean(skin, symmetry_maps)
    symmetric = inner.after(group)
    assert (symmetric.name, symmetric.radius) == (kind, RADIUS)
    density = random_cells(found)[skin.owned_cells]
    filtered = skin.gather_cells(symmetric.forward(density))
    for image in symmetry_maps:
        assert filtered[image] == pytest.approx(filtered, abs=1e-13)
    assert np.ptp(filtered) > 0.03
    mean = group.forward(density)
    assert group.forward(mean) == pytest.approx(mean, abs=1e-15)
    assert symmetric.forward(mean) == pytest.approx(inner.forward(mean), abs=1e-14)
    plain = skin.gather_cells(inner.forward(density))
    assert (np.abs(plain[symmetry_maps[-1]] - plain).max() > 0.01) == (symmetry != "none")
    # The slope of a symmetric field rotates with it.
    slope = skin.gather_cells(symmetric.slope.forward(density).T)
    for operation, image in zip(SYMMETRIES[symmetry], symmetry_maps, strict=True):
        assert slope[image] == pytest.approx(slope @ operation.T, abs=1e-12 * np.abs(slope).max())
    at_points = symmetric.at_points(density)
    assert at_points == pytest.approx(inner.at_points(mean), abs=1e-14)
