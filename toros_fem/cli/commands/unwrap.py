"""`toros unwrap`: a surface becomes a sewing pattern that scenes read."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from mpi4py import MPI

from toros_fem.base.files import write_json, write_together
from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.scripts import add_options, given_config
from toros_fem.making.panels.svg import write_svg
from toros_fem.meshes.pattern_file import NAME, write_pattern
from toros_fem.meshes.surface import Surface
from toros_fem.products.tables.unwrapping import Unwrapping
from toros_fem.results.files import write_fields
from toros_fem.results.writer import if_plotting


def unwrap_surface(
    comm: MPI.Comm,
    output: Path,
    surface: Surface,
    config: Unwrapping,
    *,
    file: Path | None = None,
    verbose: bool = False,
) -> dict[str, Any]:
    """Unwrap a surface, write pattern, drawing, picture and fields, and return the summary.

    The files are pattern.npz, which `read_pattern` and scenes read, pattern.svg, unwrap.png,
    surface.vtu and summary.json.

    Args:
        comm: Communicator (collective).
        output: Folder, made if missing.
        surface: The surface.
        config: How it is cut and laid flat.
        file: Where it was read, for the summary; None for nowhere.
        verbose: Whether to print the distortion of each panel.

    Raises:
        SurfaceError: A region cannot be laid flat by the requested method.
        OutputError: A file cannot be written; on all ranks.
    """
    unwrapped = config.unwrapped(comm, surface)
    distortion, pattern = unwrapped.distortion, unwrapped.pattern
    summary = {
        "file": None if file is None else file.name,
        "triangles": len(surface.triangles),
        "size_m": float(np.ptp(surface.points, axis=0).max()),
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
        if verbose:
            print(distortion.table())
        write_pattern(output / NAME, pattern)
        write_svg(output / "pattern.svg", pattern, [shapely.Polygon()] * len(unwrapped.methods))

        def draw() -> None:
            from toros_fem.results.pictures.surface_plot import plot_unwrapped

            plot_unwrapped(output / "unwrap.png", unwrapped)

        if_plotting(draw)
        stretches = {
            "area_ratio": distortion.area_ratio,
            "stretch": distortion.strain,
            "angle_error": distortion.angle_error,
        }
        write_fields(output / "surface.vtu", pattern, pattern.points, stretches)
        write_json(output / "summary.json", summary)

    write_together(comm, output, write)
    return summary


def unwrap_sentence(summary: dict[str, Any]) -> str:
    """Return the result in a sentence."""
    return (
        f"{summary['triangles']} triangles, {1e3 * summary['size_m']:.4g} mm across (repairs: "
        f"{summary['repairs']}), in {len(summary['panels'])} panels: stretch "
        f"{summary['worst_stretch']:.2%} at most, {summary['mean_stretch']:.2%} in the mean, "
        "lengths at a seam within "
        f"{summary['worst_seam']:.2%}"
    )


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "mesh", type=Path, metavar="MESH", help="STL, OBJ, PLY, MSH or XDMF triangle mesh"
    )
    parser.add_argument(
        "--output",
        type=Path,
        default=None,
        metavar="FOLDER",
        help="folder for the pattern, made if missing; default the name of MESH without ending",
    )
    parser.add_argument(
        "--verbose",
        action="store_true",
        help="print the distortion of each panel; default no",
    )
    add_options(parser, Unwrapping())


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    config = given_config(given, Unwrapping())
    output = given.output or Path(given.mesh.stem)
    surface = config.surface(comm, given.mesh)
    summary = unwrap_surface(comm, output, surface, config, file=given.mesh, verbose=given.verbose)
    figures = {"pattern": output / NAME, **summary}
    return Answer(f"{unwrap_sentence(summary)}; see {output / NAME}", figures)


COMMAND = Command(
    "The surface is repaired and cut. Line elements in the file and the borders between its\n"
    "groups of triangles become seams. Without them the seams are found: along creases, and\n"
    "wherever a panel would be stretched too far. The folder gets pattern.npz, which scenes\n"
    "read, pattern.svg in true scale, unwrap.png, surface.vtu and summary.json.",
    (
        "toros unwrap finger.stl",
        "toros unwrap finger.msh --method lscm --max-stretch 0.1 --output finger-flat",
    ),
    _options,
    _run,
)
