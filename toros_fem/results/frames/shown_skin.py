"""A skin as reports show it: pattern, target, print and a body beside it, in one file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from shapely.geometry.base import BaseGeometry

from toros_fem.base.archive import Archive, read_archive, write_archive
from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import OutputError
from toros_fem.making.print.print_file import REGIONS, packed_regions, regions_of
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.pattern_file import archive_of, pattern_of
from toros_fem.results.frames.files import REMEDY

KIND = "skin"
BODY = ("body_points", "body_triangles")


@dataclass(frozen=True, eq=False)
class ShownSkin:
    """A whole skin, and what is drawn with it.

    Attributes:
        pattern: The pattern.
        target: Target positions of all vertices, (n, 3), in m; None without a target shape.
        aligned: Whether shapes are compared with the target after the best rigid motion.
        passive: Prescribed density of all triangles, (t,), NaN where it is designed; None designs
            every triangle.
        regions: Print on each panel, polygons in m; None before there is one.
        body: Points, (k, 3), in m, and triangles, (l, 3), of the objects beside the skin.
        grounds: A point of the surface, in m, and the normal of each ground, (g, 2, 3).
    """

    pattern: Pattern
    target: Floats | None = None
    aligned: bool = False
    passive: Floats | None = None
    regions: Sequence[BaseGeometry] | None = None
    body: tuple[Floats, Ints] | None = None
    grounds: Floats | None = None


def write_skin(folder: Path, skin: ShownSkin) -> str:
    """Write a skin and return the name of its file, which its content determines (one rank).

    Args:
        folder: Folder of the frames, which exists.
        skin: The skin. A file that is there already stays.
    """
    given = {"target": skin.target, "passive": skin.passive, "grounds": skin.grounds}
    arrays: dict[str, npt.NDArray] = {
        name: np.asarray(a) for name, a in given.items() if a is not None
    }
    if skin.regions is not None:
        arrays |= packed_regions(skin.regions)
    if skin.body is not None:
        arrays[BODY[0]], arrays[BODY[1]] = skin.body
    archive = archive_of(KIND, skin.pattern, arrays, {"aligned": skin.aligned})
    path = folder / f"{KIND}-{archive.digest[:12]}.npz"
    if not path.exists():
        write_archive(path, archive)
    return path.name


def read_skin(path: Path) -> ShownSkin:
    """Return the skin in a file.

    Raises:
        OutputError: The file cannot be read, or holds no valid skin.
    """

    def make(archive: Archive) -> ShownSkin:
        arrays = archive.arrays
        return ShownSkin(
            pattern_of(archive),
            target=arrays.get("target"),
            aligned=archive.numbers["aligned"],
            passive=arrays.get("passive"),
            regions=regions_of(archive) if REGIONS[0] in arrays else None,
            body=(arrays[BODY[0]], arrays[BODY[1]]) if BODY[0] in arrays else None,
            grounds=arrays.get("grounds"),
        )

    return read_archive(path, KIND, make, OutputError, REMEDY)
