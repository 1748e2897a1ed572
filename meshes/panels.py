"""Panels from regions of a surface: divided until they lie flat, then merged where possible."""

from __future__ import annotations

import numpy as np

from toros_fem.base.array_types import Bools, Ints
from toros_fem.base.errors import SurfaceError
from toros_fem.meshes.chart import Chart, ChartError, lay_flat
from toros_fem.meshes.regions import halves
from toros_fem.meshes.surface import Surface
from toros_fem.meshes.triangles import Edges, between, connected_regions, edges_of, lengths, normals

Panels = list[tuple[Ints, Chart]]
"""Triangles of the surface in each panel, and the panel laid flat."""


def flat_panels(
    surface: Surface, edges: Edges, cuts: Bools, method: str, max_stretch: float, *, tips: bool
) -> Panels:
    """Lay the regions between cuts flat; divide those that cannot be laid flat as one panel.

    Args:
        surface: The surface.
        edges: Its edges.
        cuts: Edges that are always cut, (e,).
        method, max_stretch, tips: As in `lay_flat`.

    Raises:
        SurfaceError: The method is "exact", but a region is not developable.
    """
    region = connected_regions(edges, edges.inner[~cuts[edges.inner]])
    waiting = [np.flatnonzero(region == k) for k in range(region.max() + 1)][::-1]
    panels: Panels = []
    divided = False

    def flat(cells: Ints) -> Chart:
        sides = cuts[edges.of_triangle[cells]]
        return lay_flat(surface.points, surface.triangles[cells], sides, method, max_stretch, tips)

    while waiting:
        cells = waiting.pop()
        try:
            panels.append((cells, flat(cells)))
        except ChartError as error:
            if len(cells) < 2:
                raise SurfaceError(f"triangle {cells[0]} cannot be laid flat: {error}") from error
            waiting += _divided(surface, edges, cuts, cells)
            divided = True
    refused: set[bytes] = set()
    while divided:
        for one, two in _neighbours(surface, edges, cuts, panels):
            cells = np.sort(np.concatenate([panels[one][0], panels[two][0]]))
            key = cells.tobytes()
            if key in refused:
                continue
            try:
                chart = flat(cells)
            except ChartError:
                refused.add(key)
                continue
            panels = [panel for k, panel in enumerate(panels) if k not in (one, two)]
            panels.append((cells, chart))
            break
        else:
            break
    return sorted(panels, key=lambda panel: (int(surface.parts[panel[0][0]]), int(panel[0][0])))


def _divided(surface: Surface, edges: Edges, cuts: Bools, cells: Ints) -> list[Ints]:
    """Divide a region in two; return the triangles of each connected part."""
    triangles = surface.triangles[cells]
    side = halves(surface.points, triangles)
    local = edges_of(triangles)
    whole = np.ones(len(local.ends), dtype=bool)
    whole[local.of_triangle[cuts[edges.of_triangle[cells]]]] = False
    label = connected_regions(
        local, np.flatnonzero(whole & (local.count == 2) & ~between(local, side))
    )
    return [cells[label == k] for k in range(label.max(), -1, -1)]


def _neighbours(
    surface: Surface, edges: Edges, cuts: Bools, panels: Panels
) -> list[tuple[int, int]]:
    """Return pairs of panels that meet at an edge outside `cuts`, the most compact pair first."""
    label = np.zeros(len(surface.triangles), dtype=np.int64)
    for number, (cells, _) in enumerate(panels):
        label[cells] = number
    area = np.bincount(label, np.linalg.norm(normals(surface.points, surface.triangles), axis=1))
    meeting = between(edges, label) & ~cuts
    pair, group = np.unique(
        np.sort(label[edges.sides[meeting]], axis=1), axis=0, return_inverse=True
    )
    shared = np.bincount(group.ravel(), lengths(surface.points, edges.ends[meeting]))
    order = np.argsort(area[pair].sum(axis=1) / np.maximum(shared, 1e-300) ** 2, kind="stable")
    return [(int(one), int(two)) for one, two in pair[order]]
