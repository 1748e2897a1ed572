"""Frames on disk: one file for each shape, thinned as a run goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.results.frames.npz import read_arrays, write_arrays

FOLDER = "frames"
# Frames over iterations that are kept, besides the newest.
MOST = 60
NAMES = ("skin", "positions", "names", "values", "note")


@dataclass(frozen=True, eq=False)
class Frame:
    """One shape of a skin.

    Attributes:
        series: What the frames follow: "iteration", "pressure", "gait" or "load".
        number: Place in the series; of a design its iteration.
        skin: Name of the file of its skin.
        positions: Positions of all vertices, (n, 3), in m.
        density: Density of all triangles, (t,); None where the skin has a print.
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
    """Write a frame (one rank).

    Args:
        folder: Folder of the frames, which exists.
        frame: The frame. Positions and densities are written in single precision.
    """
    arrays = {
        "skin": np.array(frame.skin),
        "positions": frame.positions.astype(np.float32),
        "names": np.array(list(frame.values), dtype=str),
        "values": np.array(list(frame.values.values()), dtype=np.float64),
        "note": np.array(frame.note),
    }
    if frame.density is not None:
        arrays["density"] = frame.density.astype(np.float32)
    write_arrays(folder / f"{frame.series}-{frame.number:06d}.npz", arrays)


def read_frames(folder: Path, series: str) -> list[Frame]:
    """Return the frames of a series by rising number; an empty list where there are none.

    Args:
        folder: Folder of the frames.
        series: What the frames follow.

    Raises:
        OutputError: A file cannot be read.
    """
    frames = []
    for number in numbers(folder, series):
        arrays = read_arrays(folder / f"{series}-{number:06d}.npz", NAMES)
        names = (str(name) for name in arrays["names"])
        values = (float(value) for value in arrays["values"])
        density = arrays.get("density")
        frames.append(
            Frame(
                series,
                number,
                str(arrays["skin"]),
                arrays["positions"].astype(np.float64),
                None if density is None else density.astype(np.float64),
                dict(zip(names, values, strict=True)),
                str(arrays["note"]),
            )
        )
    return frames


def numbers(folder: Path, series: str) -> list[int]:
    """Return the numbers of the frames of a series that are there, rising."""
    found = (path.stem.removeprefix(f"{series}-") for path in folder.glob(f"{series}-*.npz"))
    return sorted(int(number) for number in found if number.isdigit())


def forget_from(folder: Path, series: str, number: int) -> None:
    """Delete the frames of a series from a number on (one rank).

    They are of an older run, or of steps that a resumed run does again.
    """
    for other in numbers(folder, series):
        if other >= number:
            (folder / f"{series}-{other:06d}.npz").unlink()


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
            (folder / f"{series}-{number:06d}.npz").unlink()
