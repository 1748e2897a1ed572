"""Checks of single values, with errors that name the value and its bounds."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError, TorosError

# Longest text of a value in a message.
LONGEST = 60
# Whole numbers from here on have no type in NumPy.
LARGEST = 2**63


def shown(value: Any) -> str:
    """Return a value as messages show it: arrays by shape and type, long texts cut."""
    if isinstance(value, np.ndarray) and value.size > 4:
        return f"an array of shape {value.shape} and type {value.dtype}"
    if isinstance(value, list | tuple | set | dict) and len(value) > 4:
        return f"a {type(value).__name__} of {len(value)} entries"
    text = value.item() if isinstance(value, np.generic) else value
    text = " ".join(repr(text).split())
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"


def is_number(value: Any) -> bool:
    """Return whether a value is one real number that NumPy takes, and not a truth value."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    return not isinstance(value, int) or abs(value) < LARGEST


def require_positive(*, at_most: float = math.inf, **values: Any) -> None:
    """Check that each value is a finite number in (0, at_most].

    Raises:
        ParameterError: Naming the value and the bound.
    """
    for name, value in values.items():
        if not (is_number(value) and math.isfinite(value) and 0 < value <= at_most):
            bound = "" if math.isinf(at_most) else f" and at most {at_most:.6g}"
            raise ParameterError(
                f"{name} = {shown(value)} must be a finite number greater than 0{bound}."
            )


def require_between(low: float, high: float, **values: Any) -> None:
    """Check that each value is a finite number in [low, high].

    Raises:
        ParameterError: Naming the value and the bounds.
    """
    for name, value in values.items():
        if not (is_number(value) and math.isfinite(value) and low <= value <= high):
            bound = f"at least {low:g}" if math.isinf(high) else f"between {low:g} and {high:g}"
            raise ParameterError(f"{name} = {shown(value)} must be a finite number, {bound}.")


def require_finite(**values: Any) -> None:
    """Check that each value is a finite number.

    Raises:
        ParameterError: Naming the value.
    """
    for name, value in values.items():
        if not (is_number(value) and math.isfinite(value)):
            raise ParameterError(f"{name} = {shown(value)} must be a finite number.")


def require_count(least: int, **values: Any) -> None:
    """Check that each value is a whole number and at least `least`.

    Raises:
        ParameterError: Naming the value and the bound.
    """
    for name, value in values.items():
        whole = isinstance(value, int | np.integer) and is_number(value)
        if not (whole and value >= least):
            raise ParameterError(
                f"{name} = {shown(value)} must be a whole number, at least {least}."
            )


def require_choice(name: str, value: Any, choices: Sequence[str]) -> None:
    """Check that a value is one of the given words.

    Raises:
        ParameterError: Naming the value and the choices.
    """
    if not isinstance(value, str) or value not in choices:
        known = ", ".join(map(repr, choices))
        raise ParameterError(f"{name} = {shown(value)} must be one of {known}.")


def require_names(name: str, values: Any) -> None:
    """Check that names come as a list: a lone text would be read letter by letter.

    Raises:
        ParameterError: They do not.
    """
    if isinstance(values, str):
        raise ParameterError(f"{name} = {values!r} must be a list of names: [{values!r}].")
    if not isinstance(values, list | tuple) or not all(isinstance(one, str) for one in values):
        raise ParameterError(f"{name} = {shown(values)} must be a list of names, as texts.")


def checked_names(
    name: str, values: Any, failure: type[TorosError] = ParameterError
) -> tuple[str, ...]:
    """Return different names, which come as a list, as a tuple.

    Raises:
        TorosError: Of the type `failure`: they are a lone text, no list of texts, or two are equal.
    """
    listed = isinstance(values, list | tuple | np.ndarray) and not isinstance(values, str)
    if not listed or not all(isinstance(one, str) for one in values):
        raise failure(f"{name} = {shown(values)} must be a list of names, as texts.")
    names = tuple(str(one) for one in values)
    twice = next((one for one in names if names.count(one) > 1), None)
    if twice is not None:
        raise failure(f"{name} holds {twice!r} twice; each name must be different.")
    return names


def require_flag(**values: Any) -> None:
    """Check that each value is True or False.

    Raises:
        ParameterError: Naming the value.
    """
    for name, value in values.items():
        if not isinstance(value, bool | np.bool_):
            raise ParameterError(f"{name} = {shown(value)} must be True or False.")


def require_kind(
    name: str,
    value: Any,
    kind: type | tuple[type, ...],
    what: str,
    failure: type[TorosError] = ParameterError,
) -> None:
    """Check that a value is of a type.

    Args:
        name: Name of the value.
        value: The value.
        kind: The type, or several.
        what: What it must be, with the remedy: "a Composite, by Composite(…)".
        failure: Type of the error.

    Raises:
        TorosError: Of the type `failure`: the value is of another type.
    """
    if not isinstance(value, kind):
        raise failure(f"{name} = {shown(value)} must be {what}.")


def checked_path(name: str, value: Any, failure: type[TorosError] = ParameterError) -> Path:
    """Return the path of a file or folder.

    Raises:
        TorosError: Of the type `failure`: it is no text and no path.
    """
    if not isinstance(value, str | os.PathLike) or not str(value):
        raise failure(f"{name} = {shown(value)} must be the path of a file or folder, as text.")
    return Path(value)


def require_callable(name: str, value: Any, what: str) -> None:
    """Check that a value can be called.

    Args:
        name: Name of the value.
        value: The value.
        what: What it must be: "a function of the pattern".

    Raises:
        ParameterError: It cannot.
    """
    if not callable(value):
        raise ParameterError(f"{name} = {shown(value)} must be {what}.")


def checked_floats(
    name: str,
    values: Any,
    what: str,
    fits: Callable[[tuple[int, ...]], bool] | tuple[int, ...],
    *,
    finite: bool = True,
    failure: type[TorosError] = ParameterError,
) -> Floats:
    """Return values as an array of finite real numbers of a shape.

    Args:
        name: Name of the values.
        values: Array, list or number.
        what: The shape and the unit, for messages: "(n, 3), in m".
        fits: The shape, or a function that says whether a shape is allowed.
        finite: Whether NaN and infinite values are refused.
        failure: Type of the error.

    Raises:
        TorosError: Of the type `failure`: the values are no real numbers, of another shape, or not
            finite.
    """
    array = real_numbers(name, values, what, failure)
    allowed = fits(array.shape) if callable(fits) else array.shape == fits
    if not allowed:
        raise failure(f"{name} has shape {array.shape}; it must be {what}.")
    if finite and not np.isfinite(array).all():
        where = np.argwhere(~np.isfinite(array))[0].tolist()
        place = f"[{', '.join(map(str, where))}]" if where else ""
        raise failure(f"{name}{place} = {array[tuple(where)]} is not finite; it must be {what}.")
    return array


def real_numbers(
    name: str, values: Any, what: str, failure: type[TorosError] = ParameterError
) -> Floats:
    """Return values as an array of floats, of any shape.

    Args:
        name, values, what, failure: As of `checked_floats`.

    Raises:
        TorosError: Of the type `failure`: the values are texts, complex, None, or lists of
            different lengths.
    """
    try:
        array = np.asarray(values)
    except (ValueError, TypeError):  # lists of different lengths
        array = np.array(None)
    if array.dtype.kind not in "biuf" or (array.dtype.kind == "b" and not array.ndim):
        raise failure(f"{name} = {shown(values)} must be real numbers, {what}.")
    return array.astype(np.float64, copy=False)


def whole_numbers(
    name: str, values: Any, what: str, failure: type[TorosError] = ParameterError
) -> np.ndarray:
    """Return values as an array of whole numbers, of any shape.

    Args:
        name, values, what, failure: As of `checked_floats`.

    Raises:
        TorosError: Of the type `failure`: a value is not whole, or too large.
    """
    array = real_numbers(name, values, what, failure)
    whole = np.isfinite(array) & (array == np.rint(array)) & (np.abs(array) < 2**53)
    if not whole.all():
        wrong = array[~whole].ravel()[0]
        raise failure(f"{name} holds {wrong:g}; it must hold whole numbers, {what}.")
    return array.astype(np.int64)


def checked_axes(
    name: str,
    values: Any,
    allowed: Sequence[int] = (0, 1, 2),
    failure: type[TorosError] = ParameterError,
) -> tuple[int, ...]:
    """Return axes of planes as a tuple of whole numbers.

    Raises:
        TorosError: Of the type `failure`: they are no list, one is not allowed, or given twice.
    """
    if not isinstance(values, list | tuple | np.ndarray) or np.ndim(values) != 1:
        raise failure(f"{name} = {shown(values)} must be a list of axes, () for none.")
    for axis in values:
        whole = isinstance(axis, int | np.integer) and not isinstance(axis, bool)
        if not whole or axis not in allowed:
            known = ", ".join(f"{one} for {'xyz'[one]} = 0" for one in allowed)
            raise failure(f"{name} holds {shown(axis)}; it may hold {known}.")
    axes = tuple(int(axis) for axis in values)
    if len(set(axes)) < len(axes):
        raise failure(f"{name} = {axes} names an axis twice; each may be given once.")
    return axes
