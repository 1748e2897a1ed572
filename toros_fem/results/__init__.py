"""Output of a run: console, summary, tables, fields and pictures; matplotlib is loaded on use."""

from toros_fem.results.files import write_fields
from toros_fem.results.pressure_path import PathResult, write_pressure_path
from toros_fem.results.reporter import DesignReporter
from toros_fem.results.result import RunResult, Summary, read_summary, write_summary
from toros_fem.results.summary import PrintedResult
from toros_fem.results.writer import write_comparison, write_pictures, write_results

__all__ = [
    "DesignReporter",
    "PathResult",
    "PrintedResult",
    "RunResult",
    "Summary",
    "read_summary",
    "write_comparison",
    "write_fields",
    "write_pictures",
    "write_pressure_path",
    "write_results",
    "write_summary",
]
