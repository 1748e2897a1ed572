"""`toros unwrap`: a surface becomes a sewing pattern that scenes read."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import shapely
from mpi4py import MPI

from toros_fem.base.files import write_json, write_together
from toros_fem.base.keys import In, Length, Number, OneOf, Positive, Table, key
from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.scripts import add_options, given_config
from toros_fem.making.panels.svg import write_svg
from toros_fem.meshes.chart import METHODS
from toros_fem.meshes.pattern_file import NAME, write_pattern
from toros_fem.meshes.surface import Surface
from toros_fem.meshes.surface_file import read_surface
from toros_fem.meshes.unwrap import unwrap
from toros_fem.results.files import write_fields
from toros_fem.results.writer import if_plotting


@dataclass(frozen=True)
class UnwrapConfig(Table):
    """How a surface is read, cut and laid flat."""

    scale: Length = key(1.0, "length of the file's unit")
    component: Number | None = key(
        None, "connected component, 0 for the largest; none: the file holds only one"
    )
    seams: Annotated[str, OneOf(("given", "auto"))] = key(
        "given", "seams of the file, found if it has none, or always found"
    )
    method: Annotated[str, OneOf(METHODS)] = key("auto", "how panels are laid flat")
    crease_angle: Annotated[float, In("deg", above=0, at_most=180)] = key(
        45.0, "angle between normals above which a found seam follows an edge"
    )
    max_stretch: Positive | None = key(
        None, "largest stretch of a panel; none: 0.15 with found seams, no bound with given ones"
    )


def unwrap_surface(
    comm: MPI.Comm,
    output: Path,
    surface: Surface,
    config: UnwrapConfig,
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
    unwrapped = unwrap(
        comm,
        surface,
        "auto" if config.seams == "auto" else None,
        config.method,
        crease_angle=float(np.radians(config.crease_angle)),
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
        f"{summary['triangles']} triangles (repairs: {summary['repairs']}) in "
        f"{len(summary['panels'])} panels: stretch {summary['worst_stretch']:.2%} at most, "
        f"{summary['mean_stretch']:.2%} in the mean, lengths at a seam within "
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
    add_options(parser, UnwrapConfig())


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    config = given_config(given, UnwrapConfig())
    output = given.output or Path(given.mesh.stem)
    surface = read_surface(comm, given.mesh, config.scale, config.component)
    summary = unwrap_surface(comm, output, surface, config, file=given.mesh, verbose=given.verbose)
    figures = {"pattern": output / NAME, **summary}
    return Answer(f"{unwrap_sentence(summary)}; see {output / NAME}", figures)


COMMAND = Command(
    "The surface is repaired and cut. Line elements in the file and the borders between its\n"
    "groups of triangles become seams. Without them the seams are found: along creases, and\n"
    "wherever a panel would be stretched too far. The folder gets pattern.npz, which scenes\n"
    "read, pattern.svg in true scale, unwrap.png, surface.vtu and summary.json.",
    (
        "toros unwrap finger.stl --scale 1e-3",
        "toros unwrap finger.msh --method lscm --max-stretch 0.1 --output finger-flat",
    ),
    _options,
    _run,
)
