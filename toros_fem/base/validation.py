"""Types of arrays, and checks of single values: each raises a typed error that names its bounds."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from types import UnionType
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from toros_fem.base.errors import ParameterError, TorosError

Floats: TypeAlias = npt.NDArray[np.float64]
Ints: TypeAlias = npt.NDArray[np.int64]
LocalInts: TypeAlias = npt.NDArray[np.int32]
"""Numbers local to a rank, as dolfinx keeps them."""
Bools: TypeAlias = npt.NDArray[np.bool_]
# Longest text of a value in a message.
LONGEST = 60
# Longest name of a panel, a chamber or a part.
LONGEST_NAME = 200
# Sizes between which numbers are, if they are not 0: squares and cubes of these do not overflow.
SMALL, LARGE = 1e-60, 1e60
# What names are given as: a lone text would be read letter by letter.
NAMES = "names, as texts"
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


def _require(
    values: dict[str, Any], fits: Callable[[Any], bool], what: str, *, whole: bool = False
) -> None:
    """Check that each value is a finite number, a whole one where asked for, that fits."""
    for name, value in values.items():
        number = is_number(value) and not (whole and isinstance(value, float | np.floating))
        fitting = number and math.isfinite(value) and fits(value)
        if not fitting or (value and not SMALL < abs(value) < LARGE):
            sized = f"0, or between {SMALL:g} and {LARGE:g} in size"
            raise ParameterError(f"{name} = {shown(value)} must be {sized if fitting else what}.")


def require_positive(*, at_most: float = math.inf, **values: Any) -> None:
    """Check that each value is a finite number in (0, at_most]."""
    bound = "" if math.isinf(at_most) else f" and at most {at_most:.6g}"
    _require(values, lambda one: 0 < one <= at_most, f"a finite number greater than 0{bound}")


def require_between(low: float, high: float, **values: Any) -> None:
    """Check that each value is a finite number in [low, high]."""
    bound = f"at least {low:g}" if math.isinf(high) else f"between {low:g} and {high:g}"
    _require(values, lambda one: low <= one <= high, f"a finite number, {bound}")


def require_finite(**values: Any) -> None:
    """Check that each value is a finite number."""
    _require(values, math.isfinite, "a finite number")


def require_count(least: int, *, at_most: float = math.inf, **values: Any) -> None:
    """Check that each value is a whole number in [least, at_most]."""
    bound = "" if math.isinf(at_most) else f" and at most {at_most}"
    what = f"a whole number, at least {least}{bound}"
    _require(values, lambda one: least <= one <= at_most, what, whole=True)


def require_choice(name: str, value: Any, choices: Sequence[str]) -> None:
    """Check that a value is one of the given words."""
    if not isinstance(value, str) or value not in choices:
        known = ", ".join(map(repr, choices))
        raise ParameterError(f"{name} = {shown(value)} must be one of {known}.")


def require_flag(**values: Any) -> None:
    """Check that each value is True or False."""
    for name, value in values.items():
        if not isinstance(value, bool | np.bool_):
            raise ParameterError(f"{name} = {shown(value)} must be True or False.")


def require_kind(name: str, value: Any, kind: type | tuple[type, ...], what: str) -> None:
    """Check that a value is of a type, or one of several.

    `what` it must be comes with the remedy: "a Composite, by Composite(…)".
    """
    if not isinstance(value, kind):
        raise ParameterError(f"{name} = {shown(value)} must be {what}.")


def require_callable(name: str, value: Any, what: str) -> None:
    """Check that a value can be called; `what` says of what it is a function."""
    require_kind(name, value, Callable, what)  # type: ignore[arg-type]


def checked_list(
    name: str,
    values: Any,
    kind: type | UnionType,
    what: str,
    failure: type[TorosError] = ParameterError,
    *,
    least: int = 0,
) -> tuple[Any, ...]:
    """Return a list as a tuple, checked to hold `least` values of a type, `what` in the plural."""
    listed = isinstance(values, list | tuple) and len(values) >= least
    if not listed or not all(isinstance(one, kind) for one in values):
        raise failure(f"{name} = {shown(values)} must be a list of {what}.")
    return tuple(values)


def checked_names(
    name: str, values: Any, failure: type[TorosError] = ParameterError, *, least: int = 0
) -> tuple[str, ...]:
    """Return names as a tuple, checked to be a list of `least` texts at least, all different."""
    given = list(values) if isinstance(values, np.ndarray) else values
    names = tuple(map(str, checked_list(name, given, str, NAMES, failure, least=least)))
    for one in names:
        if not one.isprintable() or len(one) > LONGEST_NAME or names.count(one) > 1:
            raise failure(
                f"{name} holds {shown(one)}{' twice' if names.count(one) > 1 else ''}; names are "
                f"printable, of at most {LONGEST_NAME} characters, and all different."
            )
    return names


def checked_path(name: str, value: Any, failure: type[TorosError] = ParameterError) -> Path:
    """Return the path of a file or folder, checked to be a text or a path."""
    if not isinstance(value, str | os.PathLike) or not str(value):
        raise failure(f"{name} = {shown(value)} must be the path of a file or folder, as text.")
    return Path(value)


def checked_floats(
    name: str,
    values: Any,
    what: str,
    fits: Callable[[tuple[int, ...]], bool] | tuple[int, ...],
    *,
    finite: bool = True,
    failure: type[TorosError] = ParameterError,
) -> Floats:
    """Return values as an array, checked to be real numbers of a shape, and finite.

    `what` tells shape and unit in messages: "(n, 3), in m". What fits is the shape, or a function
    that says whether a shape is allowed.
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


def checked_bools(name: str, values: Any, what: str, shape: tuple[int, ...]) -> Bools:
    """Return values as an array, checked to be True or False for each of `what`, of a shape."""
    array = np.asarray(values)
    if array.dtype != bool or array.shape != shape:
        raise ParameterError(
            f"{name} is {array.dtype} of shape {array.shape}; it must be True or False for each "
            f"{what}, of shape {shape}."
        )
    return array


def vector(name: str, value: Any) -> Floats:
    """Return a point or direction in space as an array, checked to be three finite numbers."""
    return checked_floats(name, value, "three finite numbers", (3,))


def unit_vector(name: str, value: Any, remedy: str = "one that is not zero") -> Floats:
    """Return a direction in space, three finite numbers and not all zero, as a unit vector."""
    given = vector(name, value)
    length = float(np.linalg.norm(given))
    if length == 0:
        raise ParameterError(f"{name} = {shown(value)} has no direction; give {remedy}.")
    return np.asarray(given / length)


def real_numbers(
    name: str, values: Any, what: str, failure: type[TorosError] = ParameterError
) -> Floats:
    """Return values as an array of floats of any shape; arguments are those of `checked_floats`."""
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
    """Return values as an array of whole numbers; arguments are those of `checked_floats`."""
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
    """Return axes of planes as a tuple, checked to be a list of different, allowed ones."""
    listed = isinstance(values, list | tuple | np.ndarray) and np.ndim(values) == 1
    kinds = (int, np.integer)
    axes = [one for one in values if isinstance(one, kinds) and one in allowed] if listed else []
    if not listed or len(set(axes)) < len(values) or any(isinstance(one, bool) for one in axes):
        known = ", ".join(f"{one} for {'xyz'[one]} = 0" for one in allowed)
        raise failure(
            f"{name} = {shown(values)} must be a list of different axes, {known}; () for none."
        )
    return tuple(map(int, axes))
