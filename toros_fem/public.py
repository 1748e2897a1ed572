"""The public names, which `toros_fem` hands on once one of them is asked for."""

import toros_fem.meshes as meshes
from toros_fem.base import errors
from toros_fem.base.errors import TorosError
from toros_fem.design.density.field import random_density
from toros_fem.design.density.filters import make_filter
from toros_fem.design.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.density.projection import Projection
from toros_fem.design.lines.field import LineField
from toros_fem.design.lines.laid_lines import LaidLines
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.design.lines.options import LineOptions
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.levels import optimize_levels, refinements
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.regularisation import Regularisation
from toros_fem.design.loop.robust import WidthTolerance
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.design.relaxed.find import RelaxedOptions, RelaxedResult, find_lines
from toros_fem.making.as_printed.as_printed import PrintedDesign, as_printed
from toros_fem.making.as_printed.printed_lines import printed_lines
from toros_fem.making.print.printability import PrintLimits
from toros_fem.materials.sheet import Bending, Bladder, Composite, Knit, Material, Membrane
from toros_fem.measures.alignment import AlignedObjective
from toros_fem.measures.between_regions import (
    bend_between,
    length_between,
    tip_frame,
    twist_between,
)
from toros_fem.measures.cross_sections import CrossSectionObjective, CrossSections
from toros_fem.measures.gap import Body, GapObjective
from toros_fem.measures.metrics import (
    Measurement,
    Metric,
    bend_angle,
    length_ratio,
    shortening,
    swelling,
    twist_angle,
)
from toros_fem.measures.shape import ShapeObjective, ShapePart, SumObjective
from toros_fem.mechanics.contact.bodies import RigidBody
from toros_fem.mechanics.contact.pads import Pads
from toros_fem.mechanics.contact.settings import Contact, Ground
from toros_fem.mechanics.contact.solids import rigid_box, rigid_cylinder, rigid_mesh, rigid_sphere
from toros_fem.mechanics.equilibrium.diagnostics import Condition
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import (
    EquilibriumError,
    EquilibriumResult,
    EquilibriumSolver,
)
from toros_fem.mechanics.paths.arc_length import ArcLengthOptions
from toros_fem.mechanics.paths.limit_points import LimitPoint, limit_points
from toros_fem.mechanics.paths.states import FoundStates, find_states
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.mechanics.readings.error_estimate import ErrorEstimate, estimate_error
from toros_fem.mechanics.readings.wrinkles import Tension, WrinkleField, wrinkle_field
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.dead_loads import Weight, point_force, spread_force
from toros_fem.mechanics.skin.supports import (
    Supports,
    build_in,
    clamp,
    clamp_where,
    displace,
    pin,
    symmetry_plane,
)
from toros_fem.meshes.skin import sew
from toros_fem.products.fitting.fit import fit_material
from toros_fem.products.fitting.reading import read_tensile_tests
from toros_fem.products.fitting.result import FitResult
from toros_fem.products.fitting.tensile_test import TensileTest
from toros_fem.products.options import FitOptions, ToleranceConfig
from toros_fem.products.tolerance.result import Tolerances
from toros_fem.products.tolerance.simulated import tolerances
from toros_fem.products.tolerance.writing import write_tolerances
from toros_fem.results.reporter import DesignReporter
from toros_fem.results.runs.folder import open_run
from toros_fem.results.writer import write_results

__all__ = [
    "AlignedObjective",
    "ArcLengthOptions",
    "Bending",
    "Bladder",
    "Body",
    "Case",
    "Chambers",
    "Composite",
    "Condition",
    "Contact",
    "CrossSectionObjective",
    "CrossSections",
    "DesignOptions",
    "DesignReporter",
    "DesignResult",
    "EquilibriumError",
    "EquilibriumResult",
    "EquilibriumSolver",
    "ErrorEstimate",
    "FitOptions",
    "FitResult",
    "FoundStates",
    "GapObjective",
    "Ground",
    "Knit",
    "LaidLines",
    "LengthScale",
    "LengthScaleConstraints",
    "LimitPoint",
    "LineField",
    "LineOptions",
    "Material",
    "Measurement",
    "Membrane",
    "Metric",
    "NewtonOptions",
    "Pads",
    "Perimeter",
    "PrintLimits",
    "PrintedDesign",
    "Projection",
    "Regularisation",
    "RelaxedOptions",
    "RelaxedResult",
    "RigidBody",
    "ShapeDesign",
    "ShapeObjective",
    "ShapePart",
    "ShapeProblem",
    "Stage",
    "SumObjective",
    "Supports",
    "TensileTest",
    "Tension",
    "ToleranceConfig",
    "Tolerances",
    "TorosError",
    "TracePoint",
    "Weight",
    "WidthTolerance",
    "WrinkleField",
    "as_printed",
    "bend_angle",
    "bend_between",
    "build_in",
    "clamp",
    "clamp_where",
    "displace",
    "errors",
    "estimate_error",
    "find_lines",
    "find_states",
    "fit_material",
    "lay_lines",
    "length_between",
    "length_ratio",
    "limit_points",
    "make_filter",
    "meshes",
    "open_run",
    "optimize",
    "optimize_levels",
    "pin",
    "point_force",
    "printed_lines",
    "random_density",
    "read_tensile_tests",
    "refinements",
    "rigid_box",
    "rigid_cylinder",
    "rigid_mesh",
    "rigid_sphere",
    "sew",
    "shortening",
    "spread_force",
    "swelling",
    "symmetry_plane",
    "tip_frame",
    "tolerances",
    "trace",
    "twist_angle",
    "twist_between",
    "wrinkle_field",
    "write_results",
    "write_tolerances",
]
