"""Output of a run: console, summary, tables, fields and pictures; matplotlib is loaded on use."""

from toros_fem._files import write_json, write_table
from toros_fem.output.files import write_fields
from toros_fem.output.reporter import DesignReporter
from toros_fem.output.summary import design_summary
from toros_fem.output.writer import (
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
    "write_json",
    "write_pictures",
    "write_pressure_path",
    "write_results",
    "write_table",
]
