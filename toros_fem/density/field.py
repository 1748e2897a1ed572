"""Densities as owned arrays: a check, and reproducible random densities."""

from __future__ import annotations

from typing import Any

import numpy as np

from toros_fem._mpi import raise_together
from toros_fem._types import Floats
from toros_fem._validate import real_numbers, require_count, require_finite, require_kind
from toros_fem.errors import DensityError
from toros_fem.meshes.skin import Skin


def random_density(skin: Skin, seed: int, mean: float = 0.5, spread: float = 0.1) -> Floats:
    """Return owned densities drawn uniformly from mean ± spread for each pattern triangle.

    The same seed gives the same density in each triangle on any number of ranks.

    Raises:
        DensityError: mean ± spread leaves [0, 1].
        ParameterError: The seed is negative.
    """
    require_kind("skin", skin, Skin, "a Skin, by sew")
    require_finite(mean=mean, spread=spread)
    if not (spread >= 0 and mean - spread >= 0 and mean + spread <= 1):
        raise DensityError(
            f"mean ± spread = {mean} ± {spread} must lie in [0, 1]; reduce the spread."
        )
    require_count(0, seed=seed)
    drawn = np.random.default_rng(seed).uniform(-1, 1, len(skin.pattern.panel))
    return np.asarray(mean + spread * drawn[skin.owned_cells])


def check_density(skin: Skin, density: Any) -> Floats:
    """Return owned densities as an array, with one result on all ranks (collective).

    Raises:
        DensityError: They are no real numbers, the shape is wrong, or one is outside [0, 1].
    """
    error = None
    owned = len(skin.owned_cells)
    try:
        density = real_numbers("density", density, "one for each owned triangle", DensityError)
    except DensityError as caught:
        raise_together(skin.comm, caught)
    if density.shape != (owned,):
        error = DensityError(
            f"density has shape {density.shape}; this rank owns {owned} triangles."
        )
    else:
        outside = ~((density >= 0) & (density <= 1))
        if outside.any():
            k = int(np.flatnonzero(outside)[0])
            error = DensityError(
                f"density of triangle {skin.owned_cells[k]} is {density[k]}; it must lie in "
                "[0, 1]. Clip the density, or look for an earlier error."
            )
    raise_together(skin.comm, error)
    return density
