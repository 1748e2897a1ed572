"""Folders of runs with shapes that are known, as fast to make as to write."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from mpi4py import MPI

from toros_fem.base.files import write_json, write_table
from toros_fem.making.panel_drawing import write_svg
from toros_fem.measures.figures import Figure
from toros_fem.meshes import Pattern, bend, cylinder
from toros_fem.results.runs.frames import FOLDER, Frame, ShownSkin, write_frame, write_skin

LENGTH, DIAMETER = 0.15, 0.02
STRIPE = shapely.box(0.01, 0.005, 0.03, 0.145).difference(shapely.Point(0.02, 0.07).buffer(6e-3))
SUMMARY: dict[str, Any] = {
    "figures": [
        Figure("angle", "deg", 88.25, 1.5, 90.0, 2.7).as_dict(),
        Figure("pressure", "pa", 5e3).as_dict(),
        Figure("volume", "m3", 5e-5).as_dict(),
        Figure("stretch", "use", 0.5).as_dict(),
    ],
    "equilibrium": "A stable equilibrium was found at 5000 Pa.",
    "printed_failure": None,
    "objective_first": 0.5,
    "objective_last": 0.001,
    "design": {"angle_deg": 89.0},
    "curve": {
        "failure_below": None,
        "failure_above": None,
        "measured": [
            {"metric": "angle_deg", "pressure_pa": 8e3, "measured": 70.0, "source": "paper"}
        ],
    },
    "manufacture": {"pieces": 2, "islands": 0, "smallest_width_mm": 2.5},
    "triangles": 100,
    "parts_by_symmetry": 1,
    "inputs": {"pressure": 5000.0, "filter": "cone", "line_width": None},
    "versions": {"toros_fem": "0.1.0", "dolfinx": "0.9.0"},
    "seconds": {"total": 12.0},
    "ranks": 2,
}


def tube(edge_length: float = 6e-3) -> Pattern:
    """A capped tube, with printed caps and a stripe with a hole in `regions_of`."""
    return cylinder(MPI.COMM_SELF, LENGTH, DIAMETER, edge_length, mesh="left")


def regions_of(pattern: Pattern) -> list[shapely.Geometry]:
    """The stripe on the wall, and both caps."""
    regions = []
    for panel, name in enumerate(pattern.panel_names):
        if name == "wall":
            regions.append(STRIPE)
        else:
            regions.append(
                shapely.union_all(shapely.polygons(pattern.corners[pattern.panel == panel]))
            )
    return regions


def bent(pattern: Pattern, angle: float, rough: float = 0.0) -> np.ndarray:
    """The tube bent by an angle in rad, a little blown up, with noise of a size in m."""
    wide = pattern.points * [1.2, 1.2, 1.0]
    noise = np.random.default_rng(int(1e3 * angle)).normal(size=wide.shape)
    return np.asarray(bend(angle, LENGTH)(wide) + rough * noise)


def write_run(
    folder: Path,
    pattern: Pattern,
    iterations: int = 12,
    pressures: int = 10,
    rough: float = 0.0,
    panel: str = "wall",
) -> Path:
    """Write a finished run over angles up to 120° at 10 kPa; return its folder.

    Args:
        folder: Its folder.
        pattern: The tube.
        iterations, pressures: Number of shapes.
        rough: Size of noise in m.
        panel: Another name of the wall.
    """
    frames = folder / FOLDER
    frames.mkdir(parents=True)
    target = bent(pattern, np.pi / 2)
    compared = (True, True, True)
    plain = write_skin(frames, ShownSkin(pattern, target, compared=compared))
    regions = regions_of(pattern)
    names = tuple(panel if name == "wall" else name for name in pattern.panel_names)
    pattern = dataclasses.replace(pattern, panel_names=names)
    printed = write_skin(frames, ShownSkin(pattern, target, regions=regions, compared=compared))
    drawn = np.random.default_rng(1).random(len(pattern.triangles))
    history, curve = [], []
    for k in range(iterations):
        part = (k + 1) / iterations
        row = {
            "iteration": k,
            "level": 0,
            "objective": 0.5 * 0.1 ** (3 * part),
            "pressure": 5e3,
            "volume_fraction": 0.4,
            "grey_level": 1 - 0.9 * part,
            "angle_deg": 90 * part,
        }
        shape = bent(pattern, part * np.pi / 2, rough)
        density = (1 - part) * drawn + part * (drawn > 0.6)
        write_frame(frames, Frame("iteration", k, plain, shape, density, row))
        history.append(row)
    for k, pressure in enumerate(np.linspace(1e3, 1e4, pressures)):
        row = {"pressure_pa": pressure, "angle_deg": 120 * pressure / 1e4}
        shape = bent(pattern, np.radians(row["angle_deg"]), rough)
        note = "It is near a limit point." if k == pressures - 1 else ""
        write_frame(frames, Frame("pressure", k, printed, shape, None, row, note))
        curve.append(row)
    write_json(folder / "summary.json", SUMMARY)
    write_table(folder / "history.csv", history)
    write_table(folder / "curve.csv", curve)
    write_svg(folder / "pattern.svg", pattern, regions)
    return folder


def change_summary(folder: Path, **changes: Any) -> None:
    """Change entries of a run's summary."""
    path = folder / "summary.json"
    summary = json.loads(path.read_text(encoding="utf-8"))
    write_json(path, {**summary, **changes})
