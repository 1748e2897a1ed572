"""Animations of a run: the print over the pressure, or the design over its iterations."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import OutputError, ParameterError
from toros_fem.base.files import replace_file
from toros_fem.meshes.panels import CutTriangles, cut_triangles
from toros_fem.results.frames.files import Frame
from toros_fem.results.frames.shown_skin import ShownSkin
from toros_fem.results.report.run_folder import SERIES, Run, read_run

# Time in ms of each picture, and of the last one.
SHOWN, LAST = 120, 1200
DPI = 100
# Size of the picture in inches.
SIZE = (6.4, 4.8)
# Pictures of one animation at most.
MOST = 40
VIEWS = tuple((15.0, float(turn)) for turn in range(0, 360, 30))
# A walker goes from left to right.
WALKING = (15.0, 15.0)
GROUND = "0.93"


def write_animation(folder: str | Path, series: str = "pressure") -> Path:
    """Write an animation of a run into its folder, as a GIF, and return its path (one rank).

    No display is needed. The names are inflation.gif for the series "pressure", and SERIES.gif for
    others.

    Args:
        folder: Folder of the run.
        series: What it follows: "pressure", "iteration" or "gait".

    Raises:
        OutputError: The folder has no such frames, a file cannot be read, or the animation not be
            written.
        ParameterError: The series is unknown.
    """
    if series not in SERIES:
        raise ParameterError(f"series = {series!r} must be one of {', '.join(SERIES)}.")
    run = read_run(folder)
    if len(run.series.get(series, ())) < 2:
        raise OutputError(
            f"{folder} has no frames over the {series}, so there is nothing to animate. A finished "
            "design with a curve has some."
        )
    path = run.folder / ("inflation.gif" if series == "pressure" else f"{series}.gif")
    pictures = _pictures(run, series)
    try:
        replace_file(path, _joined(pictures))
    except OSError as caught:
        raise OutputError(f"{path} could not be written: {caught}. Free some space.") from None
    return path


def _pictures(run: Run, series: str) -> list[bytes]:
    import matplotlib.pyplot as plt

    from toros_fem.results.pictures.drawing import FABRIC, PRINTED, View, draw_skin

    frames = _even(run.series[series])
    cuts = {name: _cut(run.skins[name]) for name in {frame.skin for frame in frames}}
    walks = series == "gait"
    view = View(*(WALKING if walks else _best_view(run.skins[frames[-1].skin], frames[-1])))
    places = np.concatenate([frame.positions for frame in frames])
    ground = view.project(_ground(places)) if walks else None
    every = 1e3 * view.project(places)
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.05 * float((high - low).max())
    pictures = []
    for frame in frames:
        figure, axes = plt.subplots(figsize=SIZE, dpi=DPI, layout="constrained")
        axes.set(
            xlim=(low[0] - margin, high[0] + margin),
            ylim=(low[1] - margin, high[1] + margin),
            aspect="equal",
            xlabel="mm",
        )
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_title(_title(frame))
        if ground is not None:
            axes.fill(*(1e3 * ground.T), color=GROUND, zorder=0)
        pattern = run.skins[frame.skin].pattern
        density = np.zeros(len(pattern.triangles)) if frame.density is None else frame.density
        colours = FABRIC + density[:, None] * (PRINTED - FABRIC)
        printed = cuts[frame.skin] if frame.density is None else None
        draw_skin(axes, pattern.triangles, frame.positions, colours, view, printed)
        stream = BytesIO()
        figure.savefig(stream, format="png", dpi=DPI)
        plt.close(figure)
        pictures.append(stream.getvalue())
    return pictures


def _ground(places: Floats) -> Floats:
    """Return the corners of the ground under all places, (4, 3), in m."""
    (left, front, lowest), (right, back, _) = places.min(axis=0), places.max(axis=0)
    return np.array([[x, y, lowest] for x, y in
                     ((left, front), (right, front), (right, back), (left, back))])  # fmt: skip


def _joined(pictures: Sequence[bytes]) -> bytes:
    """Return pictures as one GIF with the colours of the last one."""
    from PIL import Image

    images = [Image.open(BytesIO(picture)).convert("RGB") for picture in pictures]
    palette = images[-1].quantize(128, dither=Image.Dither.NONE)
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    stream = BytesIO()
    frames[0].save(
        stream,
        format="GIF",
        save_all=True,
        append_images=frames[1:],
        duration=[SHOWN] * (len(frames) - 1) + [LAST],
        loop=0,
    )
    return stream.getvalue()


def _even(frames: Sequence[Frame]) -> list[Frame]:
    """Return frames at even distances, `MOST` at most, the first and the last among them."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(MOST, len(frames))).round().astype(int))
    return [frames[k] for k in chosen]


def _cut(skin: ShownSkin) -> CutTriangles | None:
    return None if skin.regions is None else cut_triangles(skin.pattern, skin.regions)


def _best_view(skin: ShownSkin, frame: Frame) -> tuple[float, float]:
    """Return elevation and turn in degrees of the view that shows most of print and shape."""
    from toros_fem.results.pictures.drawing import View

    triangles = skin.pattern.triangles
    a, b, c = np.moveaxis(frame.positions[triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    ink: Floats = np.zeros(len(triangles))
    if frame.density is not None:
        ink = frame.density
    elif (cut := _cut(skin)) is not None:
        ink = np.bincount(cut.cell, cut.inside * cut.areas, len(triangles)) / skin.pattern.areas

    def score(angles: tuple[float, float]) -> float:
        view = View(*angles)
        seen = np.maximum(normals @ view.directions[2], 0) @ (0.3 + ink)
        return float(seen * np.sqrt(np.prod(np.ptp(view.project(frame.positions), axis=0))))

    return max(VIEWS, key=score)


def _title(frame: Frame) -> str:
    if frame.series == "iteration":
        return f"iteration {frame.number}"
    if frame.series == "pressure" or frame.series == "print":
        return f"{frame.values['pressure_pa'] / 1e3:.3g} kPa"
    return f"position {frame.number + 1}"
