"""Targets and cross-sections of the short tube."""

import numpy as np

from toros_fem.measures.cross_sections import CrossSections, label_cross_sections
from toros_fem.meshes import Skin, bend, compose, twist

LENGTH = 0.06  # of the short tube in m


TARGET = compose(twist(4.0, LENGTH), bend(1.0, LENGTH))


def tube_sections(skin: Skin) -> CrossSections:
    """Six cross-sections of the short tube, all weights different."""
    label = label_cross_sections(skin.pattern, skin.pattern.vertices_of("wall"), (0, 0, 1), 5)
    weights = np.arange(1.0, 7.0).astype(np.float64)
    return CrossSections(label, np.tile([1.0, 2.0, 3.0], (6, 1)), weights)
