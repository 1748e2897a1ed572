"""Arrays as text in a page: whole numbers, compressed, in base64."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from toros_fem.base.array_types import Floats

# Largest whole number that a coordinate becomes.
STEPS = 2**16 - 1


@dataclass(frozen=True, eq=False)
class Box:
    """Cube around everything that is shown, and its grid.

    Attributes:
        low: Its least corner in m, (3,).
        size: Its edge length in m.
    """

    low: Floats
    size: float

    @property
    def step(self) -> float:
        """Distance in m of neighbouring points of the grid, the resolution of what is shown."""
        return self.size / STEPS

    def rounded(self, points: Floats) -> npt.NDArray[np.uint16]:
        """Return the places of points on the grid, shape as given."""
        return np.round((points - self.low) / self.step).clip(0, STEPS).astype(np.uint16)


@dataclass(eq=False)
class Packed:
    """Arrays one after the other, with where each begins.

    Attributes:
        parts: Their bytes.
        size: Number of bytes so far.
    """

    parts: list[bytes] = field(default_factory=list)
    size: int = 0

    def add(self, array: npt.NDArray) -> Mapping[str, Any]:
        """Add an array and return how to find it: type, first byte and number of entries.

        It may be of 8, 16 or 32 bits. The low bytes of all entries come first, then the high ones,
        since these change less and so are compressed better.
        """
        content = np.ascontiguousarray(array)
        width = content.dtype.itemsize
        raw = content.astype(content.dtype.newbyteorder("<")).view(np.uint8).reshape(-1, width)
        entry = {"type": content.dtype.name, "at": self.size, "count": int(content.size)}
        self.parts.append(raw.T.tobytes())
        self.size += raw.size
        return entry

    def add_changes(self, arrays: list[npt.NDArray]) -> list[Mapping[str, Any]]:
        """Add arrays of one shape and type as their changes from one to the next."""
        before = np.zeros_like(arrays[0])
        entries = []
        for array in arrays:
            entries.append(self.add(array - before))  # whole numbers wrap around
            before = array
        return entries

    def text(self) -> str:
        """Return all arrays, compressed by zlib, in base64."""
        return base64.b64encode(zlib.compress(b"".join(self.parts), 9)).decode("ascii")


def index_type(largest: int) -> type[np.uint16] | type[np.uint32]:
    """Return the smaller type of numbers that reach the largest."""
    return np.uint16 if largest < 2**16 else np.uint32
