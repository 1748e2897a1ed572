"""A print as a file: the pattern, and the polygons on its panels."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import shapely
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.archive import Archive, read_archive, write_archive
from toros_fem.base.errors import FileError
from toros_fem.base.mpi import on_root
from toros_fem.making.print.printability import PrintLimits
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.pattern_file import archive_of, pattern_of

NAME, KIND = "print.npz", "print"
REGIONS = ("region_bytes", "region_sizes")


@dataclass(frozen=True, eq=False)
class StoredPrint:
    """A print as it was written: the whole pattern, the print on it, and the printer's limits."""

    pattern: Pattern
    regions: list[BaseGeometry]
    limits: PrintLimits


def write_print_polygons(
    path: Path | str, pattern: Pattern, regions: Regions, limits: PrintLimits
) -> None:
    """Write a print on a whole pattern as an archive, a file ending in .npz (one rank).

    Its entries are those of `write_pattern`, the arrays of `packed_regions`, and "limits", those of
    the printer.
    """
    numbers = {"limits": asdict(limits)}
    write_archive(Path(path), archive_of(KIND, pattern, packed_regions(regions), numbers))


@on_root
def read_print_polygons(comm: MPI.Comm, run: Path | str) -> StoredPrint:
    """Read the print of a finished run, by its folder or file, the same on all ranks (collective).

    Raises:
        FileError: There is no such file, it is damaged, of another kind or format, or holds
            no valid print.
    """
    path = Path(run)
    path = path / NAME if path.suffix != ".npz" else path
    remedy = f"Give the folder of a finished design, which has a {NAME}."

    def make(archive: Archive) -> StoredPrint:
        limits = PrintLimits(**archive.numbers["limits"])
        pattern = pattern_of(archive)
        return StoredPrint(pattern, regions_of(archive, len(pattern.panel_names)), limits)

    return read_archive(path, KIND, make, FileError, remedy)


def packed_regions(regions: Regions) -> dict[str, npt.NDArray]:
    """Return polygons of panels as arrays: well-known binary of all, in m, and sizes in bytes."""
    texts = [shapely.to_wkb(region) for region in regions]
    sizes = np.array([len(text) for text in texts])
    return dict(zip(REGIONS, (np.frombuffer(b"".join(texts), np.uint8), sizes), strict=True))


def regions_of(archive: Archive, panels: int) -> list[BaseGeometry]:
    """Return the regions in an archive, of so many panels."""
    data, sizes = (archive.arrays[name] for name in REGIONS)
    fits = len(sizes) == panels and sizes.min() >= 0
    if not fits or sizes.sum() != data.nbytes:
        raise FileError("the polygons do not fit the panels")
    text, stops = data.tobytes(), np.cumsum(sizes)
    return [shapely.from_wkb(text[b - n : b]) for b, n in zip(stops, sizes, strict=True)]
