"""The design problem, its gradient and the loop that solves it, eqs. (11-19)."""

from toros_fem.design.loop.case import Case
from toros_fem.design.loop.levels import optimize_levels, refinements
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions, Iteration, Stage
from toros_fem.design.loop.problem import DesignProblem, Evaluation
from toros_fem.design.loop.regularisation import Regularisation
from toros_fem.design.loop.robust import WidthTolerance
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.loop.shape_problem import ShapeProblem

__all__ = [
    "Case",
    "DesignOptions",
    "DesignProblem",
    "DesignResult",
    "Evaluation",
    "Iteration",
    "Regularisation",
    "ShapeDesign",
    "ShapeProblem",
    "Stage",
    "WidthTolerance",
    "optimize",
    "optimize_levels",
    "refinements",
]
