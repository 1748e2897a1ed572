"""Runs that survive: a folder with its lock, what is kept of its loops, and signals."""

from toros_fem.runs.folder import Run, RunRecord, open_run, read_run, run_of

__all__ = ["Run", "RunRecord", "open_run", "read_run", "run_of"]
