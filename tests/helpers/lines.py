"""Fields of line families, and where their lines lie on the skin."""

from collections.abc import Sequence

import numpy as np
import shapely
from mpi4py import MPI

from toros_fem.design.lines.centre_lines import CentreLine
from toros_fem.design.lines.field import LineField, LineMesh
from toros_fem.design.lines.laid_lines import LaidLines
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.sheets import rectangle


def even_field(pattern: Pattern, shares: Sequence[float], degrees: Sequence[float]) -> LineField:
    """The same shares and directions everywhere, in the charts of all panels."""
    ones = np.ones((len(pattern.panel), 1))
    return LineField(pattern, ones * shares, ones * np.radians(degrees))


def turned_halves(degrees: float) -> Pattern:
    """A sheet of two panels; the chart of the second is turned and moved."""
    sheet = rectangle(MPI.COMM_SELF, 0.04, 0.03, 2e-3, "unstructured")
    right = sheet.centroids[:, 0] > 0.02
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    flat: list[np.ndarray] = []
    triangles, sewn = [], []
    for side in (False, True):
        used, corner = np.unique(sheet.flat_triangles[right == side], return_inverse=True)
        own = sheet.flat_points[used]
        triangles.append(corner.reshape(-1, 3) + sum(len(points) for points in flat))
        flat.append(own @ turn.T + [0.1, 0.2] if side else own)
        sewn.append(used)
    return Pattern(
        np.concatenate(flat),
        np.concatenate(triangles),
        np.repeat([0, 1], [len(t) for t in triangles]),
        np.concatenate(sewn),
        sheet.points,
        ("left", "right"),
    )


def positions(mesh: LineMesh, line: CentreLine) -> np.ndarray:
    """Start and end of each segment of a line on the assembled skin, (m, 2, 3)."""
    pattern, cell = mesh.pattern, mesh.cells[line.cell]
    corners = pattern.corners[cell]
    frame = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    at = np.linalg.solve(frame[:, None], (line.points - corners[:, :1])[..., None])[..., 0]
    weight = np.concatenate([1 - at.sum(axis=2, keepdims=True), at], axis=2)
    return np.einsum("mec,mcx->mex", weight, pattern.points[pattern.triangles[cell]])


def largest_jump(laid: LaidLines) -> float:
    """Largest distance on the skin from the end of a segment to the start of the next, in m."""
    jumps = [0.0]
    for line in (line for family in laid.families for line in family.lines):
        at = positions(laid.mesh, line)
        after, before = at[1:, 0], at[:-1, 1]
        if line.closed:
            after, before = at[:, 0], np.roll(at[:, 1], 1, axis=0)
        jumps += np.linalg.norm(after - before, axis=1).tolist()
    return max(jumps)


def distance_to_others(laid: LaidLines, line: CentreLine, side: int) -> float:
    """Distance in m from an end of a line to the other lines on its panel, or to its own rest."""
    panels, k = laid.pattern.panel[laid.mesh.cells], 0 if side == 0 else -1
    panel = panels[line.cell[k]]
    own = line.points[20:] if side == 0 else line.points[:-20]
    cells = line.cell[20:] if side == 0 else line.cell[:-20]
    segments = [own[panels[cells] == panel]]
    for other in (other for family in laid.families for other in family.lines):
        if other is not line:
            segments.append(other.points[panels[other.cell] == panel])
    rest = shapely.multilinestrings(shapely.linestrings(np.concatenate(segments)))
    return float(shapely.Point(line.points[k, side]).distance(rest))


def seam_difference(laid: LaidLines, only: int | None = None) -> tuple[float, float]:
    """Length of the seams that is printed on one side alone, and on the first side, in m.

    Args:
        laid: The lines.
        only: A panel: seams with others do not count.
    """
    pattern = laid.pattern
    panel = np.zeros(len(pattern.flat_points), dtype=int)
    panel[pattern.flat_triangles] = pattern.panel[:, None]
    regions = [region.buffer(1e-8) for region in laid.regions]
    apart = whole = 0.0
    for seam in pattern.seams:
        if only is not None and np.any(panel[seam] != only):
            continue
        sides = []
        for ends in seam:
            a, b = pattern.flat_points[ends]
            cut = shapely.intersection(shapely.LineString([a, b]), regions[panel[ends[0]]])
            away = [
                sorted(float(np.linalg.norm(np.array(xy) - a)) for xy in part.coords)
                for part in shapely.get_parts(cut)
                if part.geom_type == "LineString" and not part.is_empty
            ]
            lines = [shapely.LineString([(x[0], 0), (x[-1], 0)]) for x in away]
            sides.append(shapely.union_all(lines) if lines else shapely.LineString())
        apart += shapely.symmetric_difference(*sides).length
        whole += sides[0].length
    return apart, whole
