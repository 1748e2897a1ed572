"""Configurations: frozen dataclasses whose fields carry meaning, unit and bounds as data."""

from __future__ import annotations

import dataclasses
import difflib
import math
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self, Union, get_args, get_origin

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import require_choice

KEY, ENTRIES = "quantity", "entries"
KINDS = {float: "a number", int: "a whole number", bool: "True or False", str: "a word"}


@dataclass(frozen=True)
class Quantity:
    """Meaning, unit and allowed values of a field of a configuration.

    Attributes:
        meaning: One line, without its unit.
        unit: SI unit, or "deg" or "%" where the field's name says so; None for pure numbers.
        above, at_least, below, at_most: Bounds; None where there is none.
        choices: The words that are allowed; None for numbers and free text.
    """

    meaning: str
    unit: str | None = None
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    choices: tuple[str, ...] | None = None

    @property
    def bounds(self) -> str:
        """The allowed values in words; empty where all are."""
        if self.choices is not None:
            return "one of " + ", ".join(self.choices)
        parts = [
            f"{word} {value:g}"
            for word, value in (
                ("above", self.above),
                ("at least", self.at_least),
                ("below", self.below),
                ("at most", self.at_most),
            )
            if value is not None
        ]
        return " and ".join(parts)

    def check(self, name: str, value: float) -> None:
        """Check that a number is finite and within the bounds.

        Raises:
            ParameterError: Naming value, unit and bounds.
        """
        outside = (
            not math.isfinite(value)
            or (self.above is not None and not value > self.above)
            or (self.at_least is not None and not value >= self.at_least)
            or (self.below is not None and not value < self.below)
            or (self.at_most is not None and not value <= self.at_most)
        )
        if outside:
            unit = f" {self.unit}" if self.unit else ""
            bounds = f", {self.bounds}" if self.bounds else ""
            raise ParameterError(f"{name} = {value}{unit} must be a finite number{bounds}.")


def quantity(
    default: Any,
    meaning: str,
    unit: str | None = None,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    choices: Sequence[str] | None = None,
) -> Any:
    """Return a dataclass field with its default and its `Quantity`."""
    words = None if choices is None else tuple(choices)
    spec = Quantity(meaning, unit, above, at_least, below, at_most, words)
    return field(default=default, metadata={KEY: spec})


def entries(of: type[Config], meaning: str) -> Any:
    """Return a dataclass field that holds any number of configurations of a type, by default none.

    Args:
        of: Their type.
        meaning: What each of them is, in one line.
    """
    return field(default=(), metadata={ENTRIES: (of, meaning)})


@dataclass(frozen=True)
class Config:
    """Base of all configurations: values are checked on construction, by type and by bounds.

    Each field is made by `quantity`. Its type is float, int, bool or str, or one of these or None.
    Validation, command line, summaries and files all read this one place. A field made by `entries`
    is a tuple of other configurations, which may also come as mappings; only files hold these.

    Raises:
        ParameterError: A name is unknown, a value has another type, or it is outside its bounds.
    """

    def __new__(cls, *args: Any, **values: Any) -> Self:
        """Return a new configuration, if all names are known."""
        for name in values:
            require_known(name, cls.__dataclass_fields__)
        return super().__new__(cls)

    def __post_init__(self) -> None:
        for name, (kind, optional) in self.kinds().items():
            value = getattr(self, name)
            if value is None and optional:
                continue
            _check_kind(name, value, kind, optional=optional)
            spec = self.quantity(name)
            if kind in (float, int):  # numpy's numbers become plain ones, which JSON can hold
                object.__setattr__(self, name, kind(value))
            if spec.choices is not None:
                require_choice(name, value, spec.choices)
            elif kind in (float, int):
                spec.check(name, value)
        for name, (of, _) in self.entries().items():
            object.__setattr__(self, name, _entries(name, getattr(self, name), of))

    @classmethod
    def entries(cls) -> dict[str, tuple[type[Config], str]]:
        """Return type and meaning of each field made by `entries`."""
        found = {entry.name: entry.metadata.get(ENTRIES) for entry in fields(cls)}
        return {name: of for name, of in found.items() if of is not None}

    @classmethod
    def quantity(cls, name: str) -> Quantity:
        """Return meaning, unit and allowed values of a field."""
        found: Quantity = cls.__dataclass_fields__[name].metadata[KEY]
        return found

    @classmethod
    def redefault(cls, name: str, default: Any) -> Any:
        """Return a field of this configuration with another default, for a derived class."""
        return field(default=default, metadata={KEY: cls.quantity(name)})

    @classmethod
    def kinds(cls) -> dict[str, tuple[type, bool]]:
        """Return the type of each field but those made by `entries`, and whether it may be None.

        Raises:
            TypeError: The class itself is wrong: a field has another type than float, int, bool or
                str, or was not made by `quantity`.
        """
        hints = typing.get_type_hints(cls)
        plain = [entry for entry in fields(cls) if ENTRIES not in entry.metadata]
        found = {entry.name: _kind(hints[entry.name]) for entry in plain}
        for entry in plain:
            if found[entry.name][0] not in KINDS or KEY not in entry.metadata:
                raise TypeError(
                    f"{cls.__name__}.{entry.name} must be a float, int, bool or str (or None), "
                    "with its default, meaning and unit given by quantity(…)."
                )
        return found

    def updated(self, **changes: Any) -> Self:
        """Return a copy with other values.

        Raises:
            ParameterError: A name is unknown; the nearest known one is suggested.
        """
        for name in changes:
            require_known(name, self.__dataclass_fields__)
        return replace(self, **changes)

    def as_dict(self) -> dict[str, Any]:
        """Return all values by name, as summaries hold them."""
        return dataclasses.asdict(self)


def require_known(name: str, known: Mapping[str, Any] | Sequence[str]) -> None:
    """Check that a name is known.

    Raises:
        ParameterError: It is not; the message suggests the nearest one, or lists all.
    """
    if name in known:
        return
    near = difflib.get_close_matches(name, list(known), n=1)
    advice = f"did you mean {near[0]!r}?" if near else "known are " + ", ".join(known) + "."
    raise ParameterError(f"unknown parameter {name!r}; {advice}")


def _entries(name: str, values: Any, of: type[Config]) -> tuple[Config, ...]:
    """Return the entries of a field, those that come as mappings made to configurations.

    Raises:
        ParameterError: They are no list, or one of them is something else.
    """
    if not isinstance(values, list | tuple):
        raise ParameterError(f"{name} = {values!r} must be a list of {of.__name__}.")
    made = [of(**value) if isinstance(value, Mapping) else value for value in values]
    for value in made:
        if type(value) is not of:
            raise ParameterError(f"{name} has {value!r} in it; it must be a {of.__name__}.")
    return tuple(made)


def _kind(hint: Any) -> tuple[Any, bool]:
    """Return the type that a hint names, and whether it allows None."""
    if get_origin(hint) in (Union, types.UnionType):
        kinds = [part for part in get_args(hint) if part is not type(None)]
        if len(kinds) == 1:
            return kinds[0], True
    return hint, False


def _check_kind(name: str, value: Any, kind: type, *, optional: bool) -> None:
    number = isinstance(value, int | float | np.integer | np.floating)
    number = number and not isinstance(value, bool)
    good = {
        float: number,
        int: number and not isinstance(value, float | np.floating),
        bool: isinstance(value, bool),
        str: isinstance(value, str),
    }[kind]
    if not good:
        none = ", or None" if optional else ""
        raise ParameterError(f"{name} = {value!r} must be {KINDS[kind]}{none}.")
