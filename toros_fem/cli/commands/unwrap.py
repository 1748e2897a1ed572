"""`toros unwrap`: a surface becomes a sewing pattern that scenes read."""

from __future__ import annotations

from dataclasses import MISSING
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.files import guarded, if_plotting, require_unused, write_json
from toros_fem.base.keys import File, Flag, key
from toros_fem.base.mpi import on_first_rank
from toros_fem.cli.command import Answer, Command
from toros_fem.products.common.options import Unwrapping

FILES = ("pattern.npz", "pattern.svg", "unwrap.png", "surface.vtu", "summary.json")


class Unwrap(Command, Unwrapping, kw_only=True):
    """Cuts a surface along seams and lays it flat as a sewing pattern.

    The surface is repaired and cut. Line elements in the file and the borders between its
    groups of triangles become seams. Without them the seams are found: along creases, and
    wherever a panel would be stretched too far. The folder gets pattern.npz, which scenes
    read, pattern.svg in true scale, unwrap.png, surface.vtu and summary.json.
    """

    mesh: File = key(MISSING, "triangle mesh, in STL, OBJ, PLY, MSH or XDMF")
    output: File | None = key(
        None,
        "folder for the pattern, made if missing; none takes the name of MESH without its ending",
    )
    overwrite: Flag = key(False, "replace files of these names in the folder; all others stay")
    verbose: Flag = key(False, "print the distortion of each panel")

    WORDS: ClassVar = ("mesh",)
    TAKES: ClassVar = {"output": "FOLDER"}
    EXAMPLES: ClassVar = (
        "toros unwrap finger.stl",
        "toros unwrap finger.msh --method lscm --max-stretch 0.1 --output finger-flat",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Unwrap the surface; write pattern, drawing, picture and fields (collective)."""
        import shapely

        from toros_fem.making.panel_drawing import write_svg
        from toros_fem.meshes.files import PATTERN_FILE, write_pattern
        from toros_fem.results.runs.open_run import require_open
        from toros_fem.results.writer import write_fields

        output = self.output or Path(self.mesh.stem)
        on_first_rank(comm, lambda: require_unused(output, FILES, overwrite=self.overwrite))
        surface = self.surface(comm, self.mesh)
        surface, _ = self.meshed(comm, surface)
        unwrapped = self.unwrapped(comm, surface)
        distortion, pattern = unwrapped.distortion, unwrapped.pattern
        summary: dict[str, Any] = {
            "file": self.mesh.name,
            "triangles": len(surface.triangles),
            "size_m": float(np.ptp(surface.points, axis=0).max()),
            "closed": surface.closed,
            "area_m2": surface.area,
            "repairs": surface.repairs,
            "panels": dict(zip(pattern.panel_names, unwrapped.methods, strict=True)),
            "worst_stretch": distortion.worst_stretch,
            "mean_stretch": distortion.mean_stretch,
            "worst_seam": distortion.worst_seam,
            "inputs": self.updating(Unwrapping()).as_dict(),
        }

        def draw() -> None:
            from toros_fem.results.pictures.flat import draw_unwrapped
            from toros_fem.results.pictures.style import TALL, page

            with page(output / "unwrap.png", size=TALL) as figure:
                draw_unwrapped(figure, unwrapped)

        def write() -> None:
            require_open(output)
            if self.verbose:
                print(distortion.table())
            write_pattern(output / PATTERN_FILE, pattern)
            empty = [shapely.Polygon()] * len(unwrapped.methods)
            write_svg(output / "pattern.svg", pattern, empty)
            if_plotting(draw)
            stretches = {
                "area_ratio": distortion.area_ratio,
                "stretch": distortion.strain,
                "angle_error": distortion.angle_error,
            }
            write_fields(output / "surface.vtu", pattern, pattern.points, stretches)
            write_json(output / "summary.json", summary)

        guarded(comm, output, write)
        text = (
            f"{summary['triangles']} triangles, {1e3 * summary['size_m']:.4g} mm across (repairs: "
            f"{surface.repairs}), in {len(pattern.panel_names)} panels: stretch "
            f"{distortion.worst_stretch:.2%} at most, {distortion.mean_stretch:.2%} in the mean, "
            f"lengths at a seam within {distortion.worst_seam:.2%}; see {output / PATTERN_FILE}"
        )
        return Answer(text, {"pattern": output / PATTERN_FILE, **summary})
