"""Unstructured meshes from a file, so that pins do not depend on the version of gmsh."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from toros_fem.meshes import gmsh_panels

FILE = Path(__file__).parents[1] / "golden" / "meshes.npz"
MESHER = "polygon_meshes"


class KeptMeshes:
    """Stands in for the call of gmsh: returns what it returned when the file was written."""

    def __init__(self, make: Callable[..., Any] | None) -> None:
        self.make, self.new = make, False
        self.kept: dict[str, np.ndarray] = {}
        if FILE.exists():
            with np.load(FILE) as file:
                self.kept = dict(file)

    def __call__(self, outlines: Sequence[Any], edge_length: float) -> list[Any]:
        """Return the meshes of some outlines.

        Raises:
            KeyError: They are not in the file. `--write-pins` on one rank adds them.
        """
        return [self._mesh(corners, counts, edge_length) for corners, counts in outlines]

    def _mesh(self, corners: np.ndarray, counts: Sequence[int], edge_length: float) -> Any:
        rounded = np.round(1e9 * np.append(np.ravel(corners), edge_length)).astype(np.int64)
        key = hashlib.sha1(repr((rounded.tolist(), list(map(int, counts)))).encode()).hexdigest()
        if f"{key} points" not in self.kept and self.make is not None:
            ((points, triangles),) = self.make([(corners, counts)], edge_length)
            # A picometre is far below what a pin sees, and packs well.
            self.kept[f"{key} points"] = np.round(points, 12)
            self.kept[f"{key} triangles"] = triangles.astype(np.int32)
            self.new = True
        points = self.kept[f"{key} points"]
        return points.copy(), self.kept[f"{key} triangles"].astype(np.int64)

    def save(self) -> None:
        """Write the file anew where meshes were added."""
        if self.new:
            np.savez_compressed(FILE, **dict(sorted(self.kept.items())))  # type: ignore[arg-type]

    def patch(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Take the place of the mesher in all modules that use it."""
        for name, module in list(sys.modules.items()):
            if name.startswith("toros_fem.meshes") and hasattr(module, MESHER):
                monkeypatch.setattr(module, MESHER, self)


def mesher() -> Callable[..., Any]:
    """Return the call of gmsh itself."""
    return gmsh_panels.polygon_meshes
