"""Random densities that do not depend on the number of ranks."""

from __future__ import annotations

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.validation import require_count
from toros_fem.meshes.skin import Skin


def random_density(skin: Skin, seed: int, mean: float = 0.5, spread: float = 0.1) -> Floats:
    """Return owned densities drawn uniformly from mean ± spread for each pattern triangle.

    The same seed gives the same density in each triangle on any number of ranks.
    """
    require_count(0, seed=seed)
    drawn = np.random.default_rng(seed).uniform(-1, 1, len(skin.pattern.panel))
    return np.asarray(mean + spread * drawn[skin.owned_cells])
