"""Eq. (1) with a neo-Hookean layer, fitted to the law of a silicone: law to law, not to a test."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.optimize import least_squares

from benchmarks.measured.compared import Floats
from toros_fem.materials.sheet import Bladder, Composite, Material

# Gent's law of the authors, from their tensile tests: μ in Pa, and the limit of I₁ − 3.
SHEAR, LIMIT = 31.7e3, 39.6
# Largest stretch that is fitted; the lower bounds of c₁ and c₂ are above it.
LARGEST = 3.2


def gent(one: Floats, two: Floats) -> Floats:
    """Return the nominal stresses of Gent's incompressible sheet in Pa, (2, n)."""
    third = 1 / (one * two) ** 2
    factor = SHEAR * LIMIT / (LIMIT - (one**2 + two**2 + third - 3))
    return np.stack([factor * (stretch - third / stretch) for stretch in (one, two)])


def own(constants: Floats, one: Floats, two: Floats) -> Floats:
    """Return those of eq. (1) and the layer, in Pa, from E, ν, c₁, c₂ and the layer's modulus."""
    young, poisson, c1, c2, rubber = constants
    both = one + two - 2
    lam = young * poisson / (1 - poisson**2) * both / (1 - (both / (c2 - 1)) ** 2)
    third = 1 / (one * two) ** 2
    return np.stack([
        young / (1 + poisson) * (s - 1) / (1 - ((s - 1) / (c1 - 1)) ** 2) + lam
        + rubber / 3 * (s - third / s)
        for s in (one, two)
    ])  # fmt: skip


@cache
def fitted() -> tuple[tuple[float, ...], float]:
    """Return the constants, and the rms deviation of the stress in per cent."""
    one, two = np.meshgrid(*[np.linspace(1, LARGEST, 23)] * 2)
    kept = (one >= two) & (one > 1)
    one, two = one[kept], two[kept]
    known = gent(one, two)
    size = np.linalg.norm(known, axis=0)
    found = least_squares(
        lambda constants: ((own(constants, one, two) - known) / size).ravel(),
        [5e3, 0.3, 5.0, 8.0, 8e4], x_scale=[1e4, 0.1, 1.0, 1.0, 1e4],
        bounds=([1.0, 0.0, 1.06 * LARGEST, 1.75 * LARGEST, 0.0], [3e5, 0.499, 12.0, 25.0, 2e5]),
    )  # fmt: skip
    return tuple(map(float, found.x)), float(100 * np.sqrt(2 * found.cost / found.fun.size))


def silicone(thickness: float, stiff: Material | None = None) -> Composite:
    """Return a sheet of the silicone, in m; `stiff` is its printed part, if it has one."""
    (young, poisson, c1, c2, rubber), _ = fitted()
    sheet = Material(young, poisson, thickness)
    return Composite(fabric=sheet, reinforcement=stiff or sheet, c1=c1, c2=c2, bending=None,
                     bladder=Bladder(rubber, thickness))  # fmt: skip
