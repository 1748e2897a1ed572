"""A skin as reports show it: pattern, target, print and a body beside it, in one file."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.pattern import Pattern
from toros_fem.results.frames.npz import Arrays, read_arrays, require_arrays, write_arrays

# Arrays that each file holds; others may be left out.
NAMES = (
    "flat_points", "flat_triangles", "panel", "sewn", "points", "panel_names", "seam_tolerance",
    "moulded", "aligned",
)  # fmt: skip
# Arrays of which a file holds all or none.
RINGS = ("ring_points", "ring_first", "ring_polygon", "polygon_panel")
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
        regions: Print on each panel, polygons in m; None where densities are shown instead.
        body: Points, (k, 3), in m, and triangles, (l, 3), of an object beside the skin.
    """

    pattern: Pattern
    target: Floats | None = None
    aligned: bool = False
    passive: Floats | None = None
    regions: Sequence[BaseGeometry] | None = None
    body: tuple[Floats, Ints] | None = None


def write_skin(folder: Path, skin: ShownSkin) -> str:
    """Write a skin and return the name of its file, which its content determines (one rank).

    Args:
        folder: Folder of the frames, which exists.
        skin: The skin. A file that is there already stays.
    """
    arrays = _arrays(skin)
    content = hashlib.sha256()
    for name, array in arrays.items():
        content.update(name.encode() + array.tobytes())
    path = folder / f"skin-{content.hexdigest()[:12]}.npz"
    if not path.exists():
        write_arrays(path, arrays)
    return path.name


def read_skin(path: Path) -> ShownSkin:
    """Return the skin in a file.

    Raises:
        OutputError: The file cannot be read.
        PatternError: It holds no valid pattern.
    """
    arrays = read_arrays(path, NAMES)
    for group in (RINGS, BODY):
        if any(name in arrays for name in group):
            require_arrays(path, arrays, group)
    pattern = Pattern(
        flat_points=arrays["flat_points"],
        flat_triangles=arrays["flat_triangles"],
        panel=arrays["panel"],
        sewn=arrays["sewn"],
        points=arrays["points"],
        panel_names=tuple(str(name) for name in arrays["panel_names"]),
        seam_tolerance=float(arrays["seam_tolerance"]),
        moulded=bool(arrays["moulded"]),
    )
    body = None
    if "body_points" in arrays:
        body = arrays["body_points"], arrays["body_triangles"].astype(np.int64)
    return ShownSkin(
        pattern,
        target=arrays.get("target"),
        aligned=bool(arrays["aligned"]),
        passive=arrays.get("passive"),
        regions=_regions(arrays) if "ring_points" in arrays else None,
        body=body,
    )


def _arrays(skin: ShownSkin) -> Arrays:
    pattern = skin.pattern
    arrays: dict[str, np.ndarray] = {
        "flat_points": pattern.flat_points,
        "flat_triangles": pattern.flat_triangles.astype(np.int32),
        "panel": pattern.panel.astype(np.int32),
        "sewn": pattern.sewn.astype(np.int32),
        "points": pattern.points,
        "panel_names": np.array(pattern.panel_names),
        "seam_tolerance": np.array(pattern.seam_tolerance),
        "moulded": np.array(pattern.moulded),
        "aligned": np.array(skin.aligned),
    }
    if skin.target is not None:
        arrays["target"] = np.asarray(skin.target, dtype=np.float64)
    if skin.passive is not None:
        arrays["passive"] = np.asarray(skin.passive, dtype=np.float32)
    if skin.regions is not None:
        arrays |= _rings(skin.regions)
    if skin.body is not None:
        points, triangles = skin.body
        arrays |= {"body_points": points, "body_triangles": triangles.astype(np.int32)}
    return arrays


def _rings(regions: Sequence[BaseGeometry]) -> dict[str, np.ndarray]:
    """Return the print as rings: their points, first points, polygons, and the polygons' panels.

    The outer ring of a polygon comes first; the first point of a ring comes again as its last.
    """
    parts, panel = shapely.get_parts(np.array(regions, dtype=object), return_index=True)
    flat = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    rings, polygon = shapely.get_rings(parts[flat], return_index=True)
    counts = shapely.get_num_coordinates(rings)
    return {
        "ring_points": shapely.get_coordinates(rings),
        "ring_first": np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
        "ring_polygon": polygon.astype(np.int32),
        "polygon_panel": panel[flat].astype(np.int32),
    }


def _regions(arrays: Arrays) -> list[BaseGeometry]:
    first, points = arrays["ring_first"], arrays["ring_points"]
    polygons: list[list[Floats]] = [[] for _ in arrays["polygon_panel"]]
    for ring, polygon in enumerate(arrays["ring_polygon"]):
        polygons[polygon].append(points[first[ring] : first[ring + 1]])
    panels: list[list[BaseGeometry]] = [[] for _ in arrays["panel_names"]]
    for (shell, *holes), panel in zip(polygons, arrays["polygon_panel"], strict=True):
        panels[panel].append(shapely.Polygon(shell, holes))
    return [shapely.MultiPolygon(parts) for parts in panels]
