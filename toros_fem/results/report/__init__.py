"""Reports of runs: one page that a browser opens offline, and animations (docs/report.md)."""

from toros_fem.results.report.animation import write_animation
from toros_fem.results.report.page_file import write_report

__all__ = [
    "write_animation",
    "write_report",
]
