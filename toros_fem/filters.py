"""Density filter: cone convolution on the flat panels, eq. (11)."""

from __future__ import annotations

import warnings

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc
from scipy.spatial import cKDTree

from toros_fem.meshes.skin import Skin
from toros_fem.parameters import require_positive

Floats = npt.NDArray[np.float64]


class ConeFilter:
    """ρ̃ᵢ = Σⱼ ωᵢⱼ Āⱼ ρⱼ / Σⱼ ωᵢⱼ Āⱼ with ωᵢⱼ = max(R − ‖x̄ᵢ − x̄ⱼ‖, 0), eq. (11).

    Distances are taken inside one panel, since a print does not cross a seam. Rows sum to 1, so
    that a uniform density passes unchanged. The weights are a sparse matrix built once.

    Args:
        skin: The sewn skin.
        radius: R in m.

    Raises:
        ParameterError: The radius is not positive.

    Warns:
        UserWarning: The radius is under 1.5 edge lengths and hardly filters anything.
    """

    def __init__(self, skin: Skin, radius: float) -> None:
        require_positive(radius=radius)
        pattern = skin.pattern
        edge = float(np.sqrt(pattern.areas.mean() * 4 / np.sqrt(3)))
        if radius < 1.5 * edge:
            warnings.warn(
                f"filter radius = {radius:.3g} m is under 1.5 edge lengths ({edge:.3g} m each): "
                "it hardly filters. Refine the mesh or enlarge the radius.",
                stacklevel=2,
            )
        owned = skin.owned_cells
        imap = skin.density_space.dofmap.index_map
        first = imap.local_range[0]
        column = skin.gather_cells(first + np.arange(len(owned), dtype=np.float64))
        column = column.astype(PETSc.IntType)

        rows, cols, values = [], [], []
        for panel in range(len(pattern.panel_names)):
            members = np.flatnonzero(pattern.panel == panel)
            mine = np.flatnonzero(pattern.panel[owned] == panel)
            if not len(mine):
                continue
            near = cKDTree(pattern.centroids[owned[mine]]).sparse_distance_matrix(
                cKDTree(pattern.centroids[members]), radius, output_type="ndarray"
            )
            target = members[near["j"]]
            rows.append(mine[near["i"]])
            cols.append(column[target])
            values.append((radius - near["v"]) * pattern.areas[target])
        row = np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)
        weight = np.concatenate(values) if values else np.zeros(0)
        weight /= np.bincount(row, weight, minlength=len(owned))[row]
        order = np.argsort(row, kind="stable")
        start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(owned)))])
        col = np.concatenate(cols)[order] if cols else np.zeros(0, dtype=PETSc.IntType)
        size = (len(owned), len(column))
        self._skin = skin
        self._matrix = PETSc.Mat().createAIJ(
            (size, size), csr=(start.astype(PETSc.IntType), col, weight[order]), comm=skin.comm
        )
        self._in, self._out = self._matrix.createVecs()

    def forward(self, density: Floats) -> Floats:
        """ρ̃ from ρ, owned values (collective)."""
        self._in.array[:] = density
        self._matrix.mult(self._in, self._out)
        return self._out.array.copy()

    def backward(self, gradient: Floats) -> Floats:
        """∂T/∂ρ from ∂T/∂ρ̃, owned values (collective)."""
        self._out.array[:] = gradient
        self._matrix.multTranspose(self._out, self._in)
        return self._in.array.copy()
