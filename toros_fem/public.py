"""The public names by task, which `toros_fem` hands on once one of them is asked for."""

import toros_fem.meshes as meshes
from toros_fem.base import errors
from toros_fem.design.density.length_scale import LengthScale
from toros_fem.design.lines.field import LineOptions
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.levels import optimize_levels, refinements
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.shape_design import Regularisation, ShapeDesign
from toros_fem.design.mma.optimizer import MMAOptions
from toros_fem.design.relaxed.find import RelaxedOptions, find_lines
from toros_fem.making.as_printed import as_printed, printed_lines
from toros_fem.making.printability import PrintLimits
from toros_fem.materials.sheet import Bending, Bladder, Composite, Knit, Material, Membrane
from toros_fem.measures.cross_sections import CrossSections
from toros_fem.measures.metrics import Metric, bend_angle, length_ratio, swelling, twist_angle
from toros_fem.measures.regions import bend_between, length_between, twist_between
from toros_fem.measures.shape import ShapePart
from toros_fem.mechanics.contact.bodies import Ground
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import limit_points
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import clamp, clamp_where, pin, symmetry_plane
from toros_fem.mechanics.terms.loads import Weight
from toros_fem.meshes.skin import sew
from toros_fem.products.actuators.corrections import corrected
from toros_fem.products.actuators.design_skin import design_skin
from toros_fem.products.actuators.estimates import print_intervals
from toros_fem.products.actuators.pressure import trimmed
from toros_fem.products.fitting.fit import fit_material
from toros_fem.products.fitting.reading import read_tensile_tests
from toros_fem.products.tolerance import tolerances
from toros_fem.results.report.page_file import read_summary
from toros_fem.results.reporter import DesignReporter
from toros_fem.results.runs.open_run import open_run
from toros_fem.results.writer import write_results

__all__ = [  # noqa: RUF022
    # Materials
    "Material",
    "Membrane",
    "Bending",
    "Knit",
    "Bladder",
    "Composite",
    # Skins, supports and loads
    "sew",
    "clamp",
    "clamp_where",
    "pin",
    "symmetry_plane",
    "Chambers",
    "Contact",
    "Ground",
    "Weight",
    "Load",
    # Equilibria
    "EquilibriumSolver",
    "NewtonOptions",
    "trace",
    "limit_points",
    # Measures of a shape
    "Metric",
    "bend_angle",
    "twist_angle",
    "length_ratio",
    "swelling",
    "bend_between",
    "twist_between",
    "length_between",
    # Designs
    "design_skin",
    "Case",
    "ShapePart",
    "CrossSections",
    "Regularisation",
    "LengthScale",
    "ShapeDesign",
    "Stage",
    "DesignOptions",
    "MMAOptions",
    "DesignResult",
    "refinements",
    "optimize",
    "optimize_levels",
    # Lines
    "find_lines",
    "RelaxedOptions",
    "lay_lines",
    "LineOptions",
    "printed_lines",
    # Prints
    "as_printed",
    "trimmed",
    "corrected",
    "print_intervals",
    "PrintLimits",
    "tolerances",
    # Runs
    "DesignReporter",
    "open_run",
    "write_results",
    "read_summary",
    # Constants from tests
    "read_tensile_tests",
    "fit_material",
    # Rooms
    "errors",
    "meshes",
]
