"""What every room stands on: errors, types, checks, settings, MPI, files."""

from toros_fem.base.files import write_json, write_table

__all__ = [
    "write_json",
    "write_table",
]
