"""Unstructured meshes from a file, so that pins do not depend on the version of gmsh."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from toros_fem.meshes import sheets

FILE = Path(__file__).parents[1] / "golden" / "meshes.npz"
MESHER = "polygon_mesh"


class KeptMeshes:
    """Stands in for the call of gmsh: returns what it returned when the file was written."""

    def __init__(self, make: Callable[..., Any] | None) -> None:
        self.make, self.new = make, False
        self.kept: dict[str, np.ndarray] = {}
        if FILE.exists():
            with np.load(FILE) as file:
                self.kept = dict(file)

    def __call__(
        self,
        corners: np.ndarray,
        edge_length: float,
        *,
        counts: Sequence[int] | None = None,
        faces: Sequence[np.ndarray] | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the mesh of some polygons.

        Raises:
            KeyError: It is not in the file. `--write-pins` on one rank adds it.
        """
        rounded = np.round(1e9 * np.append(np.ravel(corners), edge_length)).astype(np.int64)
        asked: Any = rounded.tolist(), list(map(int, counts or [1] * len(corners)))
        if faces is not None and len(faces) > 1:
            asked = *asked, [face.tolist() for face in faces]
        key = hashlib.sha1(repr(asked).encode()).hexdigest()
        if f"{key} points" not in self.kept and self.make is not None:
            points, triangles = self.make(corners, edge_length, counts=counts, faces=faces)
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
    return sheets.polygon_mesh
