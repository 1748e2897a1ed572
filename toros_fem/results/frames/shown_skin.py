"""A skin as reports show it: pattern, target, print and a body beside it, in one file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from toros_fem.base.archive import Archive, read_archive, write_archive
from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import OutputError
from toros_fem.making.print.print_file import REGIONS, packed_regions, regions_of
from toros_fem.measures.miss import Miss, miss_of, placed_on
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.pattern_file import archive_of, pattern_of
from toros_fem.results.frames.files import REMEDY

KIND = "skin"
BODY = ("body_points", "body_triangles")
# Vertical part of a unit normal from which on a ground is level.
LEVEL = 0.999


@dataclass(frozen=True, eq=False)
class ShownSkin:
    """A whole skin, and what is drawn with it.

    Attributes:
        target: Target positions of all vertices, (n, 3), in m; None without a target shape.
        aligned: Whether shapes are compared with the target after the best rigid motion.
        passive: Prescribed density of all triangles, (t,), NaN where it is designed; None designs
            every triangle.
        regions: Its print; None before there is one.
        body: Points, (k, 3), in m, and triangles, (l, 3), of the objects beside the skin.
        grounds: A point of the surface, in m, and the normal of each ground, (g, 2, 3).
        compared: Whether the design compares positions with the target along x, y and z.
    """

    pattern: Pattern
    target: Floats | None = None
    aligned: bool = False
    passive: Floats | None = None
    regions: Regions | None = None
    body: tuple[Floats, Ints] | None = None
    grounds: Floats | None = None
    compared: tuple[bool, bool, bool] = (False, False, False)

    @property
    def ground(self) -> float | None:
        """Height in m of the level ground; None without one."""
        grounds = () if self.grounds is None else self.grounds
        return next((float(point[2]) for point, normal in grounds if normal[2] > LEVEL), None)

    def placed(self, positions: Floats) -> Floats:
        """Return positions of all vertices, (n, 3), in m, as they are compared with the target."""
        if not self.aligned or self.target is None:
            return positions
        return placed_on(self.pattern, positions, self.target)

    def miss(self, placed: Floats) -> Miss | None:
        """Return how far placed positions, (n, 3), are from the target; None if nothing says so."""
        if self.target is None or not any(self.compared):
            return None
        return miss_of(self.pattern, placed, self.target, self.compared)

    def wanted(self, placed: Floats) -> Floats | None:
        """Return the target, (n, 3), where axes that do not count are those of placed positions."""
        if any(self.compared) and not all(self.compared):
            miss = self.miss(placed)
            return self.target if miss is None else miss.asked
        return self.target


def write_skin(folder: Path, skin: ShownSkin) -> str:
    """Write a skin into the folder of the frames and return the name of its file (one rank).

    Its content determines the name. A file that is there already stays.
    """
    given = {"target": skin.target, "passive": skin.passive, "grounds": skin.grounds}
    arrays: dict[str, npt.NDArray] = {
        name: np.asarray(a) for name, a in given.items() if a is not None
    }
    if skin.regions is not None:
        arrays |= packed_regions(skin.regions)
    if skin.body is not None:
        arrays[BODY[0]], arrays[BODY[1]] = skin.body
    numbers = {"aligned": skin.aligned, "compared": list(skin.compared)}
    archive = archive_of(KIND, skin.pattern, arrays, numbers)
    path = folder / f"{KIND}-{archive.digest[:12]}.npz"
    if not path.exists():
        write_archive(path, archive)
    return path.name


def read_skin(path: Path) -> ShownSkin:
    """Return the skin in a file, or raise an OutputError."""

    def make(archive: Archive) -> ShownSkin:
        arrays, pattern = archive.arrays, pattern_of(archive)
        panels = len(pattern.panel_names)
        return ShownSkin(
            pattern,
            target=arrays.get("target"),
            aligned=archive.numbers["aligned"],
            passive=arrays.get("passive"),
            regions=regions_of(archive, panels) if REGIONS[0] in arrays else None,
            body=(arrays[BODY[0]], arrays[BODY[1]]) if BODY[0] in arrays else None,
            grounds=arrays.get("grounds"),
            compared=tuple(archive.numbers.get("compared", (False,) * 3)),
        )

    return read_archive(path, KIND, make, OutputError, REMEDY)
