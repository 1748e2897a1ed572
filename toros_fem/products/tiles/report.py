"""Files of a tile design: print file, sheet, summary, profile, fields and pictures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from mpi4py import MPI
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import FileError, ParameterError
from toros_fem.base.files import (
    Archive,
    guarded,
    if_plotting,
    if_possible,
    read_archive,
    write_archive,
    write_table,
)
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import Bools, checked_path, require_kind, require_positive, shown
from toros_fem.making.machine_files import FOLDER, write_manufacture
from toros_fem.making.panel_drawing import write_svg
from toros_fem.making.printability import packed_regions, printed_cells, regions_of
from toros_fem.materials.sheet import Composite
from toros_fem.measures.figures import TOLERANCE, Figure
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.tiles import Tile, tile
from toros_fem.products.tiles.problem import (
    SIDE,
    UNITS,
    PrintMeasurement,
    TileCase,
    TileResult,
    repeated,
)
from toros_fem.products.tiles.stiffness_profile import Profile, ProfileTarget
from toros_fem.results.result import RunResult, write_summary
from toros_fem.results.writer import write_fields

NAME, KIND = "tile.npz", "tile"
MEMBRANE = Composite(bending=None)
# Corners of a print closer than this to a straight border of it, in m, are left out.
COLLINEAR = 1e-9
# Edges along the shorter side of the plain tile that is meshed along the print.
PLAIN = 4
# Least size of a swatch, and its unprinted cloth at both ends for clamps, in m.
SWATCH, CLAMPED = 50e-3, 20e-3
# What files and summaries hold of a profile.
PROFILE = ("stiffness", "tangent", "contraction")


@dataclass(frozen=True, eq=False)
class PrintedTile:
    """A tile and the print on it.

    Attributes:
        region: Printed polygons in the tile [0, a] × [0, b], in m.
        size: Its sides (a, b) in m.
        edge_length: Edge length in m of its mesh outside of the print.
        composite: Its materials, as a membrane without a bladder.

    Raises:
        ParameterError: The region is no shape, a number is outside its range, or the composite
            bends, has a bladder, or a knit whose grain is given by panels.
    """

    region: BaseGeometry
    size: tuple[float, float]
    edge_length: float
    composite: Composite = MEMBRANE

    def __post_init__(self) -> None:
        require_kind("region", self.region, BaseGeometry, "polygons in m, by shapely")
        if not isinstance(self.size, list | tuple) or len(self.size) != 2:
            raise ParameterError(f"size = {shown(self.size)} must be two sides (a, b) in m.")
        require_kind("composite", self.composite, Composite, "a Composite")
        require_positive(size_x=self.size[0], size_y=self.size[1], edge_length=self.edge_length)
        if self.composite.bending is not None or self.composite.bladder is not None:
            raise ParameterError(
                "a printed tile is a membrane: its composite must have bending = None and "
                "bladder = None."
            )
        knit = self.composite.knit
        if knit is not None and not isinstance(knit.grain, float):
            raise ParameterError(
                "a printed tile is one panel: the grain of its knit must be one angle."
            )

    def tile(self, comm: MPI.Comm) -> tuple[Tile, Bools]:
        """Return the tile, meshed along the print, and whether each triangle is printed, (t,).

        Raises:
            PatternError: Borders of the print meet each other.
            MeshSizeError: There would be too many triangles.
        """
        plain = tile(comm, self.size, min(self.size) / PLAIN)
        return plain.following(comm, self.region, self.edge_length)


def write_tile(folder: str | Path, printed_tile: PrintedTile) -> None:
    """Write a printed tile as the archive `tile.npz` into a folder (one rank)."""
    require_kind("printed_tile", printed_tile, PrintedTile, "a PrintedTile")
    folder, numbers = checked_path("folder", folder), dict(vars(printed_tile))
    region = numbers.pop("region")
    numbers["composite"] = printed_tile.composite.as_dict()
    write_archive(folder / NAME, Archive(KIND, packed_regions([region]), numbers))


@on_root
def read_tile(comm: MPI.Comm, folder: str | Path) -> PrintedTile:
    """Read the printed tile that `write_tile` wrote into a folder (collective).

    Raises:
        FileError: There is no such file, it is damaged, or holds no valid tile.
    """
    path = checked_path("folder", folder, FileError) / NAME

    def make(archive: Archive) -> PrintedTile:
        numbers = dict(archive.numbers)
        composite = Composite(**numbers.pop("composite"))
        size = tuple(numbers.pop("size"))
        (region,) = regions_of(archive, 1)
        return PrintedTile(region, size, composite=composite, **numbers)

    remedy = "Give the output folder of demos/tile.py."
    return read_archive(path, KIND, make, FileError, remedy)


def swatch(tile: Tile, region: BaseGeometry) -> tuple[Pattern, BaseGeometry]:
    """Return the cloth of a piece of tiles, at least 5 cm wide each way, and the print on it.

    The region is that of one tile, in m.
    """
    along, across = (math.ceil(SWATCH / side - 1e-9) for side in np.diagonal(tile.lattice))
    return print_layout(tile, region, (along, across), CLAMPED)


def print_layout(
    tile: Tile, region: BaseGeometry, counts: tuple[int, int], margin: float
) -> tuple[Pattern, BaseGeometry]:
    """Return the cloth of a sheet of tiles, and the print on it, continuous across their borders.

    Args:
        tile: The tile.
        region: The print on one tile, in m.
        counts: Numbers of tiles along x and y.
        margin: Length in m of unprinted cloth at both ends along x, for clamps.
    """
    size = np.array(counts) * np.diagonal(tile.lattice) + [2 * margin, 0.0]
    corners = size * [[0, 0], [1, 0], [1, 1], [0, 1]]
    whole = shapely.simplify(repeated(region, tile, *counts), COLLINEAR)
    cloth = Pattern(
        flat_points=corners,
        flat_triangles=np.array([[0, 1, 2], [0, 2, 3]]),
        panel=np.zeros(2, dtype=int),
        sewn=np.arange(4),
        points=np.column_stack([corners, np.zeros(4)]),
        panel_names=("along_x",),
    )
    return cloth, translate(whole, margin, 0.0)


@dataclass(frozen=True, eq=False, repr=False)
class TileRun(RunResult):
    """The design of a tile, what is measured of its print if it has an equilibrium, and times."""

    made: TileResult
    measured: PrintMeasurement | None
    seconds: Mapping[str, float]

    @property
    def case(self) -> TileCase:
        """The tile and its target."""
        return self.made.case

    @property
    def printed_tile(self) -> PrintedTile:
        """The printed tile, for its file."""
        case, composite = self.case, self.made.config.material.composite
        return PrintedTile(self.made.region, case.size, case.edge_length, composite)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Stiffness and contraction in each direction of the objective."""
        unknown, found = [None] * len(self.case.angles), []
        intervals = {} if self.measured is None else self.measured.intervals
        for name, unit in UNITS.items():
            values = _listed(self.made.profile, name) or unknown
            goals = _listed(self.case.target, name) or unknown
            widths = [float(width) for width in intervals[name]] if name in intervals else unknown
            for angle, value, width, goal in zip(
                self.case.angles, values, widths, goals, strict=True
            ):
                key = f"{name}_at_{np.degrees(angle):g}_deg".replace(".", "_")
                tolerance = None if goal is None else TOLERANCE * (abs(goal) or 1.0)
                found.append(Figure(key, unit, value, width, goal, tolerance))
        return tuple(found)

    @property
    def worst(self) -> float | None:
        """Largest deviation from the target in per cent; None without target or equilibrium."""
        known = self.case.target is not None and self.made.profile is not None
        return 100 * self.made.deviation if known else None

    def entries(self) -> dict[str, Any]:
        """Return print, design, search and cost."""
        case, made = self.case, self.made
        target, profile, design = case.target, made.profile, made.result
        designed, last = design.final.equilibrium, design.history[-1]
        limits, widths = made.problem.length_scale, design.final.length_scale
        buckling = None if self.measured is None else self.measured.buckling
        return {
            "objective_printed": profile and case.objective.forward(profile),
            "objective_designed": case.objective.forward(designed),
            "worst_percent": self.worst,
            "angles_deg": np.degrees(case.angles).tolist(),
            "strain": designed.strain,
            "target": target and _values(target, "stiffness", "contraction"),
            "printed": profile and _values(profile, *PROFILE),
            "design": _values(designed, *PROFILE),
            "blank_n_per_m": self.measured and self.measured.fabric_stiffness,
            "buckling": None if buckling is None else buckling.tolist(),
            "printed_failure": made.failure or None,
            "volume_fraction": last.volume_fraction,
            "grey_level": last.grey_level,
            "length_scale": None if limits is None or widths is None else limits.summary(widths),
            "trials": list(made.trials),
            "corrections_percent": [100 * d if np.isfinite(d) else None for d in made.deviations],
            "iterations": last.iteration,
            "newton_steps": sum(row.newton_steps for row in design.history),
            "triangles": len(case.tile.pattern.panel),
            "reason": design.reason,
            "manufacture": made.printability.summary(),
            "seconds": {**design.seconds, **self.seconds},
            "inputs": made.config.as_dict(),
        }

    def description(self) -> str:
        """Return stiffness, deviation, widths and islands in a sentence."""
        profile, made = self.made.profile, self.made.printability.summary()
        seconds = self.seconds.get("total", 0.0)
        if profile is None:
            return f"the print has no equilibrium: {self.made.failure}; {seconds:.0f} s"
        stiffness = ", ".join(f"{s:.0f}" for s in profile.stiffness)
        deviation = "" if self.worst is None else f", at most {self.worst:.1f} % from the target"
        flat = None if self.measured is None else self.measured.buckling
        wrinkles = ""
        if flat is not None and flat.any():
            at = ", ".join(f"{angle:.0f}°" for angle in np.degrees(self.case.angles[flat]))
            wrinkles = f"; a sheet that is not kept flat buckles when pulled at {at}"
        widths = "".join(
            f", {name} from {made[key]:.2f} mm"
            for name, key in (("lines", "smallest_width_mm"), ("gaps", "smallest_gap_mm"))
            if made[key] is not None
        )
        return (
            f"stiffness {stiffness} N/m as printed{deviation}; contraction "
            f"{profile.contraction[0]:.2f} along x; {made['islands']} islands{widths}{wrinkles}; "
            f"{seconds:.0f} s"
        )


def write_tile_results(folder: Path | str, found: TileRun) -> None:
    """Write summary, pattern, tile.npz, fields and pictures of a design (collective).

    In the folder "manufacture" are the machine files of a swatch of 5 cm × 5 cm.
    """
    folder, case, made, measured = Path(folder), found.case, found.made, found.measured
    region, tile, skin = made.region, case.tile, made.problem.skin
    summary = found.summary()
    fields = {
        "rho": skin.gather_cells(made.result.density),
        "rho_projected": skin.gather_cells(made.result.final.projected),
        "printed": printed_cells(tile.pattern, [region]).astype(np.float64),
    }

    def write() -> None:
        write_svg(folder / "pattern.svg", tile.pattern, [region])
        write_fields(folder / "tile.vtu", tile.pattern, tile.pattern.points, fields)
        write_tile(folder, found.printed_tile)
        if measured is not None:
            write_table(folder / "profile.csv", _rows(measured.profile))
            rows = [row for profile in measured.curves for row in _rows(profile)]
            write_table(folder / "curves.csv", rows)
        if_plotting(draw)
        cloth, printed = swatch(tile, region)
        place = folder / FOLDER
        if_possible(
            "machine files", lambda: write_manufacture(place, cloth, [printed], summary=summary)
        )

    def draw() -> None:
        from toros_fem.products.tiles import plots
        from toros_fem.results.pictures.curves import draw_history
        from toros_fem.results.pictures.style import STRIP, page

        many = repeated(region, tile, SIDE, SIDE)
        plots.plot_tiles(folder / "pattern.png", tile, many, SIDE)
        history = [row.columns() for row in made.result.history]
        title = f"Designed in {made.result.history[-1].iteration} iterations"
        with page(folder / "design.png", title, STRIP) as figure:
            draw_history(figure.add_axes((0.10, 0.17, 0.87, 0.65)), history, None)
        if measured is not None:
            plots.plot_curves(folder / "curves.png", measured.curves)
            plots.plot_profile(
                folder / "profile.png",
                measured.profile,
                measured.fabric_stiffness,
                case.symmetry,
                case.angles,
                case.target,
            )
        state = None if made.profile is None else made.profile.states[0]
        if state is not None:
            positions = made.solver.tile.skin.gather_vertices(state.positions)
            mean = made.solver.images.mean_gradient(state.state)
            plots.plot_deformed(folder / "deformed.png", made.tile, made.cells, positions, mean)

    guarded(case.comm, folder, write)
    write_summary(case.comm, folder, found)  # last: a run with it has all its files


def _values(of: ProfileTarget | Profile, *names: str) -> dict[str, Any]:
    """Return values by column."""
    units = {name: "" if name == "contraction" else "_n_per_m" for name in names}
    return {name + unit: _listed(of, name) for name, unit in units.items()}


def _listed(of: ProfileTarget | Profile | None, name: str) -> list[float | None] | None:
    values = None if of is None else getattr(of, name)
    return None if values is None else [None if np.isnan(v) else float(v) for v in values]


def _rows(profile: Profile) -> list[dict[str, float]]:
    columns = {
        "angle_deg": np.degrees(profile.angles).tolist(),
        "strain": [profile.strain] * len(profile.angles),
        **_values(profile, "stress", *PROFILE),
    }
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
