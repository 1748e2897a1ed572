"""A strip with fine ribs on one face is pulled: it curls across, by the angle of the ribs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from mpi4py import MPI

from benchmarks.bench import Row
from benchmarks.measured.closed_forms import plate, rib_curvature
from benchmarks.measured.compared import Compared, Floats, rows_of
from benchmarks.measured.skins import Held
from toros_fem.materials.sheet import Bending, Composite, Material, print_offset, reinforced
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.sheets import rectangle

NAME = "offset_print"
AXES = ("angle of the ribs (°)", "curvature × thickness (%)")
YOUNG, POISSON, BASE, RIB = 1e6, 0.5, 0.5e-3, 0.5e-3  # Pa and m
LENGTH, WIDTH, PERIOD, SHARE = 12e-3, 8e-3, 1e-3, 0.5  # m
EDGE, STRAIN = 0.125e-3, 0.02  # four squares to a rib
ANGLES = (0, 15, 30, 45, 60)


def simulated(angle: float) -> float:
    """Return curvature times thickness in the middle of the strip, from an angle in rad."""
    fabric, layer = Material(YOUNG, POISSON, BASE), Material(YOUNG, POISSON, RIB)
    composite = Composite(
        fabric=fabric, reinforcement=reinforced(fabric, layer), c1=9.0, c2=17.0, bending=Bending(),
        print_side="outside", print_offset=print_offset(fabric, layer),
    )  # fmt: skip

    def centred(flat: Floats) -> Floats:
        return np.column_stack([flat - [LENGTH / 2, WIDTH / 2], 0 * flat[:, 0]])

    pattern = rectangle(MPI.COMM_SELF, LENGTH, WIDTH, EDGE, "crossed", centred)
    points = pattern.points
    x, y = points[:, 0], points[:, 1]
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[:, 0] = np.abs(np.abs(x) - LENGTH / 2) < 1e-9
    # The rest holds it against rigid motion: middle, a point beside it, and one at an end.
    near = [np.argmin(np.hypot(x - a, y - b)) for a, b in
            ((0, 0), (0, WIDTH / 2), (LENGTH / 2, 0))]  # fmt: skip
    fixed[near, 2] = True
    fixed[near[0], 1] = True
    middle = points[pattern.triangles].mean(axis=1)
    across = middle[:, 0] * np.cos(angle) - middle[:, 1] * np.sin(angle)
    skin = Held(pattern, composite, Supports(fixed), across / PERIOD % 1 < SHARE)
    moved, _ = skin.under(Load(displacement=STRAIN * points * [1, 0, 0] * fixed))
    u, v, w = moved[np.abs(x) < 1.5 * PERIOD].T
    terms = np.column_stack([np.ones(len(u)), u, v, u * u, u * v, v * v])
    return float(-2 * BASE * np.linalg.lstsq(terms, w, rcond=None)[0][5])


def run(quick: bool) -> Iterator[Row]:
    """Compare the curvatures of all angles with the exact laminate."""
    base, ribbed = (plate(YOUNG, POISSON, -BASE / 2, BASE / 2 + rib) for rib in (0.0, RIB))
    angles = np.array(ANGLES[:3:2] if quick else ANGLES, dtype=float)
    turns = np.radians(angles)
    exact = [100 * STRAIN * BASE * rib_curvature(base, ribbed, SHARE, a) for a in turns]
    found = [100 * simulated(a) for a in turns]
    points = np.column_stack([angles, exact])
    yield from rows_of(NAME, "pulled by 2 %", points, found, axes=AXES)


CASE = Compared(
    name=NAME,
    title="Print on one face",
    known="all; the reference is the exact laminate, not a measurement",
    assumed="ribs are thin plates; the reference is of an endless strip with infinitely fine ribs",
    free="none",
    run=run,
    picture="Ribs on one face: half of the curvatures are within {median} % of the exact laminate",
    axes=AXES,
)
