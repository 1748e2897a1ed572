"""Keys: type, unit, bounds, meaning and default of each value that a user gives, declared once."""

from __future__ import annotations

import difflib
import functools
import json
import math
import re
import tomllib
import types
import typing
from collections.abc import Iterable, Mapping
from dataclasses import Field, asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NoReturn, Self, get_args, get_origin

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.units import read_quantity, write_quantity
from toros_fem.base.validation import LONGEST, is_number, shown

# The word for None, and the largest whole number, far beyond what makes sense.
NONE, LARGEST = "none", 10**15
# Most of what is counted from 1 on: steps, tiles, copies.
MANY = 100_000
# Sizes that quantities have, by their units: of what must be positive the least, and of all the
# largest. What lies beyond would overflow, or ask for more memory than there is.
SIZES: Mapping[str | None, tuple[float, float]] = {
    "m": (5e-9, 1e3),
    "m²": (1e-14, 1e6),
    "Pa": (1e-6, 1e15),
    "deg": (1e-9, 1e5),
    "%": (1e-9, 1e6),
    None: (1e-12, 1e12),
}
OTHERS = (1e-12, 1e12)
# Least size of what may be 0: rounding leaves such numbers.
TINY = 1e-50
# Types that a value may come in, where it is not that of the key alone.
TYPES: Mapping[type, tuple[type, ...]] = {
    float: (int, float, np.integer, np.floating),
    int: (int, np.integer),
    Path: (str, Path),
}
WORDS: Mapping[type, str] = {
    float: "a finite number",
    int: "a whole number",
    bool: "true or false",
    str: "a text in quotes",
    Path: "a path in quotes",
    tuple: "two finite numbers, as in [1.0, 1.5]",
}
# What a key needs to count: another key of its scene, and values that let it; (): any but none.
Need = tuple[str, tuple[Any, ...]]
# Units of metrics that are written in another way than those of keys.
METRIC_UNITS = {None: "ratio", "%": "percent"}


@dataclass(frozen=True)
class In:
    """Unit and bounds of a number, which its type carries.

    Attributes:
        unit: SI unit, or "deg" or "%"; None for pure numbers.
        above, at_least, below, at_most: Bounds; infinite where there is none.
    """

    unit: str | None = None
    above: float = -math.inf
    at_least: float = -math.inf
    below: float = math.inf
    at_most: float = math.inf

    def __contains__(self, value: float) -> bool:
        inside = self.above < value < self.below and self.at_least <= value <= self.at_most
        return math.isfinite(value) and inside

    def __str__(self) -> str:
        names = ("above", "at_least", "below", "at_most")
        bounds = ((name.replace("_", " "), getattr(self, name)) for name in names)
        return " and ".join(f"{word} {end:g}" for word, end in bounds if math.isfinite(end))


@dataclass(frozen=True)
class OneOf:
    """The words that a text may be, which its type carries."""

    words: tuple[str, ...]


Length = Annotated[float, In("m", above=0)]
Distance = Annotated[float, In("m", at_least=0)]
Place = Annotated[float, In("m")]
Modulus = Annotated[float, In("Pa", above=0)]
Pressure = Annotated[float, In("Pa", at_least=0)]
Angle = Annotated[float, In("deg")]
Stretch = Annotated[float, In(above=1)]
Positive = Annotated[float, In(above=0)]
Factor = Annotated[float, In(at_least=0)]
Fraction = Annotated[float, In(above=0, at_most=1)]
Poisson = Annotated[float, In(at_least=0, at_most=0.5)]
Count = Annotated[int, In(at_least=1)]
Number = Annotated[int, In(at_least=0)]


def key(default: Any, meaning: str, *, metric: str | None = None, free: bool = False) -> Any:
    """Return the dataclass field of a key: its default, and its meaning in one line.

    A default of `dataclasses.MISSING` is none: the value must be given. `metric` names the metric
    whose target the key holds, in the key's unit; `free` is that of `Key`.
    """
    return field(default=default, metadata={"meaning": meaning, "metric": metric, "free": free})


@dataclass(frozen=True)
class Key:
    """What is known of a key.

    Attributes:
        name: Its name, in files and in Python.
        kind: float, int, bool, str, Path, tuple for two floats, or the class of a table.
        meaning: One line, without unit and bounds.
        default: Value where none is given; MISSING where one must be.
        optional: Whether it may be None, "none" in files.
        within: Unit and bounds of a number.
        words: The words that a text may be; empty for free text.
        several: Whether it holds a tuple of values of its kind.
        metric: Name of the metric whose target it holds; None for other keys.
        free: Whether it may change in a run that goes on: it says how far the design goes, or what
            is told of it, and not what is designed.
    """

    name: str
    kind: type
    meaning: str
    default: Any = None
    optional: bool = False
    within: In = In()
    words: tuple[str, ...] = ()
    several: bool = False
    metric: str | None = None
    free: bool = False

    @property
    def one(self) -> Key:
        """The key of one of several values."""
        return replace(self, several=False)

    @property
    def ending(self) -> str:
        """Its unit at the end of the names of columns, "deg" or "pa" for instance."""
        unit = self.within.unit
        return METRIC_UNITS.get(unit, str(unit).lower())

    @property
    def metric_key(self) -> str | None:
        """Key of the metric whose target it holds, "angle_deg" for instance: of the same unit."""
        return self.metric and f"{self.metric}_{self.ending}"

    @property
    def help(self) -> str:
        """Meaning, unit, bounds, and whether it may be none, for files, options and pages."""
        unit = f"in {self.within.unit}" if self.within.unit else ""
        truth = WORDS[bool] if self.kind is bool else ""
        bounds = "one of " + ", ".join(self.words) if self.words else str(self.within)
        text = "; ".join(filter(None, [self.meaning, unit, truth, bounds]))
        if not self.optional or re.search(rf"\b{NONE}\b", self.meaning):
            return text
        return f"{text}{',' if bounds else ';'} or {NONE}"

    def checked(self, value: Any) -> Any:
        """Return a value in its type, or refuse it: numpy's numbers become plain, as for JSON."""
        if value is None and self.optional:
            return None
        if self.several:
            if not isinstance(value, list | tuple):
                self.refuse(value, "must be a list")
            return tuple(map(self.one.checked, value))
        if self.kind is tuple:
            return self._pair(value)
        fits = isinstance(value, TYPES.get(self.kind, self.kind))
        if not fits or isinstance(value, bool) != (self.kind is bool):
            self.refuse(value)
        if self.kind in (float, int):
            return self._number(value)
        if self.words and value not in self.words:
            self.refuse(value)
        if self.kind is Path and (not str(value) or "\0" in str(value)):
            self.refuse(value)
        return Path(value) if self.kind is Path else value

    def _pair(self, value: Any) -> tuple[float, float]:
        ends = value.tolist() if isinstance(value, np.ndarray) else value
        numbers = isinstance(ends, list | tuple) and [is_number(one) for one in ends]
        if numbers != [True, True] or not all(map(math.isfinite, ends)):
            self.refuse(value)
        return float(ends[0]), float(ends[1])

    def _number(self, value: Any) -> float:
        if isinstance(value, int) and abs(value) > LARGEST:
            self.refuse(value, f"must have less than {len(str(LARGEST))} digits")
        if self.kind is int and self.within.at_least >= 1 and value > MANY:
            self.refuse(value, f"must be at most {MANY}")
        number: float = self.kind(value)
        if number not in self.within:
            self.refuse(value)
        least, most = sizes_of(self)
        tiny = 0 < abs(number) < least
        if self.kind is float and (tiny or abs(number) > most):
            unit = f" {self.within.unit}" * (self.within.unit is not None)
            ends = f"at least {least:g}{unit}" if tiny else f"at most {most:g}{unit}"
            made = ": no such thing is made" * (self.within.unit is not None)
            self.refuse(value, f"must be {ends}{made}")
        return number

    def refuse(self, value: Any, why: str = "") -> NoReturn:
        """Raise the ParameterError of a value; without a reason it tells what the key takes."""
        unit, number = self.within.unit, is_number(value)
        what = WORDS.get(self.kind, f"a {self.kind.__name__}")
        if self.words:
            what = "one of " + ", ".join(map(repr, self.words))
        elif unit and not number:
            what += f" in {unit}"
        parts = filter(None, [what, str(self.within), f"or {NONE}" if self.optional else ""])
        why = why or f"must be {', '.join(parts)}"
        word = value[:LONGEST] if isinstance(value, str) else ""
        near = difflib.get_close_matches(word, self.words)
        end = f"; did you mean {near[0]!r}?" if near else "."
        given = f"{shown(value)} {unit}" if unit and number else shown(value)
        raise ParameterError(f"{self.name} = {given} {why}{end}", self.name)

    def read(self, value: Any) -> Any:
        """Return a value, checked, from what a file or command line holds: 0.3, "5 kPa", "none"."""
        if self.optional and isinstance(value, str) and value.lower() == NONE:
            return None
        if self.several and isinstance(value, list | tuple):
            return tuple(map(self.one.read, value))
        if self.kind is float and isinstance(value, str):
            try:
                value = read_quantity(value, self.within.unit)
            except ParameterError as caught:
                raise ParameterError(str(caught), self.name) from None
        return self.checked(value)

    def written(self, value: Any) -> str:
        """Return a value as a file holds it, in a handy unit."""
        if self.several and value is not None:
            return f"[{', '.join(map(self.one.written, value))}]"
        if value is None or isinstance(value, str | Path):
            return quoted(NONE if value is None else str(value))
        if isinstance(value, bool):
            return str(value).lower()
        if isinstance(value, tuple):
            return f"[{', '.join(map(repr, value))}]"
        if isinstance(value, float) and self.within.unit is not None:
            return f'"{write_quantity(value, self.within.unit)}"'
        return repr(value)


def sizes_of(key: Key) -> tuple[float, float]:
    """Return the least and the largest size of a number of a key, if it is not 0."""
    least, most = SIZES.get(key.within.unit, OTHERS)
    return least if key.within.above == 0 else TINY, most


def quoted(text: str) -> str:
    """Return a text as a TOML string; JSON's rules are those of TOML for all but one character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def plain_value(text: str) -> Any:
    """Return a value of a command line as TOML would read it; what is none is text."""
    text = text.strip()
    try:
        return tomllib.loads(f"value = {text}")["value"] if "\n" not in text else text
    except (ValueError, RecursionError):
        return text


@dataclass(frozen=True)
class Table:
    """Base of all settings: frozen, and checked on construction, by type and by bounds.

    A field is made by `key`. Its type is float, int, bool, str, Path or two floats, one of these or
    None, several of one of them, or one with unit and bounds, as `Length`; in tables that stand in
    no file also another table, or several. Validation, files, command lines and pages read this one
    place.

    Raises:
        ParameterError: A name is unknown, a value has another type, or it is outside its bounds.
    """

    def __new__(cls, *args: Any, **values: Any) -> Self:
        """Return new settings, if all names are known."""
        cls._require_known(values)
        return super().__new__(cls)

    def __post_init__(self) -> None:
        for name, one in self.described().items():
            object.__setattr__(self, name, one.checked(getattr(self, name)))

    @classmethod
    def described(cls) -> Mapping[str, Key]:
        """Return what is known of each key, by name."""
        return _keys(cls)  # type: ignore[arg-type]

    @classmethod
    def holds(cls) -> str:
        """Return what the table holds: the first line of its docstring."""
        return (cls.__doc__ or cls.__name__).partition("\n")[0].rstrip(".")

    def updated(self, **changes: Any) -> Self:
        """Return a copy with other values; a ParameterError suggests the nearest known name."""
        self._require_known(changes)
        return replace(self, **changes)

    def value(self, name: str) -> Any:
        """Return the value of a key."""
        return getattr(self, name)

    def as_dict(self) -> dict[str, Any]:
        """Return all values by name, as summaries hold them."""
        return asdict(self)

    @classmethod
    def of_dict(cls, values: Mapping[str, Any]) -> Self:
        """Return the settings that `as_dict` described."""
        cls._require_known(values)
        described = cls.described()

        def made(name: str, value: Any) -> Any:
            kind = described[name].kind
            if described[name].several and isinstance(value, list | tuple):
                return [made_one(kind, one) for one in value]
            return made_one(kind, value)

        def made_one(kind: type, value: Any) -> Any:
            if not (isinstance(value, dict) and is_dataclass(kind)):
                return value
            return kind.of_dict(value) if issubclass(kind, Table) else kind(**value)

        return cls(**{name: made(name, value) for name, value in values.items()})

    @classmethod
    def _require_known(cls, names: Iterable[str]) -> None:
        known = cls.__dataclass_fields__
        for name in names:
            if name not in known:
                raise ParameterError(f"unknown parameter {name!r}; {nearest(name, known)}", name)


def meant(word: Any, known: Iterable[str]) -> str | None:
    """Return the known word that is most similar to an unknown one; None without a similar one."""
    words, name = list(known), str(word)[:LONGEST]
    # "fabric_thickness" is "thickness", rather than "bladder_thickness".
    if ends := [one for one in words if name.endswith(f"_{one}")]:
        return max(ends, key=len)
    return next(iter(difflib.get_close_matches(name, words, n=1)), None)


def nearest(word: Any, known: Iterable[str], otherwise: str = "") -> str:
    """Return the advice for an unknown word: the nearest known one, by default all of them."""
    words = list(known)
    if near := meant(word, words):
        return f"did you mean {near!r}?"
    every = f"known are {', '.join(words)}." if words else "none is known here."
    return otherwise or every


@functools.cache
def _keys(table: type[Table]) -> Mapping[str, Key]:
    """Return the keys of a table; a TypeError where the table itself is wrong."""
    hints = typing.get_type_hints(table, include_extras=True)
    return types.MappingProxyType(
        {one.name: _key(table.__name__, one, hints[one.name]) for one in fields(table)}
    )


def _key(table: str, one: Field[Any], hint: Any) -> Key:
    """Return the key of a field, from its type: Length, Poisson | None, tuple[str, ...]."""
    parts = get_args(hint) if get_origin(hint) in (typing.Union, types.UnionType) else (hint,)
    kind = next(part for part in parts if part is not types.NoneType)
    if several := get_args(kind)[1:] == (...,):
        kind = get_args(kind)[0]
    kind, limits = get_args(kind)[:2] if get_origin(kind) is Annotated else (kind, None)
    kind = tuple if kind == tuple[float, float] else kind
    if not (kind in WORDS or is_dataclass(kind)) or "meaning" not in one.metadata:
        raise TypeError(
            f"{table}.{one.name} must be a float, int, bool, str or Path (or None), several of one "
            "of these, two floats or a table, with its default and meaning given by key(…)."
        )
    return Key(
        one.name,
        kind,
        one.metadata["meaning"],
        one.default,
        optional=types.NoneType in parts,
        within=limits if isinstance(limits, In) else In(),
        words=limits.words if isinstance(limits, OneOf) else (),
        several=several,
        metric=one.metadata.get("metric"),
        free=one.metadata.get("free", False),
    )
