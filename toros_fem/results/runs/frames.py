"""Frames: shapes of a run, written one by one while it computes, for reports and animations.

They lie in the folder `frames` of a run (docs/report.md), beside the skin as reports show it. They
are NumPy's npz files without pickled objects, in SI units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from toros_fem.base.errors import OutputError
from toros_fem.base.files import Archive, read_archive, replace_file, write_archive
from toros_fem.base.validation import Floats, Ints
from toros_fem.making.printability import REGIONS, packed_regions, regions_of
from toros_fem.measures.miss import Miss, miss_of, placed_on
from toros_fem.meshes.files import archive_of, pattern_of
from toros_fem.meshes.pattern import Pattern, Regions

FOLDER = "frames"
# Frames over iterations that are kept, besides the newest.
MOST = 60
FRAME = "frame"
REMEDY = "Delete it, or run the design again."
SKIN = "skin"
BODY = ("body_points", "body_triangles")
# Vertical part of a unit normal from which on a ground is level.
LEVEL = 0.999


@dataclass(frozen=True, eq=False)
class Frame:
    """One shape of a skin.

    Attributes:
        series: What the frames follow: "iteration", "pressure", "pose", "gait" or "load".
        number: Place in the series; of a design its iteration.
        skin: Name of the file of its skin.
        positions: Positions of all vertices, (n, 3), in m.
        density: Density of all triangles, (t,); None where the skin's print is shown.
        values: Numbers by name, their units at the end of the names as in the tables.
        note: What is not as usual in this equilibrium, as sentences; empty where all is.
    """

    series: str
    number: int
    skin: str
    positions: Floats
    density: Floats | None
    values: Mapping[str, float]
    note: str = ""


def write_frame(folder: Path, frame: Frame) -> None:
    """Write a frame in single precision into the folder of the frames, which exists (one rank)."""
    arrays = {"positions": frame.positions.astype(np.float32)}
    if frame.density is not None:
        arrays["density"] = frame.density.astype(np.float32)
    numbers = {"skin": frame.skin, "values": dict(frame.values), "note": frame.note}
    path = folder / f"{frame.series}-{frame.number:06d}.npz"
    write_archive(path, Archive(FRAME, arrays, numbers), compress=False)


def read_frames(folder: Path, series: str) -> list[Frame]:
    """Return the frames of a series in a folder by rising number; none where there are none.

    Raises:
        OutputError: A file cannot be read.
    """

    def frame(number: int) -> Frame:
        def make(archive: Archive) -> Frame:
            arrays = {name: array.astype(np.float64) for name, array in archive.arrays.items()}
            return Frame(series, number, **{"density": None, **arrays, **archive.numbers})

        path = folder / f"{series}-{number:06d}.npz"
        return read_archive(path, FRAME, make, OutputError, REMEDY)

    return [frame(number) for number in numbers(folder, series)]


def numbers(folder: Path, series: str) -> list[int]:
    """Return the numbers of the frames of a series that are there, rising."""
    paths = folder.glob(f"{series}-{6 * '[0-9]'}.npz")
    return sorted(int(path.stem.removeprefix(f"{series}-")) for path in paths)


def forget_from(folder: Path, series: str, number: int) -> None:
    """Delete the frames of a series from a number on (one rank).

    They are of an older run, or of steps that a resumed run does again.
    """
    for other in numbers(folder, series):
        if other >= number:
            (folder / f"{series}-{other:06d}.npz").unlink(missing_ok=True)


def rename(folder: Path, series: str, name: str) -> None:
    """Give the frames of a series the name of another (one rank).

    Those that the other has from the first of these numbers on are deleted. Nothing is done where
    there are none: a resumed run may have done it.
    """
    if not (there := numbers(folder, series)):
        return
    forget_from(folder, name, there[0])
    for number in there:
        path = folder / f"{series}-{number:06d}.npz"
        replace_file(folder / f"{name}-{number:06d}.npz", path.read_bytes())
        path.unlink(missing_ok=True)


def thin(folder: Path, series: str) -> None:
    """Delete frames so that `MOST` are left at even distances, and the newest (one rank).

    The distance is the least power of two that allows this, so that frames that are kept now were
    kept before.
    """
    there = numbers(folder, series)
    distance = 1
    while there and there[-1] // distance >= MOST:
        distance *= 2
    for number in there[:-1]:
        if number % distance:
            (folder / f"{series}-{number:06d}.npz").unlink(missing_ok=True)


@dataclass(frozen=True, eq=False)
class ShownSkin:
    """A whole skin, and what is drawn with it.

    Attributes:
        target: Target positions of all vertices, (n, 3), in m; None without a target shape.
        aligned: Whether shapes are compared with the target after the best rigid motion.
        passive: Prescribed density of all triangles, (t,), NaN where it is designed; None designs
            every triangle.
        regions: Its print; None before there is one.
        body: Points, (k, 3), in m, and triangles, (l, 3), of the objects beside the skin.
        grounds: A point of the surface, in m, and the normal of each ground, (g, 2, 3).
        compared: Whether the design compares positions with the target along x, y and z.
    """

    pattern: Pattern
    target: Floats | None = None
    aligned: bool = False
    passive: Floats | None = None
    regions: Regions | None = None
    body: tuple[Floats, Ints] | None = None
    grounds: Floats | None = None
    compared: tuple[bool, bool, bool] = (False, False, False)

    @property
    def ground(self) -> float | None:
        """Height in m of the level ground; None without one."""
        grounds = () if self.grounds is None else self.grounds
        return next((float(point[2]) for point, normal in grounds if normal[2] > LEVEL), None)

    def placed(self, positions: Floats) -> Floats:
        """Return positions of all vertices, (n, 3), in m, as they are compared with the target."""
        if not self.aligned or self.target is None:
            return positions
        return placed_on(self.pattern, positions, self.target)

    def miss(self, placed: Floats) -> Miss | None:
        """Return how far placed positions, (n, 3), are from the target; None if nothing says so."""
        if self.target is None or not any(self.compared):
            return None
        return miss_of(self.pattern, placed, self.target, self.compared)

    def wanted(self, placed: Floats) -> Floats | None:
        """Return the target, (n, 3), where axes that do not count are those of placed positions."""
        if any(self.compared) and not all(self.compared):
            miss = self.miss(placed)
            return self.target if miss is None else miss.asked
        return self.target


def write_skin(folder: Path, skin: ShownSkin) -> str:
    """Write a skin into the folder of the frames and return the name of its file (one rank).

    Its content determines the name. A file that is there already stays.
    """
    given = {"target": skin.target, "passive": skin.passive, "grounds": skin.grounds}
    arrays: dict[str, npt.NDArray] = {
        name: np.asarray(a) for name, a in given.items() if a is not None
    }
    if skin.regions is not None:
        arrays |= packed_regions(skin.regions)
    if skin.body is not None:
        arrays[BODY[0]], arrays[BODY[1]] = skin.body
    numbers = {"aligned": skin.aligned, "compared": list(skin.compared)}
    archive = archive_of(SKIN, skin.pattern, arrays, numbers)
    path = folder / f"{SKIN}-{archive.digest[:12]}.npz"
    if not path.exists():
        write_archive(path, archive)
    return path.name


def read_skin(path: Path) -> ShownSkin:
    """Return the skin in a file, or raise an OutputError."""

    def make(archive: Archive) -> ShownSkin:
        arrays, pattern = archive.arrays, pattern_of(archive)
        panels = len(pattern.panel_names)
        return ShownSkin(
            pattern,
            target=arrays.get("target"),
            aligned=archive.numbers["aligned"],
            passive=arrays.get("passive"),
            regions=regions_of(archive, panels) if REGIONS[0] in arrays else None,
            body=(arrays[BODY[0]], arrays[BODY[1]]) if BODY[0] in arrays else None,
            grounds=arrays.get("grounds"),
            compared=tuple(archive.numbers.get("compared", (False,) * 3)),
        )

    return read_archive(path, SKIN, make, OutputError, REMEDY)
