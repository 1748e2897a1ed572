"""The files of a run, and what each holds: the one place that says so."""

from __future__ import annotations

from collections.abc import Mapping

# Folder of the state inside that of a run, its record, and the text of the scene.
STATE, RECORD, SCENE, SUMMARY = "state", "run.json", "scene.toml", "summary.json"
# In the order of lists. A run has those of its kind; names inside of folders stand for these.
FILES: Mapping[str, str] = {
    SUMMARY: "all figures and inputs",
    "report.html": "all of this on one page, in space too",
    "shape.png": "inflated skin beside its target",
    "pattern.png": "flat pattern",
    "pattern.svg": "flat pattern, true to scale, for printer and cutter",
    "pattern.npz": "panels, seams and printed triangles, to simulate again",
    "print.npz": "pattern and print, for another simulation",
    "manufacture/make_it.html": "machine files of every sheet, and how to make the skin",
    "manufacture.png": "islands, narrow lines and gaps",
    "design.png": "start, density and print",
    "lines.png": "line families",
    "skin.vtu": "shape and densities, for ParaView",
    "wrinkles.png": "wrinkles",
    "history.csv": "every step of the design",
    "convergence.png": "objective over the iterations",
    "curve.csv": "metrics over the pressure; of a tile's sheet, stress over strain",
    "curve.png": "metrics over the pressure",
    "shapes.png": "shapes over the pressure",
    "inflation.gif": "inflation of the print",
    "iteration.gif": "shapes over the iterations",
    "load.gif": "shapes on the object",
    "gait.csv": "metrics and feet over a cycle",
    "gait.png": "shapes over a cycle",
    "gait.gif": "shapes over a cycle, moving",
    "tracks.png": "paths of the feet",
    "lift.png": "initial design and print lift the object",
    "finger.png": "one finger and the object",
    "tolerance.csv": "metrics of skins that are not made as drawn",
    "tolerance.json": "the same, with what moves each metric most",
    "tolerance.png": "what moves each metric",
    "profile.csv": "stiffness of a tile over the direction",
    "profile.png": "stiffness of a tile over the direction",
    "curves.csv": "stress of a tile over strain",
    "curves.png": "stress of a tile over strain",
    "deformed.png": "a tile that is pulled",
    "tile.npz": "tile and print, for another simulation",
    "tile.vtu": "densities of a tile, for ParaView",
    "sheet_x.png": "a sheet of tiles that is pulled along x",
    "sheet_y.png": "a sheet of tiles that is pulled along y",
    "frames/": "shapes that were recorded",
    SCENE: "the scene that made the run",
    f"{STATE}/": "what an interrupted run goes on from",
}
# What tells a folder of results that has no record.
SIGNS = (SUMMARY, "history.csv")
