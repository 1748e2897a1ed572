"""Parts of a barrier: what each half-space and each body pushes."""

import numpy as np
import pytest
from helpers.scenes import square

from toros_fem.mechanics.contact.barrier import Barrier
from toros_fem.mechanics.contact.settings import ContactSizes, Ground
from toros_fem.mechanics.contact.solids import rigid_box

SIZES = ContactSizes(5e-4, 1e-4, 1e6, 1e-4)


def test_sides_make_up_the_whole_push() -> None:
    """A sheet in the corner of two half-spaces, below one box and above another."""
    pytest.importorskip("ipctk")
    sheet = square(n=4)
    count = len(sheet.points)
    below = rigid_box("below", (6e-3, 6e-3, 2e-3), (0.011, 0.009, -1e-3 - 5.6e-4))
    above = rigid_box("above", (6e-3, 6e-3, 2e-3), (0.006, 0.012, 1e-3 + 5.7e-4))
    turn = np.array([0.0, 0.0, 0.0, 1e-3, 2e-3, 0.3])  # no edges in parallel
    below, above = below.moved(turn), above.moved(turn)
    grounds = [Ground((0.0, 0.0, -6e-5)), Ground((-5e-5, 0.0, 0.0), (1.0, 0.0, 0.0))]
    places = np.concatenate([sheet.points, below.points, above.points])
    ahead = count + np.array([0, len(below.points)])
    bodies = [b.triangles + n for b, n in zip((below, above), ahead, strict=True)]
    triangles = np.concatenate([sheet.triangles, *bodies])
    sizes = [count, len(below.points), len(above.points)]
    owners = np.repeat(np.arange(3), sizes)
    areas = np.full(len(triangles), 1e-6)
    barrier = Barrier(places, triangles, areas, grounds, np.arange(count), SIZES)
    sides = barrier.sides(places, owners)
    pushes = np.array([side.push() for side in sides])
    assert (np.linalg.norm(pushes[:, :count].sum(axis=1), axis=1) > 1e-3).all()
    whole = -barrier.gradient(places)[:count]
    assert pushes[:, :count].sum(axis=0) == pytest.approx(whole, abs=1e-9 * np.abs(whole).max())
    assert (pushes[0, :count, 2] >= 0).all()
    assert not pushes[0, :, :2].any()
    assert not pushes[1, :, 1:].any()
    for side in (2, 3):  # action and reaction
        assert pushes[side].sum(axis=0) == pytest.approx(0, abs=1e-12 * np.abs(pushes).max())
        assert not pushes[side][(owners > 0) & (owners != side - 1)].any()
    motion = 1e-10 * np.random.default_rng(0).standard_normal(places.shape)
    changed = np.array([side.push() for side in barrier.sides(places + motion, owners)])
    expected = np.array([side.push_change(motion) for side in sides])
    assert changed - pushes == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())
