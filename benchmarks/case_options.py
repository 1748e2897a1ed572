"""Options of the benchmarks that play many independent cases."""

from __future__ import annotations

import argparse
from pathlib import Path

from mpi4py import MPI

from toros_fem.base.validation import require_count


def parser_of(about: str | None, page: Path) -> argparse.ArgumentParser:
    """Return a parser with the options of every benchmark of many cases.

    Args:
        about: Help text.
        page: The page that holds the tables.
    """
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    parser.add_argument(
        "--rows",
        type=Path,
        help="JSON lines of what is finished; a rerun with the same code skips those in it",
    )
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--from", type=Path, dest="source", help="run nothing, read this file")
    parser.add_argument("--docs", action="store_true", help="write the tables into the page")
    parser.add_argument("--page", type=Path, default=page, help="the page")
    return parser


def parsed(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """Return the options of the command line; processes take the place of ranks."""
    options = parser.parse_args()
    if MPI.COMM_WORLD.size > 1:
        parser.error("one rank only: the checks are dense and serial. --workers takes processes.")
    require_count(1, workers=options.workers)
    return options
