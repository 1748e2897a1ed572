"""Films of a run: the skin as it inflates and empties, as it walks, or as its design changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from PIL import Image as Bitmap

from toros_fem.base.errors import OutputError
from toros_fem.base.files import naming, replace_file
from toros_fem.measures.figures import Figure as Told
from toros_fem.measures.figures import formatted
from toros_fem.results.pictures.of_run import inflation_view, sentence, told_figures
from toros_fem.results.pictures.raster import View
from toros_fem.results.pictures.shown import Axonometry, DrawnSkin
from toros_fem.results.pictures.style import DARK, LETTERS, SOFT, TITLE
from toros_fem.results.runs.frames import Frame
from toros_fem.results.runs.stored_run import Run, read_run

# Width and height in inches, and pixels per inch: 720 × 405.
SIZE, DPI = (7.2, 4.05), 100
# Pictures from rest to the last state; time in ms of each, and of the last state.
MOST, SHOWN, HELD = 24, 83, 1000
# Between two frames that are apart by more than this part of the whole way shapes are not made.
JOINED = 0.12
# A walker goes from left to right.
WALKING = View(15.0, 15.0)
# Colours of the palettes of an APNG and of a GIF, and pictures that they are made of.
MANY, FEW, SAMPLES = 256, 128, 4


def write_animation(folder: str | Path, series: str = "pressure") -> Path:
    """Write a film of a run into its folder, as APNG and as GIF, and return the GIF (one rank).

    No display is needed. The names are inflation.apng and inflation.gif for the series "pressure",
    and SERIES.apng and SERIES.gif for "iteration", "gait" and "load".

    Raises:
        OutputError: The folder has no such frames, a file cannot be read, or the film not be
            written.
    """
    run = read_run(folder)
    frames = run.series.get(series, ())
    if len(frames) < 2:
        raise OutputError(
            f"{folder} has no frames over the {series}, so there is nothing to animate. A finished "
            "design with a curve has some."
        )
    name = "inflation" if series == "pressure" else series
    path = run.folder / f"{name}.gif"
    scenes = _inflated(run, frames) if series == "pressure" else _as_recorded(frames)
    pictures = _pictures(run, series, scenes)
    times = [SHOWN] * len(pictures)
    times[-1] = HELD
    if series == "pressure":  # back to rest
        pictures, times = pictures + pictures[-2:0:-1], times + [SHOWN] * (len(pictures) - 2)
    with naming(path):
        replace_file(path.with_suffix(".apng"), _moving(pictures, times, "PNG", MANY))
        replace_file(path, _moving(pictures, times, "GIF", FEW))
    return path


def _as_recorded(frames: Sequence[Frame]) -> list[Frame]:
    """Return frames at even distances, the first and the last among them."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(MOST, len(frames))).round().astype(int))
    return [frames[k] for k in chosen]


def _inflated(run: Run, frames: Sequence[Frame]) -> list[Frame]:
    """Return states from the lowest pressure to the design's, at equal steps of the motion.

    Between frames that are close, positions are interpolated; where they are far apart the frames
    themselves are shown.
    """
    pressure = run.summary.value("pressure_pa") or frames[-1].values["pressure_pa"]
    rows = [frame for frame in frames if frame.values["pressure_pa"] <= 1.001 * pressure]
    rows = rows if len(rows) > 1 else list(frames)
    moves = [float(np.linalg.norm(b.positions - a.positions)) for a, b in pairwise(rows)]
    way = np.concatenate([[0.0], np.cumsum(moves)])
    if way[-1] == 0:
        return _as_recorded(rows)
    scenes = []
    for goal in np.linspace(0, way[-1], MOST):
        k = int(np.clip(np.searchsorted(way, goal) - 1, 0, len(rows) - 2))
        one, other, step = rows[k], rows[k + 1], moves[k]
        part = float((goal - way[k]) / step) if step > 0 else 1.0
        if step > JOINED * way[-1] or one.skin != other.skin:
            part = round(part)
        values = {
            name: (1 - part) * value + part * other.values[name]
            for name, value in one.values.items()
            if name in other.values
        }
        positions = (1 - part) * one.positions + part * other.positions
        scenes.append(replace(one, positions=positions, values=values))
    return scenes


def _pictures(run: Run, series: str, scenes: Sequence[Frame]) -> list[Bitmap.Image]:
    """Draw the pictures of a film, in one frame."""
    scenes = [
        replace(scene, positions=run.skins[scene.skin].placed(scene.positions)) for scene in scenes
    ]
    fixed = {scene.skin: DrawnSkin(run.skins[scene.skin]) for scene in scenes}
    places = np.concatenate([scene.positions for scene in scenes])
    last, shown = scenes[-1], run.skins[scenes[-1].skin]
    target = None if series == "gait" else shown.wanted(last.positions)
    others = [] if target is None else [target]
    others += [] if shown.body is None else [shown.body[0]]
    view = WALKING if series == "gait" else inflation_view(fixed[last.skin], last.positions)
    figures = told_figures(run)
    pictures = []
    with rc_context(LETTERS):
        for scene in scenes:
            drawn = fixed[scene.skin]
            if scene.density is not None:
                drawn = DrawnSkin(run.skins[scene.skin], scene.density)
            figure = Figure(figsize=SIZE, dpi=DPI)
            stage = Axonometry(
                figure, (0.01, 0.01, 0.98, 0.86), view, np.concatenate([places, *others])
            )
            if series == "gait" or drawn.skin.ground is not None:
                stage.ground(float(places[:, 2].min()), places)
            stage.draw(drawn.surfaces(scene.positions))
            wanted = None if series == "gait" else drawn.skin.wanted(scene.positions)
            if wanted is not None:
                stage.outline(drawn, wanted)
            stage.bar()
            told, asked = _words(series, scene, figures)
            figure.text(0.02, 0.93, told, fontsize=TITLE, fontweight="bold", color=DARK)
            figure.text(0.98, 0.93, asked, ha="right", color=SOFT)
            stream = BytesIO()
            figure.savefig(stream, format="png", dpi=DPI)
            pictures.append(Bitmap.open(stream).convert("RGB"))
    return pictures


def _words(series: str, scene: Frame, figures: Sequence[Told]) -> tuple[str, str]:
    """Return what is told above a picture, and the targets."""
    if series == "iteration":
        return f"Iteration {scene.number}", ""
    if series == "gait":
        return f"Position {scene.number + 1}", ""
    found = [
        Told(told.name, told.unit, float(f"{scene.values[told.key]:.3g}"))
        for told in figures
        if told.key in scene.values
    ]
    targets = [
        f"target {formatted(told.target, told.unit)}" for told in figures if told.target is not None
    ]
    return sentence(found, scene.values.get("pressure_pa")), ", ".join(targets)


def _moving(
    pictures: Sequence[Bitmap.Image], times: Sequence[int], kind: str, colours: int
) -> bytes:
    """Return pictures as a film with one palette, of pictures from the first one to the last."""
    chosen = [pictures[k] for k in np.linspace(0, len(pictures) - 1, SAMPLES).astype(int)]
    width, height = pictures[0].size
    strip = Bitmap.new("RGB", (width, height * len(chosen)))
    for k, picture in enumerate(chosen):
        strip.paste(picture, (0, k * height))
    palette = strip.quantize(colours, dither=Bitmap.Dither.NONE)
    frames = [picture.quantize(palette=palette, dither=Bitmap.Dither.NONE) for picture in pictures]
    stream = BytesIO()
    frames[0].save(
        stream, format=kind, save_all=True, append_images=frames[1:], duration=list(times), loop=0
    )
    return stream.getvalue()
