"""Your own surface as a sewing pattern: read, repaired, cut, laid flat.

    python demos/unwrap.py my.stl --scale 1e-3
    python demos/unwrap.py my.msh --method lscm --max-stretch 0.1 --output output/my

The file is an STL, OBJ, PLY, MSH or XDMF triangle mesh. Line elements in it and the borders between
its groups of triangles become seams. Without them the seams are found: along creases, and wherever
a panel would be stretched too far. The demo prints how far the panels are from the surface. It
writes the pattern in true scale (pattern.svg), a picture (unwrap.png) and fields for ParaView
(surface.vtu). Without a file it unwraps a capsule.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from mpi4py import MPI

from toros_fem.command_line import run_from_command_line
from toros_fem.config import Config, quantity
from toros_fem.fabrication.svg import write_svg
from toros_fem.meshes import Surface, read_surface, unwrap
from toros_fem.meshes.chart import METHODS
from toros_fem.output.files import write_fields, write_json
from toros_fem.output.writer import if_plotting, write_together


@dataclass(frozen=True)
class UnwrapConfig(Config):
    """How a surface is read, cut and laid flat."""

    scale: float = quantity(1.0, "length of the file's unit", "m", above=0)
    component: int | None = quantity(
        None, "connected component, 0 for the largest; none: the file holds only one", at_least=0
    )
    seams: str = quantity(
        "given",
        "seams of the file, found if it has none, or always found",
        choices=("given", "auto"),
    )
    method: str = quantity("auto", "how panels are laid flat", choices=METHODS)
    crease_angle: float = quantity(
        45.0, "angle between normals above which a found seam follows an edge", "deg",
        above=0, at_most=180,
    )  # fmt: skip
    max_stretch: float | None = quantity(
        None, "largest stretch of a panel; none: 0.15 with found seams, no bound with given ones",
        above=0,
    )  # fmt: skip


def capsule(around: int = 36, radius: float = 0.02, length: float = 0.06) -> Surface:
    """Return a closed tube along z with round ends."""
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


def run(
    comm: MPI.Comm,
    output: Path,
    config: UnwrapConfig,
    *,
    file: Path | None = None,
    verbose: bool = False,
) -> dict[str, Any]:
    """Unwrap a surface, and return the summary that is also written to `output`.

    Args:
        comm: Communicator.
        output: Folder for pattern, picture, fields and summary.
        config: How the surface is read, cut and laid flat.
        file: The mesh file; None takes a capsule.
        verbose: Whether to print the distortion of each panel.
    """
    surface = (
        capsule() if file is None else read_surface(comm, file, config.scale, config.component)
    )
    unwrapped = unwrap(
        comm,
        surface,
        "auto" if config.seams == "auto" else None,
        config.method,
        crease_angle=np.radians(config.crease_angle),
        max_stretch=config.max_stretch,
    )
    distortion, pattern = unwrapped.distortion, unwrapped.pattern
    summary = {
        "file": None if file is None else file.name,
        "triangles": len(surface.triangles),
        "closed": surface.closed,
        "area_m2": surface.area,
        "repairs": str(surface.repairs),
        "panels": dict(zip(pattern.panel_names, unwrapped.methods, strict=True)),
        "worst_stretch": distortion.worst_stretch,
        "mean_stretch": distortion.mean_stretch,
        "worst_seam": distortion.worst_seam,
        "inputs": config.as_dict(),
    }

    def write() -> None:
        output.mkdir(parents=True, exist_ok=True)
        if verbose:
            print(distortion.table())
        write_svg(output / "pattern.svg", pattern, [shapely.Polygon()] * len(unwrapped.methods))

        def draw() -> None:
            from toros_fem.output.surface_plot import plot_unwrapped

            plot_unwrapped(output / "unwrap.png", unwrapped)

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


def sentence(summary: dict[str, Any]) -> str:
    """Return the result in a sentence."""
    return (
        f"{summary['triangles']} triangles (repairs: {summary['repairs']}) in "
        f"{len(summary['panels'])} panels: stretch {summary['worst_stretch']:.2%} at most, "
        f"{summary['mean_stretch']:.2%} in the mean, lengths at a seam within "
        f"{summary['worst_seam']:.2%}"
    )


def main(comm: MPI.Comm) -> int:
    """Run with the values that the command line gives; return the exit code."""
    return run_from_command_line(
        comm,
        __doc__ or "",
        UnwrapConfig(),
        run,
        Path("output/unwrap"),
        sentence=sentence,
        arguments={"file": "triangle mesh; none: a capsule"},
    )


if __name__ == "__main__":
    sys.exit(main(MPI.COMM_WORLD))
