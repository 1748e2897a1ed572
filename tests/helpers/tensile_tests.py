"""Synthetic tensile tests of known constants."""

from __future__ import annotations

import numpy as np

from toros_fem.materials.sheet import Material
from toros_fem.products.fitting.samples import TensileTest
from toros_fem.products.fitting.uniaxial import Coefficients, lateral_strain, pulling_stress

C1, C2 = 1.9, 2.2
JERSEY = Material(young=0.1e6, poisson=0.3, thickness=0.5e-3, c1=C1, c2=C2)
TRUE = {
    "young": JERSEY.young,
    "poisson": JERSEY.poisson,
    "mu": JERSEY.mu,
    "lam": JERSEY.lam,
    "c1": C1,
    "c2": C2,
}


def uniaxial_curve(
    material: Material, stretch: np.ndarray, *, knit_ratio: float = 1.0, direction: str = "wale"
) -> tuple[np.ndarray, np.ndarray]:
    """Stress per width in N/m and lateral stretch of a strip that is free to narrow, eq. (1)."""
    assert material.c1 is not None
    assert material.c2 is not None
    h, k = material.thickness, material.course_stiffness(knit_ratio)
    fibres = (k, 0.0) if direction == "course" else (0.0, k)
    bounds = (material.c1 - 1) ** -2, (material.c2 - 1) ** -2
    c = Coefficients(h * material.mu, h * material.lam, *bounds, *fibres)
    w = lateral_strain(stretch - 1, c)
    return np.asarray(pulling_stress(stretch - 1, w, c)), 1 + w


def synthetic(
    seed: int | None = None,
    *,
    noise: float = 0.02,
    lateral: bool = True,
    top: float = 1.8,
    points: int = 40,
    knit_ratio: float = 1.0,
    direction: str = "",
    specimen: str = "1",
) -> TensileTest:
    """A test of the jersey, with noise as a part of the largest stress, and half of it in λ₂."""
    stretch = np.linspace(1 + 0.025 * (top - 1), top, points, dtype=np.float64)
    fibres = direction or "wale"
    stress, across = uniaxial_curve(JERSEY, stretch, knit_ratio=knit_ratio, direction=fibres)
    if seed is not None:
        rng = np.random.default_rng(seed)
        stress = stress + noise * stress.max() * rng.standard_normal(points)
        across = across + noise / 2 * rng.standard_normal(points)
    return TensileTest(
        stretch, stress, JERSEY.thickness, across if lateral else None, specimen, direction
    )
