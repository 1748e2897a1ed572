"""Design of robotic skins: printed patterns that make an inflated fabric bend, twist or grip.

The names below are the public interface. `toros_fem.actuators`, `toros_fem.tiles`, `toros_fem.mma`
and the pictures in `toros_fem.output` are imported explicitly. All quantities are in SI units.
"""

from pathlib import Path

from toros_fem._version import __version__

# In a checkout `forms/` and `meshes/` lie beside this folder, in an installed package inside it.
if not (Path(__file__).parent / "forms").is_dir():
    __path__.append(str(Path(__file__).parent.parent))

from toros_fem import errors, meshes
from toros_fem.analysis.arc_length import ArcLengthOptions
from toros_fem.analysis.error_estimate import ErrorEstimate, estimate_error
from toros_fem.analysis.limit_points import LimitPoint, limit_points
from toros_fem.analysis.states import FoundStates, find_states
from toros_fem.analysis.trace import trace
from toros_fem.analysis.trace_point import TracePoint
from toros_fem.analysis.wrinkles import Tension, WrinkleField, wrinkle_field
from toros_fem.characterisation.fit import fit_material
from toros_fem.characterisation.fitting import FitOptions
from toros_fem.characterisation.reading import read_tensile_tests
from toros_fem.characterisation.result import FitResult
from toros_fem.characterisation.tensile_test import TensileTest
from toros_fem.contact.bodies import RigidBody
from toros_fem.contact.pads import Pads
from toros_fem.contact.settings import Contact, Ground
from toros_fem.contact.solids import rigid_box, rigid_cylinder, rigid_mesh, rigid_sphere
from toros_fem.density.field import random_density
from toros_fem.density.filters import make_filter
from toros_fem.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.density.perimeter import Perimeter
from toros_fem.density.projection import Projection
from toros_fem.design.levels import optimize_levels, refinements
from toros_fem.design.loop import DesignResult, optimize
from toros_fem.design.options import DesignOptions, Stage
from toros_fem.design.robust import WidthTolerance
from toros_fem.design.shape_design import ShapeDesign
from toros_fem.design.shape_problem import ShapeProblem
from toros_fem.equilibrium.diagnostics import Condition
from toros_fem.equilibrium.options import NewtonOptions
from toros_fem.equilibrium.solver import EquilibriumError, EquilibriumResult, EquilibriumSolver
from toros_fem.errors import TorosError
from toros_fem.fabrication.as_printed import PrintedDesign, as_printed
from toros_fem.fabrication.printability import PrintLimits
from toros_fem.fabrication.printed_lines import printed_lines
from toros_fem.lines.field import LineField
from toros_fem.lines.laid_lines import LaidLines
from toros_fem.lines.lay_lines import lay_lines
from toros_fem.lines.options import LineOptions
from toros_fem.materials import Bending, Bladder, Composite, Knit, Material, Membrane
from toros_fem.mechanics.chambers import Chambers
from toros_fem.mechanics.dead_loads import Weight, point_force, spread_force
from toros_fem.mechanics.supports import (
    Supports,
    build_in,
    clamp,
    clamp_where,
    displace,
    pin,
    symmetry_plane,
)
from toros_fem.meshes.skin import sew
from toros_fem.objectives.alignment import AlignedObjective
from toros_fem.objectives.cross_sections import CrossSectionObjective, CrossSections
from toros_fem.objectives.gap import Body, GapObjective
from toros_fem.objectives.metrics import (
    Measurement,
    Metric,
    bend_angle,
    length_ratio,
    shortening,
    swelling,
    twist_angle,
)
from toros_fem.objectives.shape import ShapeObjective, SumObjective
from toros_fem.output.reporter import DesignReporter
from toros_fem.output.writer import write_results
from toros_fem.relaxed.find import RelaxedOptions, RelaxedResult, find_lines
from toros_fem.runs.folder import open_run
from toros_fem.tolerance.result import Tolerances
from toros_fem.tolerance.settings import ToleranceConfig
from toros_fem.tolerance.simulated import tolerances
from toros_fem.tolerance.writing import write_tolerances

__all__ = [
    "AlignedObjective",
    "ArcLengthOptions",
    "Bending",
    "Bladder",
    "Body",
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
    "RelaxedOptions",
    "RelaxedResult",
    "RigidBody",
    "ShapeDesign",
    "ShapeObjective",
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
    "__version__",
    "as_printed",
    "bend_angle",
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
    "tolerances",
    "trace",
    "twist_angle",
    "wrinkle_field",
    "write_results",
    "write_tolerances",
]
