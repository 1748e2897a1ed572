"""Pressure of chambers: weighted volumes, and where walls contribute."""

import numpy as np
import pytest
from helpers.standing import model_on_base
from mpi4py import MPI

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.mechanics.terms.model import SkinModel, make_model
from toros_fem.meshes import Skin, cylinder, sew

LENGTH, RADIUS = 0.05, 0.01


@pytest.fixture(scope="module")
def grid(alone: MPI.Comm) -> Skin:
    return sew(alone, cylinder(alone, LENGTH, 2 * RADIUS, 5e-3, mesh="structured"))


def model_of(skin: Skin, chambers: Chambers | None) -> SkinModel:
    return model_on_base(skin, Composite(bending=None), chambers=chambers)


def parts(skin: Skin, height: float) -> Chambers:
    middle = skin.pattern.points[skin.pattern.triangles].mean(axis=1)[:, 2]
    return Chambers(("lower", "upper"), (middle > height).astype(int))


def test_volumes_of_two_parts_of_a_prism(grid: Skin) -> None:
    """Each chamber is a prism over the same polygon."""
    model = model_of(grid, parts(grid, LENGTH / 2))
    sides = round(2 * np.pi * RADIUS / 5e-3)
    area = 0.5 * sides * np.sin(2 * np.pi / sides) * RADIUS**2
    assert model.volumes(model.assembled) == pytest.approx([area * LENGTH / 2] * 2, rel=1e-12)
    whole = model_of(grid, None).volumes(model.assembled)
    assert whole == pytest.approx([area * LENGTH], rel=1e-12)


def test_the_wall_is_in_the_tangent_of_its_border_alone(grid: Skin) -> None:
    two, one = model_of(grid, parts(grid, LENGTH / 2)), model_of(grid, None)
    assert one.pressure.pairs.shape == (2, 0)
    rows, columns = two.pressure.pairs
    assert np.all(rows <= columns)
    border = int(grid.comm.allreduce(len(np.unique(rows))))
    assert border == 3 * round(2 * np.pi * RADIUS / 5e-3)


def test_open_skin_has_no_volume(alone: MPI.Comm) -> None:
    pattern = cylinder(alone, LENGTH, 2 * RADIUS, 5e-3, mesh="structured", caps=None)
    skin = sew(alone, pattern)
    model = make_model(skin, Composite(bending=None), clamp(pattern, ["wall"]))
    assert model.pressure is None
    assert model.volumes(model.assembled).sum() == 0
    assert not model.volume_gradient(model.assembled).any()
