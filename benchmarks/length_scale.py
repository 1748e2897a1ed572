"""What the length-scale constraints see of straight lines, over c, resolution and alignment.

    python benchmarks/length_scale.py --quick
    python benchmarks/length_scale.py --json lines.json

One straight line after the other is laid on an unstructured sheet, at many angles and places; its
projected width is a given share of the width asked for. Printed is g_r times area, over length
and R: what a line's unit length adds, least and largest over all alignments. A constraint is sound
where the least of a line that is too thin stays far above the largest of one that is wide enough,
and depends on the mesh's alignment where the two values of the thin line differ by much.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.density.bar_width import unfiltered_width
from toros_fem.density.filters import make_filter
from toros_fem.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.density.neighbours import mean_edge
from toros_fem.density.projection import Projection
from toros_fem.meshes import cylinder, sew

SHARES = (0.7, 0.85, 1.15, 2.5)


def study(name: str, ratio: float, decays: list[float], alignments: int) -> list[dict[str, Any]]:
    """Least and largest g_r A/(length R) over alignments, for one resolution R/h."""
    radius = 2.4e-3
    reach = 4 * radius  # half the length of line that counts
    side = 2 * (reach + 2 * radius)
    pattern = cylinder(MPI.COMM_SELF, side, side / np.pi, radius / ratio, caps=False)
    skin = sew(MPI.COMM_SELF, pattern)
    edge = mean_edge(skin)
    points = pattern.centroids[skin.owned_cells] - pattern.flat_points.mean(axis=0)
    inside = np.linalg.norm(points, axis=1) < reach
    area = float(pattern.areas[skin.owned_cells][inside].sum())
    flat = make_filter(name, skin, radius)
    constraints = {
        decay: LengthScaleConstraints(skin, flat, LengthScale(decay=decay * radius**2), inside)
        for decay in decays
    }
    rng = np.random.default_rng(0)
    found: dict[tuple[float, float], list[float]] = {}
    halves = {share: unfiltered_width(name, share) * radius / 2 for share in SHARES}
    for angle in np.linspace(0, np.pi, alignments, endpoint=False):
        normal = np.array([np.cos(angle), np.sin(angle)])
        across = np.abs(points @ normal - rng.uniform(-0.5, 0.5) * edge)
        for share in SHARES:
            raw = np.clip(0.5 + (halves[share] - across) / edge, 0, 1)
            filtered = flat.forward(raw)
            projected = Projection(20.0).forward(filtered)
            for decay, limits in constraints.items():
                value = limits.forward(raw, filtered, projected)[0] * area / (2 * reach * radius)
                found.setdefault((decay, share), []).append(float(value))
    return [
        {
            "filter": name,
            "radius_over_edge": ratio,
            "c_over_R2": decay,
            "c_h2_over_R4": decay / ratio**2,
            "width_over_asked": share,
            "least": min(values),
            "largest": max(values),
        }
        for (decay, share), values in found.items()
    ]


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="fewer resolutions and alignments")
    parser.add_argument("--json", type=Path, help="file for the rows")
    options = parser.parse_args()
    ratios = [1.5, 3.0] if options.quick else [1.5, 2.0, 3.0, 4.0, 6.0]
    rows = []
    print("g_r A/(length R), least … largest over alignments; widths over the width asked for")
    print("filter     R/h  c/R²  c h²/R⁴  " + "".join(f"{share:^22g}" for share in SHARES))
    for name in ("cone", "helmholtz"):
        for ratio in ratios:
            decays = [ratio**2 * factor for factor in (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)]
            part = study(name, ratio, decays, 3 if options.quick else 18)
            rows += part
            for decay in decays:
                line = [row for row in part if row["c_over_R2"] == decay]
                cells = "".join(f"{r['least']:10.1e} …{r['largest']:8.1e}  " for r in line)
                print(f"{name:9s} {ratio:4g} {decay:5.1f} {decay / ratio**2:8.1f}  {cells}")
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
