"""Shared meshes, tables and checks of the tests."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from toros_fem.materials.sheet import Material
from toros_fem.meshes import Pattern
from toros_fem.meshes.pattern import Panel
from toros_fem.meshes.sheets import one_panel

ROOT = Path(__file__).parents[2]


DATA = ROOT / "tests" / "data"


sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]  # their cases and scenes are tested too


# Material A of the reference tables: mu = lam = 50 kPa, 0.3 mm.
TABLE_A = Material(young=400e3 / 3, poisson=1 / 3, thickness=0.3e-3)


def table(name: str) -> list[dict[str, str]]:
    """Rows of a reference table."""
    with (DATA / f"{name}.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def square(points: np.ndarray | None = None, n: int = 4, size: float = 0.02) -> Pattern:
    """An open square sheet of right triangles, flat or at given assembled positions."""
    u, v = np.meshgrid(np.linspace(0, size, n + 1), np.linspace(0, size, n + 1))
    flat = np.column_stack([u.ravel(), v.ravel()])
    node = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
    triangles = np.stack([np.stack([a, b, c], 2), np.stack([b, d, c], 2)], 2).reshape(-1, 3)
    return one_panel(flat, triangles, None if points is None else lambda _: points)


def part_of(pattern: Pattern, keep: np.ndarray) -> Pattern:
    """Those triangles alone, each panel's."""
    panels = []
    for k, name in enumerate(pattern.panel_names):
        cells = pattern.flat_triangles[keep & (pattern.panel == k)]
        if not len(cells):
            continue
        used, inverse = np.unique(cells, return_inverse=True)
        panels.append(
            Panel(name, pattern.flat_points[used], inverse.reshape(-1, 3),
                  pattern.points[pattern.sewn[used]])
        )  # fmt: skip
    return Pattern.from_panels(panels, tolerance=1e-6)


def box() -> Pattern:
    """A box around the z axis, on meshes that the planes x = 0 and y = 0 mirror."""
    size, n = 0.02, 4
    u, v = (a.ravel() for a in np.meshgrid(*[np.linspace(-1, 1, n + 1)] * 2))
    node = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
    falling = np.stack([np.stack([a, b, c], 2), np.stack([b, d, c], 2)], 2)
    rising = np.stack([np.stack([a, b, d], 2), np.stack([a, d, c], 2)], 2)
    which = np.not_equal.outer(np.arange(n) < n / 2, np.arange(n) < n / 2)
    tri = np.where(which[:, :, None, None], falling, rising).reshape(-1, 3)
    flat = size / 2 * np.stack([u, v], axis=1)
    one = np.full(len(u), 1.0)
    faces = {
        "top": (u, v, one), "bottom": (u, -v, -one), "front": (u, -one, v), "back": (-u, one, v),
        "right": (one, u, v), "left": (-one, -u, v),
    }  # fmt: skip
    panels = [Panel(name, flat, tri, size / 2 * np.stack(face, axis=1) + [0, 0, size / 2])
              for name, face in faces.items()]  # fmt: skip
    return Pattern.from_panels(panels, tolerance=1e-6)


def shared(comm: MPI.Comm, folder: Path) -> Path:
    """The first rank's folder, on all of them."""
    return comm.bcast(folder, root=0)
