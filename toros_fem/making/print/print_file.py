"""A print as a file: the pattern, and the polygons on its panels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import PatternFileError
from toros_fem.base.mpi import on_first_rank
from toros_fem.making.print.printability import PrintLimits
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.pattern_file import ARRAYS, NUMBERS, pattern_entries, pattern_of, read_archive

NAME = "print.npz"
FORMAT = "toros_fem print"
VERSION = 1
REGIONS = ("region_bytes", "region_sizes", "line_width", "gap_width", "hole_area")


@dataclass(frozen=True, eq=False)
class StoredPrint:
    """A print as it was written.

    Attributes:
        pattern: The whole pattern that is printed on.
        regions: Print on each panel, polygons in m.
        limits: Limits of the printer.
    """

    pattern: Pattern
    regions: list[BaseGeometry]
    limits: PrintLimits


def write_print_polygons(
    path: Path | str, pattern: Pattern, regions: Sequence[BaseGeometry], limits: PrintLimits
) -> None:
    """Write a print as a compressed NumPy archive (one rank).

    Its entries are those of `write_pattern`; the polygons of each panel, one after the other, as
    well-known binary, coordinates in m, with their sizes in bytes; and the limits of the printer.

    Args:
        path: File ending in .npz.
        pattern: The whole pattern that is printed on.
        regions: Print on each panel, polygons in m.
        limits: Limits of the printer.
    """
    texts = [shapely.to_wkb(region) for region in regions]
    np.savez_compressed(
        path,
        format=FORMAT,
        version=VERSION,
        region_bytes=np.frombuffer(b"".join(texts), dtype=np.uint8),
        region_sizes=np.array([len(text) for text in texts]),
        line_width=limits.width,
        gap_width=limits.gap,
        hole_area=limits.hole_area,
        **pattern_entries(pattern),
    )


def read_print_polygons(comm: MPI.Comm, run: Path | str) -> StoredPrint:
    """Read the print of a finished run, the same on all ranks (collective).

    Args:
        comm: Communicator; the first rank reads.
        run: Folder of the run, or a file by `write_print_polygons`.

    Raises:
        PatternFileError: There is no such file, it is another kind of file, of a newer version,
            lacks an entry, or holds no valid print.
    """
    path = Path(run)
    path = path / NAME if path.suffix != ".npz" else path
    names = (*ARRAYS, *NUMBERS, *REGIONS)
    wanted = f"the folder of a finished design, which has a {NAME}"
    return on_first_rank(comm, lambda: read_archive(path, FORMAT, VERSION, names, wanted, _print))


def _print(entries: Mapping[str, Any]) -> StoredPrint:
    pattern = pattern_of(entries)
    data, sizes = entries["region_bytes"].tobytes(), entries["region_sizes"]
    if len(sizes) != len(pattern.panel_names) or sizes.min() < 0 or sizes.sum() != len(data):
        raise PatternFileError("the polygons do not fit the panels")
    stops = np.cumsum(sizes)
    try:
        regions = [shapely.from_wkb(data[b - n : b]) for b, n in zip(stops, sizes, strict=True)]
    except shapely.errors.ShapelyError as caught:
        raise PatternFileError(f"the polygons cannot be read ({caught})") from None
    width, gap, hole = (float(entries[name].item()) for name in REGIONS[2:])
    return StoredPrint(pattern, regions, PrintLimits(width, gap, hole))
