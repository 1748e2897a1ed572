"""Runs that survive: a folder with its lock, what is kept of its loops, and signals."""

from toros_fem.results.runs.folder import Run, RunRecord, journal_of, open_run, read_run, run_of

__all__ = [
    "Run",
    "RunRecord",
    "journal_of",
    "open_run",
    "read_run",
    "run_of",
]
