"""UFL expressions without coefficients, made of numbers and evaluated to numbers."""

from typing import Any

import numpy as np
import ufl


def vector(values: np.ndarray) -> Any:
    """UFL vector of given numbers."""
    return ufl.as_vector(values.tolist())


def matrix(values: np.ndarray) -> Any:
    """UFL matrix of given numbers."""
    return ufl.as_matrix(values.tolist())


def number(expression: Any) -> float:
    """Value of a scalar expression."""
    return float(expression(())) if hasattr(expression, "ufl_shape") else float(expression)


def numbers(expression: Any) -> np.ndarray:
    """Values of an expression with components."""
    out = np.zeros(expression.ufl_shape)
    for at in np.ndindex(*expression.ufl_shape):
        out[at] = number(expression[at])
    return out
