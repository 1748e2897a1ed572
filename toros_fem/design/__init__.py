"""The design problem, its gradient and the loop that solves it, eqs. (11-19)."""

from toros_fem.design.config import DesignConfig
from toros_fem.design.levels import optimize_levels, refinements
from toros_fem.design.load_path import LoadPath, LoadStep, PathGradient
from toros_fem.design.loop import DesignResult, optimize
from toros_fem.design.options import DesignOptions, Iteration, Stage
from toros_fem.design.problem import DesignProblem, Evaluation
from toros_fem.design.robust import WidthTolerance
from toros_fem.design.shape_design import ShapeDesign
from toros_fem.design.shape_problem import ShapeProblem

__all__ = [
    "DesignConfig",
    "DesignOptions",
    "DesignProblem",
    "DesignResult",
    "Evaluation",
    "Iteration",
    "LoadPath",
    "LoadStep",
    "PathGradient",
    "ShapeDesign",
    "ShapeProblem",
    "Stage",
    "WidthTolerance",
    "optimize",
    "optimize_levels",
    "refinements",
]
