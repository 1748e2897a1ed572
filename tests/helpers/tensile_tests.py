"""Synthetic tensile tests of known constants."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from toros_fem.materials.sheet import Material
from toros_fem.meshes import sew
from toros_fem.products.fitting.printed_sheet import scaled
from toros_fem.products.fitting.tensile_test import TensileTest
from toros_fem.products.fitting.uniaxial import uniaxial_curve
from toros_fem.products.tiles.printed_tile import PrintedTile, tile_sheet
from toros_fem.products.tiles.pull_test import PullMachine

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


def pulled_sheet(
    comm: MPI.Comm, tile: PrintedTile, factors: np.ndarray, strains: np.ndarray
) -> TensileTest:
    """A pull test along x of two tiles with other moduli, by other code than the fit's."""
    mesh, printed = tile.tile(comm)
    sheet = tile_sheet(mesh, "x", 2, 1)
    skin, cells = sew(comm, sheet.pattern), printed[sheet.cell]
    density, composite = cells[skin.owned_cells].astype(float), scaled(tile.composite, factors)
    machine = PullMachine(skin, composite, 0, 2 * tile.size[0], quadratic=cells)
    curve = machine.pull(density, strains)
    lateral = 1 - curve.contraction * strains
    return TensileTest(1 + strains, curve.stress, 5e-4, lateral, "sheet", "x")
