"""The three-dimensional part of a report: skins, prints and all their shapes, packed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats, Ints
from toros_fem.measures.rotation import polar_rotation
from toros_fem.meshes.panels import CutTriangles, cut_triangles
from toros_fem.meshes.pattern import Pattern
from toros_fem.results.frames.files import Frame
from toros_fem.results.frames.shown_skin import ShownSkin
from toros_fem.results.report.packing import STEPS, Box, Packed, index_type
from toros_fem.results.report.run_folder import Run

# Positions of all frames together take at most so many bytes before they are compressed.
MOST_BYTES = 6_000_000
# Range of the stretches that a byte tells.
LEAST_STRETCH, MOST_STRETCH = 0.0, 2.55
# A corner with a smaller weight lies on the edge opposite.
ON_EDGE = 1e-4


def packed_scene(run: Run) -> tuple[dict[str, Any], str]:
    """Return the description of all shapes of a run, and their arrays as text.

    Args:
        run: The run; it has one frame at least.
    """
    series = {name: _chosen(frames, name, run) for name, frames in run.series.items()}
    shapes = {
        name: [_placed(run.skins[frame.skin], frame.positions) for frame in frames]
        for name, frames in series.items()
    }
    skins = {name: skin for name, skin in run.skins.items() if _is_used(name, series)}
    box = _box([*(x for found in shapes.values() for x in found), *_others(skins)])
    packed = Packed()
    return {
        "low": box.low.tolist(),
        "step": box.step,
        "skins": {name: _packed_skin(packed, box, skin) for name, skin in skins.items()},
        "series": {
            name: _packed_series(packed, box, frames, shapes[name], skins)
            for name, frames in series.items()
        },
        "left_out": {name: len(run.series[name]) - len(frames) for name, frames in series.items()},
    }, packed.text()


def principal_stretches(pattern: Pattern, positions: Floats) -> Floats:
    """Return the smaller and the larger principal stretch of all triangles, (t, 2).

    Args:
        pattern: The pattern, whose flat panels are unstretched.
        positions: Positions of all vertices, (n, 3), in m.
    """
    a, b, c = np.moveaxis(pattern.corners, 1, 0)
    flat = np.stack([b - a, c - a], axis=2)
    a, b, c = np.moveaxis(positions[pattern.triangles], 1, 0)
    gradient = np.stack([b - a, c - a], axis=2) @ np.linalg.inv(flat)
    return np.asarray(np.linalg.svd(gradient, compute_uv=False)[:, ::-1])


def _is_used(name: str, series: Mapping[str, Sequence[Frame]]) -> bool:
    return any(frame.skin == name for frames in series.values() for frame in frames)


def _chosen(frames: Sequence[Frame], name: str, run: Run) -> Sequence[Frame]:
    """Return every second frame, every fourth …, and the last, as far as their size requires."""
    limit = MOST_BYTES / len(run.series)
    distance = 1
    while len(frames) > 2:
        chosen = [*frames[:-1:distance], frames[-1]]
        if sum(f.positions.size * 2 for f in chosen) <= limit or len(chosen) == 2:
            return chosen
        distance *= 2
    return frames


def _placed(skin: ShownSkin, positions: Floats) -> Floats:
    """Return positions, moved rigidly onto the target where the design compares them so."""
    if not skin.aligned or skin.target is None:
        return positions
    weights = skin.pattern.vertex_areas / skin.pattern.vertex_areas.sum()
    centre, goal = weights @ positions, weights @ skin.target
    rotation, _ = polar_rotation(((skin.target - goal) * weights[:, None]).T @ (positions - centre))
    return np.asarray((positions - centre) @ rotation.T + goal)


def _others(skins: Mapping[str, ShownSkin]) -> list[Floats]:
    targets = [skin.target for skin in skins.values() if skin.target is not None]
    return targets + [skin.body[0] for skin in skins.values() if skin.body is not None]


def _box(points: Sequence[Floats]) -> Box:
    low = np.min([p.min(axis=0) for p in points], axis=0)
    high = np.max([p.max(axis=0) for p in points], axis=0)
    return Box(low, float((high - low).max()))


def _packed_skin(packed: Packed, box: Box, skin: ShownSkin) -> dict[str, Any]:
    pattern = skin.pattern
    kind = index_type(len(pattern.points))
    edges = pattern.sewn[pattern.seams[:, 0]]
    found: dict[str, Any] = {
        "vertices": len(pattern.points),
        "closed": len(pattern.free_edges) == 0,
        "triangles": packed.add(pattern.triangles.astype(kind)),
        "seams": packed.add(np.concatenate([edges, pattern.free_edges]).astype(kind)),
    }
    if skin.target is not None:
        found["target"] = packed.add(box.rounded(skin.target))
    if skin.regions is not None:
        found["print"] = _packed_print(packed, cut_triangles(pattern, skin.regions))
        found["border"] = _packed_border(packed, pattern, skin.regions)
    if skin.body is not None:
        points, triangles = skin.body
        found["body"] = {
            "points": packed.add(box.rounded(points)),
            "triangles": packed.add(triangles.astype(index_type(len(points)))),
        }
    return found


def _packed_print(packed: Packed, cut: CutTriangles) -> dict[str, Any]:
    """Return the polygons that cut triangles are made of: rings of corners, by their weights.

    A ring's last corner, which is its first, is left out.
    """
    polygon, first = cut.polygon, cut.first
    last = np.zeros(len(cut.weights), dtype=bool)
    last[first[1:] - 1] = True
    weights = np.round(cut.weights * STEPS).clip(0, STEPS).astype(np.uint16)
    counts = np.diff(first) - 1
    return {
        "cells": packed.add(cut.cell.astype(np.uint32)),
        "inside": packed.add(cut.inside.astype(np.uint8)),
        "polygons": packed.add(polygon.astype(np.uint32)),
        "counts": packed.add(counts.astype(np.uint32)),
        "weights": packed.add(weights[~last, 1:].T),
    }


def _packed_border(
    packed: Packed, pattern: Pattern, regions: Sequence[BaseGeometry]
) -> dict[str, Any]:
    """Return the borders of the print: pieces of lines, each in one triangle."""
    cells: list[Ints] = [np.zeros(0, dtype=np.int64)]
    weights: list[Floats] = [np.zeros((0, 2, 3))]
    for panel, region in enumerate(regions):
        here = np.flatnonzero(pattern.panel == panel)
        found, places = _border(region, pattern.corners[here])
        cells.append(here[found])
        weights.append(places)
    every = np.round(np.concatenate(weights) * STEPS).clip(0, STEPS).astype(np.uint16)
    return {
        "cells": packed.add(np.concatenate(cells).astype(np.uint32)),
        "weights": packed.add(every[..., 1:].reshape(-1, 2).T),
    }


def _border(region: BaseGeometry, corners: Floats) -> tuple[Ints, Floats]:
    """Return the parts of a region's border inside of triangles, but those along their edges.

    Args:
        region: The region.
        corners: Corners of the triangles, (t, 3, 2).

    Returns:
        The triangle of each part, (k,), and the barycentric coordinates of its ends, (k, 2, 3).
    """
    rings, _ = shapely.get_rings(shapely.get_parts(region), return_index=True)
    points = [shapely.get_coordinates(ring) for ring in rings]
    if not points:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 2, 3))
    ends = np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in points])
    segments, triangles = shapely.linestrings(ends), shapely.polygons(corners)
    triangle, segment = shapely.STRtree(segments).query(triangles, predicate="intersects")
    parts = shapely.intersection(segments[segment], triangles[triangle])
    lines = (shapely.get_type_id(parts) == shapely.GeometryType.LINESTRING) & (
        shapely.get_num_coordinates(parts) == 2
    )
    triangle, parts = triangle[lines], parts[lines]
    ends = shapely.get_coordinates(parts).reshape(-1, 2, 2)
    a, b, c = np.moveaxis(corners[triangle], 1, 0)
    inverse = np.linalg.inv(np.stack([b - a, c - a], axis=2))
    two = np.einsum("kij,kej->kei", inverse, ends - a[:, None])
    weights = np.concatenate([1 - two.sum(axis=2, keepdims=True), two], axis=2)
    along = (weights < ON_EDGE).all(axis=1).any(axis=1)
    return triangle[~along], weights[~along]


def _packed_series(
    packed: Packed,
    box: Box,
    frames: Sequence[Frame],
    shapes: Sequence[Floats],
    skins: Mapping[str, ShownSkin],
) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = [
        {
            "skin": frame.skin,
            "number": frame.number,
            "values": {k: v for k, v in frame.values.items() if np.isfinite(v)},
            "note": frame.note,
        }
        for frame in frames
    ]
    for name in dict.fromkeys(frame.skin for frame in frames):
        here = [k for k, frame in enumerate(frames) if frame.skin == name]
        positions = packed.add_changes([box.rounded(shapes[k]) for k in here])
        stretches = [principal_stretches(skins[name].pattern, shapes[k])[:, 1] for k in here]
        scaled = [_as_byte(s, LEAST_STRETCH, MOST_STRETCH) for s in stretches]
        large = packed.add_changes(scaled)
        for k, place, stretch, largest in zip(here, positions, large, stretches, strict=True):
            found[k] |= {
                "positions": place,
                "stretch": stretch,
                "stretch_range": [float(largest.min()), float(largest.max())],
            }
        dense = [k for k in here if frames[k].density is not None]
        if dense:
            values = [_as_byte(frames[k].density, 0.0, 1.0) for k in dense]
            for k, entry in zip(dense, packed.add_changes(values), strict=True):
                found[k]["density"] = entry
    return found


def _as_byte(values: Floats | None, low: float, high: float) -> np.ndarray:
    assert values is not None
    return np.round(255 * (values - low) / (high - low)).clip(0, 255).astype(np.uint8)
