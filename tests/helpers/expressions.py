"""UFL expressions without coefficients, made of numbers and evaluated to numbers."""

from typing import Any


def number(expression: Any) -> float:
    """Value of a scalar expression."""
    return float(expression(())) if hasattr(expression, "ufl_shape") else float(expression)
