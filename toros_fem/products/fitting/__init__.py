"""Characterisation: material constants of eq. (1) from tensile tests."""

from toros_fem.products.fitting.fit import fit_material
from toros_fem.products.fitting.reading import Given, read_tensile_tests
from toros_fem.products.fitting.report import fit_table, library_entry, write_fit
from toros_fem.products.fitting.result import Estimate, FitResult
from toros_fem.products.fitting.sheet_fit import SheetFit, fit_printed_sheet
from toros_fem.products.fitting.strip import ClampedStrip
from toros_fem.products.fitting.tensile_test import TensileTest
from toros_fem.products.fitting.uniaxial import uniaxial_curve
from toros_fem.products.options import FitOptions

__all__ = [
    "ClampedStrip",
    "Estimate",
    "FitOptions",
    "FitResult",
    "Given",
    "SheetFit",
    "TensileTest",
    "fit_material",
    "fit_printed_sheet",
    "fit_table",
    "library_entry",
    "read_tensile_tests",
    "uniaxial_curve",
    "write_fit",
]
