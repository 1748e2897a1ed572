"""Your own surface as a sewing pattern: read, mended, cut, laid flat.

    python demos/unwrap.py my.stl --scale 1e-3
    python demos/unwrap.py my.msh --method lscm --max-stretch 0.1 --output output/my

The file is an STL, OBJ, PLY, MSH or XDMF triangle mesh. Line elements in it and the borders between
its groups of triangles become seams; without them the seams are found: along creases, and wherever
a panel would be stretched too far. Prints how far the panels are from the surface, and writes the
pattern true to scale (pattern.svg), a picture (unwrap.png) and fields for ParaView (surface.vtu).
Without a file it unwraps a capsule.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from mpi4py import MPI

from toros_fem.command_line import parsed, run_guarded
from toros_fem.fabrication.svg import write_svg
from toros_fem.meshes import Surface, read_surface, unwrap
from toros_fem.output.files import write_fields, write_json
from toros_fem.output.reporter import if_plotting, write_together

DEFAULTS: dict[str, Any] = {
    "scale": 1.0,  # m a unit of the file
    "component": -1,  # which connected component, 0 the largest; -1 asks for a single one
    "seams": "given",  # or "auto": what the file says of seams is passed over
    "method": "auto",
    "crease_angle": 45.0,  # degrees
    "max_stretch": 0.0,  # 0: 0.15 with automatic seams, no bound with given ones
}


def capsule(around: int = 36, radius: float = 0.02, length: float = 0.06) -> Surface:
    """A tube along z with round ends, closed."""
    quarter = np.linspace(0, np.pi / 2, around // 4 + 1)[1:]
    rows = round(length / (2 * np.pi * radius / around))
    r = radius * np.concatenate([np.sin(quarter), np.ones(rows - 1), np.sin(quarter[::-1])])
    z = np.concatenate([-radius * np.cos(quarter), length * np.arange(1, rows) / rows,
                        length + radius * np.cos(quarter[::-1])])  # fmt: skip
    turn = 2 * np.pi * np.arange(around) / around
    rings = np.stack([np.outer(r, np.cos(turn)), np.outer(r, np.sin(turn)),
                      np.repeat(z[:, None], around, axis=1)], axis=2)  # fmt: skip
    count = len(r) * around
    node = np.arange(count).reshape(-1, around)
    a, b = node[:-1], np.roll(node[:-1], -1, axis=1)
    c, d = node[1:], np.roll(node[1:], -1, axis=1)
    first, last = node[0], node[-1]
    triangles = np.concatenate([
        np.stack([a, b, c], axis=2).reshape(-1, 3), np.stack([b, d, c], axis=2).reshape(-1, 3),
        np.stack([np.roll(first, -1), first, np.full(around, count)], axis=1),
        np.stack([last, np.roll(last, -1), np.full(around, count + 1)], axis=1),
    ])  # fmt: skip
    poles = [[0, 0, -radius], [0, 0, length + radius]]
    return Surface(np.vstack([rings.reshape(-1, 3), poles]), triangles)


def run(comm: MPI.Comm, output: Path, *, file: Path | None = None, **inputs: Any) -> dict[str, Any]:
    """Unwrap a surface; returns the summary that is also written to `output`.

    Args:
        comm: Communicator.
        output: Folder for pattern, picture, fields and summary.
        file: The mesh file; None takes a capsule.
        inputs: What differs from `DEFAULTS`.
    """
    o = {**DEFAULTS, **inputs}
    component = None if o["component"] < 0 else o["component"]
    surface = capsule() if file is None else read_surface(comm, file, o["scale"], component)
    made = unwrap(
        comm,
        surface,
        None if o["seams"] == "given" else o["seams"],
        o["method"],
        crease_angle=np.radians(o["crease_angle"]),
        max_stretch=o["max_stretch"] or None,
    )
    distortion, pattern = made.distortion, made.pattern
    summary = {
        "file": None if file is None else file.name,
        "triangles": len(surface.triangles),
        "closed": surface.closed,
        "area_m2": surface.area,
        "repairs": str(surface.repairs),
        "panels": dict(zip(pattern.panel_names, made.methods, strict=True)),
        "worst_stretch": distortion.worst_stretch,
        "mean_stretch": distortion.mean_stretch,
        "worst_seam": distortion.worst_seam,
        "inputs": o,
    }

    def write() -> None:
        output.mkdir(parents=True, exist_ok=True)
        print(f"{len(surface.triangles)} triangles; repairs: {surface.repairs}")
        print(distortion.table())
        write_svg(output / "pattern.svg", pattern, [shapely.Polygon()] * len(made.methods))

        def draw() -> None:
            from toros_fem.output.surface_plot import plot_unwrapped

            plot_unwrapped(output / "unwrap.png", made)

        if_plotting(draw)
        fields = {
            "area_ratio": distortion.area_ratio,
            "stretch": distortion.strain,
            "angle_error": distortion.angle_error,
        }
        write_fields(output / "surface.vtu", pattern, pattern.points, fields)
        write_json(output / "summary.json", summary)

    write_together(comm, output, write)
    return summary


def main(comm: MPI.Comm) -> int:
    """Run with what the command line says; the exit code is returned."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path, nargs="?", help="triangle mesh; none: a capsule")
    folder = Path("output/unwrap")
    parser.add_argument("--output", type=Path, default=folder, help=f"folder, default {folder}")
    options = parsed(parser, DEFAULTS)
    file, output = options.pop("file", None), options.pop("output")

    def action() -> str:
        run(comm, output, file=file, **options)
        return f"see {output}/"

    return run_guarded(comm, action)


if __name__ == "__main__":
    sys.exit(main(MPI.COMM_WORLD))
