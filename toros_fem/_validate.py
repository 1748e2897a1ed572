"""Checks of single values, with errors that name the value and its bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from toros_fem.errors import ParameterError


def require_positive(*, at_most: float = math.inf, **values: float) -> None:
    """Check that each value is a finite number in (0, at_most].

    Raises:
        ParameterError: Naming the value and the bound.
    """
    for name, value in values.items():
        if not (math.isfinite(value) and 0 < value <= at_most):
            bound = "" if math.isinf(at_most) else f" and at most {at_most:.6g}"
            raise ParameterError(f"{name} = {value} must be a finite number greater than 0{bound}.")


def require_between(low: float, high: float, **values: float) -> None:
    """Check that each value is a finite number in [low, high].

    Raises:
        ParameterError: Naming the value and the bounds.
    """
    for name, value in values.items():
        if not (math.isfinite(value) and low <= value <= high):
            bound = f"at least {low:g}" if math.isinf(high) else f"between {low:g} and {high:g}"
            raise ParameterError(f"{name} = {value} must be a finite number, {bound}.")


def require_count(least: int, **values: int) -> None:
    """Check that each value is a whole number and at least `least`.

    Raises:
        ParameterError: Naming the value and the bound.
    """
    for name, value in values.items():
        if not (isinstance(value, (int, np.integer)) and value >= least):
            raise ParameterError(f"{name} = {value} must be a whole number, at least {least}.")


def require_choice(name: str, value: str, choices: Sequence[str]) -> None:
    """Check that a value is one of the given words.

    Raises:
        ParameterError: Naming the value and the choices.
    """
    if value not in choices:
        raise ParameterError(f"{name} = {value!r} must be one of {', '.join(map(repr, choices))}.")


def require_names(name: str, values: Sequence[str]) -> None:
    """Check that names come as a list: a lone text would be read letter by letter.

    Raises:
        ParameterError: They do not.
    """
    if isinstance(values, str):
        raise ParameterError(f"{name} = {values!r} must be a list of names: [{values!r}].")
