"""Files of tolerances: figures, table and picture."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from toros_fem.base.files import write_json, write_table, write_together
from toros_fem.products.tolerance.result import Tolerances
from toros_fem.results.writer import if_plotting

FILES = ("tolerance.json", "tolerance.csv", "tolerance.png")


def write_tolerances(comm: MPI.Comm, folder: Path | str, found: Tolerances) -> None:
    """Write tolerance.json, tolerance.csv and tolerance.png (collective).

    Args:
        comm: Communicator; the first rank writes.
        folder: Folder for the files, made if missing.
        found: The variants.

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder = Path(folder)

    def draw() -> None:
        from toros_fem.products.tolerance.plot import plot_tolerances

        plot_tolerances(folder / FILES[2], found)

    def write() -> None:
        write_json(folder / FILES[0], found.summary())
        write_table(folder / FILES[1], found.rows())
        if_plotting(draw)

    write_together(comm, folder, write)
