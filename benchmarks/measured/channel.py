"""A flat C-shaped channel, sealed at both borders, curls up further when it is inflated."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from mpi4py import MPI

from benchmarks.bench import Row
from benchmarks.measured.closed_forms import channel_curvature
from benchmarks.measured.compared import Compared, rows_of
from benchmarks.measured.skins import Held
from toros_fem.materials.sheet import Composite, Material, Membrane
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import pin
from toros_fem.meshes import two_panels

NAME = "channel"
AXES = ("width over radius (1)", "curvature over that of the flat channel (1)")
RATIOS = (0.1, 0.2, 0.3)
RADIUS, HALF = 50e-3, np.radians(100.0)  # m; of the flat channel's middle, and half its angle
# E h is more than 300 times pressure times width: it hardly stretches.
SHEET = Material(1e9, 0.3, 1e-4)
PRESSURES = (500.0, 5e3, 20e3)  # Pa


def curvature(ratio: float, across: int) -> float:
    """Return the same of a simulated channel, from the circle through its inner seam."""
    width = ratio * RADIUS
    turn = np.linspace(-HALF, HALF, 1 + int(2 * HALF * RADIUS * across / width))
    arc = np.column_stack([np.cos(turn), np.sin(turn)])
    outline = np.concatenate([(RADIUS + width / 2) * arc, (RADIUS - width / 2) * arc[::-1]])
    pattern = two_panels(MPI.COMM_SELF, outline, width / across)
    composite = Composite(fabric=SHEET, reinforcement=SHEET, c1=1.9, c2=2.6, bending=None,
                          membrane=Membrane("tension-field"))  # fmt: skip
    skin = Held(pattern, composite, pin(pattern))
    positions = [skin.under(Load(pressure))[0] for pressure in PRESSURES][-1]
    far, angle = np.hypot(*pattern.points[:, :2].T), np.arctan2(*pattern.points[:, 1::-1].T)
    seam = (np.abs(far - RADIUS + width / 2) < 1e-3 * width) & (np.abs(angle) < HALF * 0.6)
    chosen = np.flatnonzero(seam)[np.argsort(angle[seam])]
    inner = positions[chosen] - positions[chosen].mean(axis=0)
    flat = inner @ np.linalg.svd(inner)[2][:2].T
    centre = np.linalg.lstsq(
        np.column_stack([2 * flat, np.ones(len(flat))]), (flat**2).sum(axis=1), rcond=None
    )[0][:2]
    turned = np.unwrap(np.arctan2(*(flat - centre).T))
    return float(abs(np.ptp(turned)) / np.ptp(angle[chosen]))


def run(quick: bool) -> Iterator[Row]:
    """Compare the curvature of three channels with that of the largest volume."""
    ratios = RATIOS[1:2] if quick else RATIOS
    points = np.array([(ratio, channel_curvature(ratio)) for ratio in ratios])
    found = [curvature(ratio, 6 if quick else 10) for ratio in ratios]
    yield from rows_of(NAME, "sealed channel", points, found, axes=AXES)


CASE = Compared(
    name=NAME,
    title="Curved channel",
    known="all; the reference is a closed form, not a measurement",
    assumed="E h is more than 300 times pressure × width; the reference is of an endless channel",
    free="none",
    run=run,
    picture="A sealed curved channel curls up as its largest volume says, within {worst} %",
    axes=AXES,
)
