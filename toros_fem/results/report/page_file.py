"""The page of a run: what it shows of the skin in space, its file, and how a notebook shows it."""

from __future__ import annotations

import base64
import hashlib
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from shapely.affinity import scale

from toros_fem.base.errors import OutputError
from toros_fem.base.files import naming, replace_file
from toros_fem.base.packages import required, template
from toros_fem.base.validation import Floats, require_kind
from toros_fem.making.panel_drawing import region_data
from toros_fem.meshes.panels import panel_places
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.unwrapped import triangle_stretches
from toros_fem.results.report import tables
from toros_fem.results.report.tables import as_shown
from toros_fem.results.runs.frames import Frame, ShownSkin
from toros_fem.results.runs.stored_run import FILES, Run, Summary, read_run, summary_of

NAME = "report.html"
# Positions of all frames together take at most so many bytes before they are compressed.
MOST_BYTES = 6_000_000
# Stretches are told in steps of 1/100, up to the largest that a byte tells.
STRETCH_STEP = 0.01
# Largest whole number that a coordinate becomes.
STEPS = 2**16 - 1
# Columns of the history that say how the design was found, and not what it is.
SOLVER_COLUMNS = {
    "iteration", "stage", "level", "shape", "g_r", "g_t", "gradient_norm", "kkt", "change", "beta",
    "rejected", "newton_steps", "factorisations", "seconds",
}  # fmt: skip
# Gap between panels, and margin around them, in mm.
GAP, MARGIN = 10.0, 5.0
# Half the side of a ground over the size of all that is shown.
GROUND = 0.75


@dataclass(frozen=True)
class EmbeddedPage:
    """A page of HTML that a notebook shows in a frame of its own, of a height in pixels."""

    page: str = field(repr=False)
    height: int

    def _repr_html_(self) -> str:
        # Scripts of the page run, apart from the notebook and from what it may do.
        return (
            f'<iframe sandbox="allow-scripts" srcdoc="{escape(self.page)}" '
            f'style="width: 100%; height: {self.height}px; border: 0"></iframe>'
        )


@dataclass(frozen=True)
class StoredRun(Summary):
    """What summary.json of a run in a folder holds, with its skin in space.

    The tables of a run, such as history.csv, are read by `pandas.read_csv` as they are.
    """

    folder: Path

    def show(self, height: int = 640) -> EmbeddedPage:
        """Return the skin in space, a height in pixels, which a notebook shows and a mouse turns.

        Raises:
            FileError: The folder holds no run.
            OutputError: A file cannot be read.
            MissingPackageError: A package of the extra `plot` is not installed.
        """
        return view_of(self.folder, height)


def read_summary(folder: Path | str) -> StoredRun:
    """Return the summary of a run, empty if there is none yet (one rank).

    Raises:
        OutputError: It cannot be read, is none, or is that of an earlier version.
    """
    require_kind("folder", folder, (str, Path), "the folder of a run")
    found = summary_of(Path(folder))
    return StoredRun(found.figures, found.entries, Path(folder))


def view_of(folder: Path, height: int) -> EmbeddedPage:
    """Return the page of a run, with nothing but its skin in space."""
    return EmbeddedPage(page_of(read_run(folder), alone=True), height)


def write_report(folder: str | Path) -> Path:
    """Write report.html into a run's folder and return its path (one rank).

    Everything comes from files in the folder. A run that was stopped, or is still going on, is
    shown as far as it has come.

    Raises:
        FileError: The folder holds no run.
        OutputError: A file cannot be read, or the page not be written.
        MissingPackageError: A package of the extra `plot` is not installed.
    """
    run = read_run(folder)
    page, path = page_of(run), run.folder / NAME
    with naming(path):
        replace_file(path, page.encode())
    return path


def page_of(run: Run, *, alone: bool = False) -> str:
    """Return the page of a run, or its view in space alone, as HTML that needs no other file.

    Raises:
        OutputError: A file of the run holds a value that no run writes.
        MissingPackageError: A package of the extra `plot` is not installed.
    """
    try:
        return _page(run, alone=alone)
    except (AttributeError, LookupError, TypeError, ValueError) as caught:
        raise OutputError(
            f"{run.folder}: a file, most likely summary.json, holds a value that no run writes "
            f"({caught!r}). Run the scene again."
        ) from caught


def _page(run: Run, *, alone: bool) -> str:
    filled = template("toros_fem.results.report", "page/report.html", "plot").render
    required("matplotlib", "plot")
    from toros_fem.results.report import charts

    scene, data, patterns = packed_scene(run) if run.series else ({"series": {}}, "", [])
    # The page's own scripts run, and no other that a name or a message brings along.
    scripts = [f"\n/*\n{_text('three.LICENSE')}*/\n{_text('three.min.js')}", _text("viewer.js")]
    shown: str = filled(
        run=run,
        alone=alone,
        tables=tables,
        style=_text("report.css"),
        curve=charts.over_pressure(run),
        convergence=charts.over_iterations(run),
        patterns=patterns,
        files={n: text for n, text in FILES.items() if n != NAME and (run.folder / n).is_file()},
        scene=scene,
        data=data,
        scripts=scripts,
        hashes=[base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts],
    )
    return shown


def _text(name: str) -> str:
    folder = resources.files("toros_fem.results.report")
    return folder.joinpath("page", name).read_text(encoding="utf-8")


def packed_scene(run: Run) -> tuple[dict[str, Any], str, list[dict[str, Any]]]:
    """Return the description of all shapes of a run, their arrays as text, and its flat patterns.

    The run has one frame at least.
    """
    chosen = {name: _chosen(frames, len(run.series)) for name, frames in run.series.items()}
    shapes = {
        name: [run.skins[frame.skin].placed(frame.positions) for frame in frames]
        for name, frames in chosen.items()
    }
    used = dict.fromkeys(frame.skin for frames in chosen.values() for frame in frames)
    skins = {name: run.skins[name] for name in used}
    bodies = [skin.body[0] for skin in skins.values() if skin.body is not None]
    # The last shape of each skin says where its target is along axes that do not count.
    last = {
        frame.skin: shape
        for name, frames in chosen.items()
        for frame, shape in zip(frames, shapes[name], strict=True)
    }
    targets = {name: skin.wanted(last[name]) for name, skin in skins.items()}
    found = [target for target in targets.values() if target is not None]
    packed = Packed([*(x for shown in shapes.values() for x in shown), *found, *bodies])
    patterns = FlatPatterns()
    scene: dict[str, Any] = {
        "low": packed.low.tolist(),
        "step": packed.step,
        "skins": {
            name: _packed_skin(packed, skin, targets[name], patterns)
            for name, skin in skins.items()
        },
        "series": {
            name: _packed_series(packed, run, name, frames, shapes[name])
            for name, frames in chosen.items()
        },
        "from": {
            name: eye(skins[frames[-1].skin], frames[-1].density, shapes[name][-1])
            for name, frames in chosen.items()
        },
        "left_out": {name: len(run.series[name]) - len(frames) for name, frames in chosen.items()},
        # Series in other coordinates than those of the design are framed by themselves.
        "frame_of": {key: key if key in ("gait", "load") else "design" for key in chosen},
    }
    name, entries = next(iter(scene["series"].items()))
    index, at = len(entries) - 1, run.summary.value("pressure_pa")
    if name == "pressure" and at is not None:
        index = min(range(len(entries)), key=lambda k: abs(entries[k]["x"] - at / 1e3))
    scene["start"] = {"series": name, "index": index}
    return scene, packed.text(), patterns.shown


class Packed:
    """Arrays of whole numbers one after the other, with where each begins.

    Positions are rounded to a grid on the box of all points that are shown, (k, 3) each, in m.

    Attributes:
        low: Least corner of the box in m, (3,).
        step: Distance in m of neighbouring points of the grid.
    """

    def __init__(self, points: Sequence[Floats]) -> None:
        self.low = np.min([p.min(axis=0) for p in points], axis=0)
        high = np.max([p.max(axis=0) for p in points], axis=0)
        self.step = float((high - self.low).max()) / STEPS
        self._parts: list[bytes] = []
        self._size = 0

    def places(self, points: Floats) -> npt.NDArray[np.uint16]:
        """Return the places of points on the grid, shape as given."""
        return np.round((points - self.low) / self.step).clip(0, STEPS).astype(np.uint16)

    def add(self, array: npt.NDArray) -> Mapping[str, Any]:
        """Add an array and return how to find it: type, first byte and number of entries.

        The low bytes of all entries come first, then the high ones: these change less, and so are
        compressed better.
        """
        content = np.ascontiguousarray(array)
        raw = content.view(np.uint8).reshape(-1, content.dtype.itemsize)
        entry = {"type": content.dtype.name, "at": self._size, "count": int(content.size)}
        self._parts.append(raw.T.tobytes())
        self._size += raw.size
        return entry

    def add_changes(self, arrays: Sequence[npt.NDArray]) -> list[Mapping[str, Any]]:
        """Add arrays of one shape and type as their changes from one to the next."""
        before = [np.zeros_like(array) for array in arrays[:1]] + [*arrays[:-1]]
        # Whole numbers wrap around.
        return [self.add(array - last) for array, last in zip(arrays, before, strict=True)]

    def text(self) -> str:
        """Return all arrays, compressed by zlib, in base64."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), 9)).decode("ascii")


class FlatPatterns:
    """Flat patterns with their prints: drawings of the page, and textures of the view in space.

    Attributes:
        shown: For each its width and height in mm, and its panels: name, place of the origin of its
            chart (x to the right, y down), and path data of border and print, in mm.
    """

    def __init__(self) -> None:
        self.shown: list[dict[str, Any]] = []
        self._known: list[tuple[list[bytes], Floats]] = []

    def of(self, skin: ShownSkin) -> tuple[int, Floats]:
        """Return the number of a skin's flat pattern, and where it has all flat points, (m, 2).

        These are parts of its width and of its height, upwards. Copies of a skin share a pattern.
        """
        assert skin.regions is not None
        regions = [region.wkb for region in skin.regions]
        numbers = [
            k
            for k, (known, _) in enumerate(self._known)
            if known * (len(regions) // len(known)) == regions
        ]
        number = numbers[0] if numbers else self._draw(skin.pattern, skin.regions, regions)
        drawn, origins = self.shown[number], self._known[number][1]
        panel = skin.pattern.panel_of_point % len(origins)
        places = origins[panel] + 1e3 * skin.pattern.flat_points
        return number, places / [drawn["width"], drawn["height"]]

    def _draw(self, pattern: Pattern, regions: Regions, known: list[bytes]) -> int:
        origins = np.array([1e3 * p.offset + MARGIN for p in panel_places(pattern, 1e-3 * GAP)])
        width, height = (origins[pattern.panel, None] + 1e3 * pattern.corners).max(axis=(0, 1))
        width, height = float(width) + MARGIN, float(height) + MARGIN
        panels = [
            {
                "name": name,
                "x": float(x),
                "y": height - float(y),
                "cut": region_data(scale(pattern.outline(k), 1e3, 1e3, origin=(0, 0))),
                "print": region_data(scale(regions[k], 1e3, 1e3, origin=(0, 0))),
            }
            for k, (name, (x, y)) in enumerate(zip(pattern.panel_names, origins, strict=True))
        ]
        self.shown.append({"width": width, "height": height, "panels": panels})
        self._known.append((known, origins))
        return len(self.shown) - 1


def eye(skin: ShownSkin, density: Floats | None, positions: Floats) -> list[float]:
    """Return the unit vector to the eye of the oblique view, which pictures and films have too."""
    from toros_fem.results.pictures.shown import DrawnSkin  # loaded on use: it needs matplotlib

    _, oblique = DrawnSkin(skin, density).views(positions)
    return [float(x) for x in oblique.directions[2]]


def _chosen(frames: Sequence[Frame], series: int) -> Sequence[Frame]:
    """Return every second frame, every fourth …, and the last, as far as their size requires."""
    distance, chosen = 1, frames
    while len(chosen) > 2 and sum(2 * f.positions.size for f in chosen) > MOST_BYTES / series:
        distance *= 2
        chosen = [*frames[:-1:distance], frames[-1]]
    return chosen


def _packed_skin(
    packed: Packed, skin: ShownSkin, target: Floats | None, patterns: FlatPatterns
) -> dict[str, Any]:
    pattern = skin.pattern
    edges = np.concatenate([pattern.sewn[pattern.seams[:, 0]], pattern.free_edges])
    found: dict[str, Any] = {
        "vertices": len(pattern.points),
        "closed": len(pattern.free_edges) == 0,
        "triangles": packed.add(pattern.flat_triangles.astype(np.uint32)),
        "sewn": packed.add(pattern.sewn.astype(np.uint32)),
        "seams": packed.add(edges.astype(np.uint32)),
        "grounds": [] if skin.grounds is None else _squares(packed, skin.grounds),
    }
    if target is not None:
        found["target"] = packed.add(packed.places(target))
    if skin.regions is not None:
        found["pattern"], places = patterns.of(skin)
        found["places"] = packed.add(np.round(STEPS * places).astype(np.uint16))
    if skin.body is not None:
        points, triangles = skin.body
        found["body"] = {
            "points": packed.add(packed.places(points)),
            "triangles": packed.add(triangles.astype(np.uint32)),
        }
    return found


def _squares(packed: Packed, grounds: Floats) -> list[float]:
    """Return the corners of two triangles of each ground, in mm from the corner of the box."""
    size = 1e3 * STEPS * packed.step
    found = []
    for point, normal in grounds:
        side = np.cross([0, 1, 0] if abs(normal[1]) < 0.9 else [0, 0, 1], normal)
        side /= np.linalg.norm(side)
        middle = np.full(3, size / 2)
        middle -= ((middle - 1e3 * (point - packed.low)) @ normal) * normal
        across = GROUND * size * np.array([side, np.cross(normal, side)])
        corners = middle + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ across
        found += corners[[0, 1, 2, 0, 2, 3]].ravel().tolist()
    return found


def _entries(run: Run, series: str, frames: Sequence[Frame]) -> list[dict[str, Any]]:
    """Return what a reader sees of frames, and where they are on the slider of their series."""
    last, found = run.history[-1]["iteration"] if run.history else 0, []
    for k, frame in enumerate(frames):
        values = {key: value for key, value in frame.values.items() if np.isfinite(value)}
        number, pressure = frame.number, values.get("pressure_pa", 0.0) / 1e3
        if series == "iteration":
            # Without a perimeter term there is no length of a border.
            hidden = SOLVER_COLUMNS | ({"perimeter"} if not values.get("perimeter") else set())
            values = {key: value for key, value in values.items() if key not in hidden}
        label = {
            "pressure": f"{pressure:.4g} kPa",
            "iteration": f"{number} of {max(last, number):.0f}",
            "gait": f"position {k + 1} of {len(frames)}",
            "load": "closed on the object",
            "pose": f"pose {number} at {pressure:.4g} kPa",
        }[series]
        shown = [as_shown(key, value) for key, value in values.items()]
        x = pressure if series == "pressure" else number
        entry = {"skin": frame.skin, "number": number, "note": frame.note}
        found.append({**entry, "shown": shown, "x": x, "label": label})
    return found


def _packed_series(
    packed: Packed, run: Run, series: str, frames: Sequence[Frame], shapes: Sequence[Floats]
) -> list[dict[str, Any]]:
    found = _entries(run, series, frames)
    for name in dict.fromkeys(frame.skin for frame in frames):
        here = [k for k, frame in enumerate(frames) if frame.skin == name]
        pattern = run.skins[name].pattern
        corners = [shapes[k][pattern.triangles] for k in here]
        stretches = [triangle_stretches(pattern.corners, x)[:, 0] for x in corners]
        for k, large in zip(here, stretches, strict=True):
            found[k]["stretch_range"] = [float(large.min()), float(large.max())]
        density = {k: d for k in here if (d := frames[k].density) is not None}
        for kind, numbers, arrays in (
            ("positions", here, [packed.places(shapes[k]) for k in here]),
            ("stretch", here, [_as_bytes(large / STRETCH_STEP) for large in stretches]),
            ("density", [*density], [_as_bytes(255 * d) for d in density.values()]),
        ):
            for k, entry in zip(numbers, packed.add_changes(arrays), strict=True):
                found[k][kind] = entry
    return found


def _as_bytes(values: npt.NDArray) -> npt.NDArray[np.uint8]:
    return np.round(values).clip(0, 255).astype(np.uint8)
