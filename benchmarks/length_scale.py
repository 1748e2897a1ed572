"""Length-scale constraints and perimeter on straight lines: our defaults and the paper's constants.

    python benchmarks/length_scale.py --quick
    python benchmarks/length_scale.py --json lines.json

1. Widths. Straight lines are laid on an unstructured sheet at many angles and places; their
projected width is a given fraction of the requested width. The table lists g_r times area, over
length and R: the contribution of a line's unit length, smallest and largest over all alignments. A
constraint is sound where the smallest value of a line that is too thin is far above the largest
value of one that is wide enough. It depends on the mesh where the two values of a thin line differ
by much.

2. The paper's constants. The same lines under the default parameters and under
`LengthScale.paper`: g_r itself over its bound ε for one line across the sheet. A line is detected
where this exceeds 1.

3. Perimeter. Stripes on a periodic tile whose border has a known length, on finer and finer meshes:
our perimeter over that length, and the paper's sum over triangles without weights.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Bools, Floats
from toros_fem.design.density.bar_width import unfiltered_width
from toros_fem.design.density.filters import Filter, make_filter
from toros_fem.design.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.design.density.neighbours import mean_edge
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.density.projection import Projection
from toros_fem.meshes import Skin, cylinder, sew, tile

FRACTIONS = (0.7, 0.85, 1.15, 2.5)
RADIUS = 2.4e-3
PAPERS_W = 0.5  # of eq. (15)
REACH = 4 * RADIUS  # half the length of line that counts
TILE = 0.02


@dataclass(frozen=True)
class Sheet:
    """A sheet for straight lines at a resolution R/h.

    Attributes:
        skin: The sheet.
        filter: Its filter.
        edge: Mean edge length in m.
        points: Centroids from the sheet's centre in m.
        inside: Whether a triangle counts.
        area: Area of those that count, in m².
    """

    skin: Skin
    filter: Filter
    edge: float
    points: Floats
    inside: Bools
    area: float

    @classmethod
    def of(cls, name: str, ratio: float) -> Sheet:
        """Make the sheet for a filter and R/h."""
        side = 2 * (REACH + 2 * RADIUS)
        pattern = cylinder(MPI.COMM_SELF, side, side / np.pi, RADIUS / ratio, caps=None)
        skin = sew(MPI.COMM_SELF, pattern)
        points = pattern.centroids[skin.owned_cells] - pattern.flat_points.mean(axis=0)
        inside = np.linalg.norm(points, axis=1) < REACH
        area = float(pattern.areas[skin.owned_cells][inside].sum())
        return cls(skin, make_filter(name, skin, RADIUS), mean_edge(skin), points, inside, area)

    def lines(self, alignments: int) -> Iterator[tuple[float, Floats]]:
        """Yield the width of each line over the requested one, R, and its design density."""
        rng = np.random.default_rng(0)
        name = self.filter.name
        halves = {f: unfiltered_width(name, f) * RADIUS / 2 for f in FRACTIONS}
        for angle in np.linspace(0, np.pi, alignments, endpoint=False):
            normal = np.array([np.cos(angle), np.sin(angle)])
            across = np.abs(self.points @ normal - rng.uniform(-0.5, 0.5) * self.edge)
            for fraction, half in halves.items():
                yield fraction, np.clip(0.5 + (half - across) / self.edge, 0, 1)


def widths(name: str, ratio: float, decays: list[float], alignments: int) -> list[dict[str, Any]]:
    """Return least and largest g_r A/(length R) over alignments, for one resolution R/h."""
    sheet = Sheet.of(name, ratio)
    constraints = {
        decay: LengthScaleConstraints(
            sheet.skin, sheet.filter, LengthScale(decay=decay * RADIUS**2), sheet.inside
        )
        for decay in decays
    }
    found: dict[tuple[float, float], list[float]] = {}
    for fraction, density in sheet.lines(alignments):
        filtered = sheet.filter.forward(density)
        projected = Projection().forward(filtered)
        for decay, limits in constraints.items():
            value = limits.forward(density, filtered, projected)[0]
            value *= sheet.area / (2 * REACH * RADIUS)
            found.setdefault((decay, fraction), []).append(float(value))
    return [
        {
            "study": "widths",
            "filter": name,
            "radius_over_edge": ratio,
            "c_over_R2": decay,
            "c_h2_over_R4": decay / ratio**2,
            "width_over_requested": fraction,
            "least": min(values),
            "largest": max(values),
        }
        for (decay, fraction), values in found.items()
    ]


def constants(ratio: float, alignments: int) -> list[dict[str, Any]]:
    """Return least and largest g_r/ε of a line under our defaults and the paper's constants."""
    sheet = Sheet.of("cone", ratio)
    sets = {"default": LengthScale(), "paper": LengthScale.paper(sheet.skin)}
    constraints = {
        key: LengthScaleConstraints(sheet.skin, sheet.filter, parameters, sheet.inside)
        for key, parameters in sets.items()
    }
    found: dict[tuple[str, float], list[float]] = {}
    for fraction, density in sheet.lines(alignments):
        filtered = sheet.filter.forward(density)
        projected = Projection().forward(filtered)
        for key, limits in constraints.items():
            value = limits.forward(density, filtered, projected)[0] / limits.epsilon[0]
            found.setdefault((key, fraction), []).append(float(value))
    return [
        {
            "study": "constants",
            "constants": key,
            "radius_over_edge": ratio,
            "width_over_requested": fraction,
            "c_over_R2": constraints[key].decay / RADIUS**2,
            "epsilon": float(constraints[key].epsilon[0]),
            "least": min(values),
            "largest": max(values),
        }
        for (key, fraction), values in found.items()
    ]


def perimeters(edges: list[int]) -> list[dict[str, Any]]:
    """Return our perimeter and the paper's sum for slanting stripes on a tile, mesh by mesh."""
    rows = []
    length = 2 * np.sqrt(5) * TILE
    for number in edges:
        pattern = tile(MPI.COMM_SELF, (TILE, TILE), TILE / number)
        skin = sew(MPI.COMM_SELF, pattern.pattern)
        u, v = skin.pattern.centroids[skin.owned_cells].T
        stripes = ((u + 2 * v) % TILE < 0.45 * TILE).astype(float)
        window, lattice = 0.07 * TILE, pattern.lattice
        ours = Perimeter(skin, window, PAPERS_W, lattice=lattice).forward(stripes)
        papers = Perimeter(skin, window, PAPERS_W, lattice=lattice, area_weighted=False)
        rows.append(
            {
                "study": "perimeter",
                "triangles": len(stripes),
                "ratio_to_length": ours / length,
                "papers_sum": papers.forward(stripes),
            }
        )
    return rows


def main() -> None:
    """Run the studies and print their tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="fewer resolutions and alignments")
    parser.add_argument("--json", type=Path, help="file for the rows")
    options = parser.parse_args()
    ratios = [1.5, 3.0] if options.quick else [1.5, 2.0, 3.0, 4.0, 6.0]
    alignments = 3 if options.quick else 18
    rows: list[dict[str, Any]] = []

    def show(label: str, line: list[dict[str, Any]]) -> None:
        cells = "".join(f"{row['least']:10.1e} …{row['largest']:8.1e}  " for row in line)
        print(f"{label}  {cells}", flush=True)

    header = "".join(f"{fraction:^22g}" for fraction in FRACTIONS)
    print("g_r A/(length R), least … largest over alignments, by width over the requested one")
    print(f"filter     R/h  c/R²  c h²/R⁴  {header}")
    for name in ("cone", "helmholtz"):
        for ratio in ratios:
            decays = [ratio**2 * factor for factor in (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)]
            part = widths(name, ratio, decays, alignments)
            rows += part
            for decay in decays:
                label = f"{name:9s} {ratio:4g} {decay:5.1f} {decay / ratio**2:8.1f}"
                show(label, [row for row in part if row["c_over_R2"] == decay])
    print("\ng_r/ε of one line across the sheet, cone filter")
    print(f"constants  R/h  c/R²        ε  {header}")
    for ratio in ratios:
        part = constants(ratio, alignments)
        rows += part
        for key in ("default", "paper"):
            line = [row for row in part if row["constants"] == key]
            first = line[0]
            show(f"{key:9s} {ratio:4g} {first['c_over_R2']:5.1f} {first['epsilon']:8.1e}", line)
    print("\nperimeter of stripes on a tile, w = 0.5")
    print("triangles  ours over the length  the paper's sum")
    for row in perimeters([20, 40, 80]):
        print(f"{row['triangles']:9d}  {row['ratio_to_length']:20.3f}  {row['papers_sum']:15.1f}")
        rows.append(row)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
