"""Output of a run: console, summary, tables, fields and pictures; matplotlib is loaded on use."""

from toros_fem.results.files import write_fields
from toros_fem.results.reporter import DesignReporter
from toros_fem.results.summary import design_summary
from toros_fem.results.writer import (
    write_comparison,
    write_pictures,
    write_pressure_path,
    write_results,
)

__all__ = [
    "DesignReporter",
    "design_summary",
    "write_comparison",
    "write_fields",
    "write_pictures",
    "write_pressure_path",
    "write_results",
]
