"""Objectives and metrics of a whole skin, from the positions of a part."""

import numpy as np
import pytest
from helpers.objectives import LENGTH
from mpi4py import MPI

from toros_fem.measures.alignment import AlignedObjective, MirroredObjective
from toros_fem.measures.cross_sections import (
    CrossSectionObjective,
    CrossSections,
    label_cross_sections,
)
from toros_fem.measures.gap import Body, GapObjective
from toros_fem.measures.shape import Nodes, Objective, ShapeObjective, SumObjective
from toros_fem.meshes import Skin, bend, cylinder, mirrored, sew

BENT = bend(0.7, LENGTH)


@pytest.fixture(scope="module")
def half(alone: MPI.Comm) -> Skin:
    return sew(alone, cylinder(alone, LENGTH, 0.02, 4.5e-3, planes=(1,)))


def all_terms(nodes: Nodes) -> Objective:
    """Every kind of objective at once, with weights that vary along the tube."""
    pattern = nodes.pattern
    target = BENT(pattern.points)
    rising = 1.0 + pattern.points[:, 2] / LENGTH
    labels = label_cross_sections(pattern, pattern.vertices_of("wall"), (0, 0, 1), 4)
    orientation: np.ndarray = np.arange(1.0, 6.0)
    sections = CrossSections(labels, np.tile([1.0, 2.0, 3.0], (5, 1)), orientation)
    return SumObjective(
        ShapeObjective(nodes, target, rising, rising),
        CrossSectionObjective(nodes, target, sections),
        GapObjective(nodes, Body("sphere", 0.02, (0.05, 0.0, 0.03)), rising, 0.1),
        AlignedObjective(nodes, target, ShapeObjective(nodes, target)),
    )


def shapes(half: Skin) -> tuple[np.ndarray, np.ndarray]:
    """Positions of a bent and disturbed half, its cut in the plane; and those of the whole."""
    points = half.pattern.points
    moved = BENT(points) + 1e-3 * np.random.default_rng(3).standard_normal(points.shape)
    moved[points[:, 1] == 0, 1] = 0
    return moved, mirrored(half.pattern, (1,)).at_vertices(moved)


def test_value_and_gradient_are_those_of_the_whole(half: Skin, alone: MPI.Comm) -> None:
    images = mirrored(half.pattern, (1,))
    skin = sew(alone, images.pattern)
    here, there = shapes(half)
    one, other = MirroredObjective(half, images, all_terms), all_terms(skin)
    value = one.forward(here[half.owned_vertices])
    assert value == pytest.approx(other.forward(there[skin.owned_vertices]), rel=1e-13)
    gradient = half.gather_vertices(one.backward(here[half.owned_vertices]))
    whole = images.signs * skin.gather_vertices(other.backward(there[skin.owned_vertices]))
    pulled = [np.bincount(images.vertex, column) for column in whole.T]
    scale = np.abs(gradient).max()
    assert gradient == pytest.approx(np.stack(pulled, axis=1), abs=1e-12 * scale)
