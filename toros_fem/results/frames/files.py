"""Frames on disk: one file for each shape, thinned as a run goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toros_fem.base.archive import Archive, read_archive, write_archive
from toros_fem.base.array_types import Floats
from toros_fem.base.errors import OutputError
from toros_fem.base.files import replace_file

FOLDER = "frames"
# Frames over iterations that are kept, besides the newest.
MOST = 60
KIND = "frame"
REMEDY = "Delete it, or run the design again."


@dataclass(frozen=True, eq=False)
class Frame:
    """One shape of a skin.

    Attributes:
        series: What the frames follow: "iteration", "pressure", "gait" or "load".
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
    write_archive(path, Archive(KIND, arrays, numbers), compress=False)


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
        return read_archive(path, KIND, make, OutputError, REMEDY)

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
