"""Settings: type, unit, bounds, meaning and default of each value that a user gives, said once."""

from __future__ import annotations

import dataclasses
import difflib
import functools
import json
import math
import re
import tomllib
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from decimal import Decimal, localcontext
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Self, dataclass_transform, get_args, get_origin

import numpy as np
import pydantic.dataclasses
from pydantic import BeforeValidator, ConfigDict, Field, Strict, TypeAdapter, ValidationError
from pydantic_core import CoreSchema, ErrorDetails, core_schema

from toros_fem.base.errors import ParameterError
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
# A number in a text, for editors.
NUMBER = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*"
CONFIG = ConfigDict(arbitrary_types_allowed=True, extra="forbid")
# What each unit of a field measures, and all units that are read, as multiples of it.
_TABLE = {
    "m": ("a length", "m 1, cm 1e-2, mm 1e-3, um 1e-6, µm 1e-6, in 0.0254"),
    "m²": ("an area", "m² 1, m2 1, cm² 1e-4, cm2 1e-4, mm² 1e-6, mm2 1e-6"),
    "Pa": (
        "a pressure or a modulus",
        "Pa 1, hPa 1e2, kPa 1e3, MPa 1e6, GPa 1e9, mbar 1e2, bar 1e5, psi 6894.757293168361, "
        "N/mm² 1e6, N/mm2 1e6",
    ),
    "deg": ("an angle", f"deg 1, ° 1, rad {Decimal(180) / Decimal(repr(math.pi))}"),
    "kg": ("a mass", "kg 1, g 1e-3, mg 1e-6"),
    "kg/m²": ("a mass per area", "kg/m² 1, kg/m2 1, g/m² 1e-3, g/m2 1e-3"),
    "kg/m³": ("a density", "kg/m³ 1, kg/m3 1, g/cm³ 1e3, g/cm3 1e3"),
    "N": ("a force", "N 1, mN 1e-3, cN 1e-2, kN 1e3"),
    "N/m": ("a force per length", "N/m 1, N/cm 1e2, N/mm 1e3, kN/m 1e3"),
    "%": ("a fraction", "% 1"),
}
# The same with numbers: Decimal, so that "0.6 mm" is the same number as 0.6e-3.
DIMENSIONS: Mapping[str, tuple[str, Mapping[str, Decimal]]] = MappingProxyType(
    {
        unit: (what, {word: Decimal(by) for word, by in map(str.split, known.split(", "))})
        for unit, (what, known) in _TABLE.items()
    }
)
# Units that templates show, from small to large, where it is not the field's own.
SHOWN = {"m": ("mm",), "m²": ("mm²",), "Pa": ("Pa", "kPa", "MPa"), "kg": ("g",), "kg/m²": ("g/m²",)}
# Characters of the longest text that is a number with a unit.
LONGEST_QUANTITY = 200
_VALUE = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")


@dataclass(frozen=True)
class In:
    """Unit and bounds of a number, which its type carries: `Annotated[float, In("m", above=0)]`.

    The number may come as a text with a unit, "5 kPa", and in a type of NumPy.

    Attributes:
        unit: SI unit, or "deg" or "%"; None for pure numbers.
        above, at_least, below, at_most: Bounds; infinite where there is none.
    """

    unit: str | None = None
    above: float = -math.inf
    at_least: float = -math.inf
    below: float = math.inf
    at_most: float = math.inf

    # The words of pydantic for these bounds.
    WORDS: ClassVar = {"above": "gt", "at_least": "ge", "below": "lt", "at_most": "le"}

    @property
    def bounds(self) -> dict[str, float]:
        """Those that are finite, by name."""
        every = {name: getattr(self, name) for name in self.WORDS}
        return {name: bound for name, bound in every.items() if math.isfinite(bound)}

    @property
    def sizes(self) -> tuple[float, float]:
        """The least and the largest size of a number that is not 0."""
        least, most = SIZES.get(self.unit, OTHERS)
        return least if self.above == 0 else TINY, most

    def __contains__(self, value: float) -> bool:
        inside = self.above < value < self.below and self.at_least <= value <= self.at_most
        return math.isfinite(value) and inside

    def __str__(self) -> str:
        return " and ".join(f"{k.replace('_', ' ')} {end:g}" for k, end in self.bounds.items())

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        number: Any = {self.WORDS[name]: bound for name, bound in self.bounds.items()}
        sized: Callable[[Any], Any]
        if source is int:
            inner: CoreSchema = core_schema.int_schema(strict=True, **number)
            read, sized = _plain, self._counted
        else:
            inner = core_schema.float_schema(strict=True, allow_inf_nan=False, **number)
            read, sized = self._read, self._sized
        after = core_schema.no_info_after_validator_function(sized, inner)
        return core_schema.no_info_before_validator_function(read, after)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: Any) -> dict[str, Any]:
        """Return the schema of a number, or of a text with a unit: its bounds are not said."""
        number: dict[str, Any] = handler(schema)
        if number["type"] == "integer":
            return number
        units = ["%"] if self.unit is None else DIMENSIONS[self.unit][1]
        pattern = f"{NUMBER}({'|'.join(map(re.escape, units))})\\s*$"
        return {"anyOf": [number, {"type": "string", "pattern": pattern}]}

    def _read(self, value: Any) -> Any:
        if not isinstance(value, str):
            return _plain(value)
        found = quantity(value, self.unit)
        if isinstance(found, str):
            raise ParameterError(found)
        return found

    def _counted(self, number: int) -> int:
        if self.at_least >= 1 and number > MANY:
            raise ParameterError(f"must be at most {MANY}")
        return number

    def _sized(self, number: float) -> float:
        least, most = self.sizes
        tiny = 0 < abs(number) < least
        if tiny or abs(number) > most:
            unit = f" {self.unit}" * (self.unit is not None)
            ends = f"at least {least:g}{unit}" if tiny else f"at most {most:g}{unit}"
            made = ": no such thing is made" * (self.unit is not None)
            raise ParameterError(f"must be {ends}{made}")
        return number


def _plain(value: Any) -> Any:
    """Return a number of NumPy as one of Python; whole numbers are not longer than `LARGEST`."""
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, int) and abs(value) > LARGEST:
        raise ParameterError(f"must have less than {len(str(LARGEST))} digits")
    return value


@dataclass(frozen=True)
class OneOf:
    """The words that a text may be, which its type carries."""

    words: tuple[str, ...]

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return core_schema.literal_schema(list(self.words))


def _path(value: Any) -> Any:
    if not isinstance(value, str | Path) or not str(value) or "\0" in str(value):
        raise ParameterError("")
    return value


Flag = Annotated[bool, Strict()]
Text = Annotated[str, Strict()]
File = Annotated[Path, BeforeValidator(_path)]
Real = Annotated[float, In()]
Length = Annotated[float, In("m", above=0)]
Distance = Annotated[float, In("m", at_least=0)]
Place = Annotated[float, In("m")]
Area = Annotated[float, In("m²", above=0)]
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
    about = {"description": meaning, "metric": metric, "free": free}
    return field(default=default, metadata=about)


@dataclass(frozen=True)
class Key:
    """What is known of a key.

    Attributes:
        name: Its name, in files and in Python.
        hint: Its type, with unit and bounds.
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
    hint: Any
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
        if not self.several:
            return self
        hint = get_args(self.hint)[0]
        return replace(self, hint=hint, several=False, optional=_without_none(hint)[1])

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

    @property
    def file_hint(self) -> Any:
        """Its type in files and on command lines, where a word stands for None."""
        return Annotated[self.hint, _OrNone()] if self.optional else self.hint

    def read(self, value: Any) -> Any:
        """Return a value from what a file or command line holds: 0.3, "5 kPa", "none"."""
        try:
            return _reader(self.file_hint).validate_python(value)
        except ValidationError as caught:
            raise refused({self.name: self}, caught, (self.name,)) from None

    def refusal(self, value: Any, why: str = "") -> ParameterError:
        """Return the error of a value; without a reason it tells what the key takes."""
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
        end = f"; did you mean {near[0]!r}?" if near else "" if why[-1] in ".?" else "."
        given = f"{shown(value)} {unit}" if unit and number else shown(value)
        return ParameterError(f"{self.name} = {given} {why}{end}", self.name)

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


@dataclass_transform(frozen_default=True)
class Table:
    """Base of all settings: frozen dataclasses of pydantic, checked on construction.

    A field is made by `key`. Its type is `Flag`, `Text`, `File`, a number with unit and bounds as
    `Length`, one of words as `Annotated[str, OneOf(…)]`, a pair of `Real`, a tuple of one of them,
    or one of them or None; in tables that stand in no file also another table. Validation, files,
    command lines and pages read this one place.

    Raises:
        ParameterError: A name is unknown, a value has another type, or it is outside its bounds.
    """

    def __init_subclass__(cls, *, kw_only: bool = False) -> None:
        super().__init_subclass__()
        pydantic.dataclasses.dataclass(cls, frozen=True, kw_only=kw_only, config=CONFIG)
        made = cls.__init__

        @functools.wraps(made)
        def checked(self: Table, *args: Any, **values: Any) -> None:
            try:
                made(self, *args, **values)
            except ValidationError as caught:
                raise refused(self._own_keys(), caught) from None

        cls.__init__ = checked  # type: ignore[assignment, method-assign]

    @classmethod
    def described(cls) -> Mapping[str, Key]:
        """Return what is known of each key, by name."""
        return _keys(cls)  # type: ignore[arg-type]

    @classmethod
    def _own_keys(cls) -> Mapping[str, Key]:
        """Return what is known of each of its fields, by name."""
        return cls.described()

    @classmethod
    def holds(cls) -> str:
        """Return what the table holds: the first line of its docstring."""
        return (cls.__doc__ or cls.__name__).partition("\n")[0].rstrip(".")

    def updated(self, **changes: Any) -> Self:
        """Return a copy with other values; a ParameterError suggests the nearest known name."""
        return replace(self, **changes)  # type: ignore[type-var]

    def as_dict(self) -> dict[str, Any]:
        """Return all values by name, as summaries hold them."""
        return asdict(self)  # type: ignore[call-overload]


def given_of(name: str, about: str, keys: Mapping[str, Key]) -> Any:
    """Return the type of the keys that a table of a file gives, none of which it must."""
    told = {n: Annotated[one.file_hint, Field(description=one.help)] for n, one in keys.items()}
    return typed(name, about, told)


def typed(name: str, about: str, content: Mapping[str, Any]) -> Any:
    """Return a TypedDict, which knows no other keys than its own."""
    make: Any = typing.TypedDict
    made = make(name, dict(content), total=False)
    made.__doc__, made.__pydantic_config__ = about, CONFIG
    return made


def refused(
    keys: Mapping[str, Key], caught: ValidationError, at: tuple[str, ...] = ()
) -> ParameterError:
    """Return the error that tells all values that pydantic refuses, a line each.

    `at` is where keys of theirs are, if pydantic does not know it.
    """
    errors = [refusal_of(keys, (*at, *one["loc"]), one) for one in caught.errors(include_url=False)]
    return ParameterError("\n".join(map(str, errors)), errors[0].key) if errors[1:] else errors[0]


def refusal_of(
    keys: Mapping[str, Key], place: tuple[int | str, ...], error: ErrorDetails
) -> ParameterError:
    """Return the error of a place: a key, and what leads into its value."""
    cause = error.get("ctx", {}).get("error")
    if not place:
        return cause if isinstance(cause, ParameterError) else ParameterError(error["msg"])
    if error["type"] == "unexpected_positional_argument":
        return ParameterError(f"{len(keys)} values at most are known here: {', '.join(keys)}.")
    # A value without its name has its number.
    name = list(keys)[place[0]] if isinstance(place[0], int) else place[0]
    if name not in keys:
        return ParameterError(f"unknown parameter {name!r}; {nearest(name, keys)}", name)
    one, rest = keys[name], [part for part in place[1:] if isinstance(part, str)]
    if issubclass(one.kind, Table) and rest:
        inner = place[1 + place[1:].index(rest[0]) :]
        return refusal_of(one.kind.described(), inner, error)
    if error["type"].startswith("missing") and len(place) == 1:
        return ParameterError(f"{name} is missing: {one.meaning}.", name)
    if one.several and len(place) == 1 and not isinstance(error["input"], list | tuple):
        return one.refusal(error["input"], "must be a list")
    return one.refusal(error["input"], "" if cause is None else str(cause))


@functools.cache
def _reader(hint: Any) -> TypeAdapter[Any]:
    return TypeAdapter(hint)


class _OrNone:
    """Marks a type in files, which have a word for None."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        def read(value: Any) -> Any:
            return None if isinstance(value, str) and value.lower() == NONE else value

        return core_schema.no_info_before_validator_function(read, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: Any) -> dict[str, Any]:
        ways = handler(schema)["anyOf"]
        return {"anyOf": [{"const": NONE} if one == {"type": "null"} else one for one in ways]}


def meant(word: Any, known: Iterable[str]) -> str | None:
    """Return the known word that is most similar to an unknown one; None without a similar one."""
    words, name = list(known), str(word)[:LONGEST]
    # "fabric_thickness" is "thickness", rather than "bladder_thickness".
    if ends := [one for one in words if name.endswith(f"_{one}")]:
        return max(ends, key=len)
    return next(iter(difflib.get_close_matches(name, words, n=1)), None)


def nearest(word: Any, known: Iterable[str]) -> str:
    """Return the advice for an unknown word: the nearest known one, by default all of them."""
    words = list(known)
    if near := meant(word, words):
        return f"did you mean {near!r}?"
    return f"known are {', '.join(words)}." if words else "none is known here."


@functools.cache
def _keys(table: type[Table]) -> Mapping[str, Key]:
    """Return the keys of a table; a TypeError where the table itself is wrong."""
    hints = typing.get_type_hints(table, include_extras=True)
    return types.MappingProxyType(
        {one.name: _key(table.__name__, one, hints[one.name]) for one in fields(table)}  # type: ignore[arg-type]
    )


def _key(table: str, one: dataclasses.Field[Any], hint: Any) -> Key:
    """Return the key of a field, from its type: Length, Poisson | None, tuple[str, ...]."""
    kind, optional = _without_none(hint)
    if several := get_args(kind)[1:] == (...,):
        kind, _ = _without_none(get_args(kind)[0])
    kind, limits = get_args(kind)[:2] if get_origin(kind) is Annotated else (kind, None)
    kind = tuple if get_origin(kind) is tuple else kind
    if not (kind in WORDS or is_dataclass(kind)) or "description" not in one.metadata:
        raise TypeError(
            f"{table}.{one.name} must be a number, Flag, str or Path (or None), several of one of "
            "these, two numbers or a table, with its default and meaning given by key(…)."
        )
    return Key(
        one.name,
        hint,
        kind,
        one.metadata["description"],
        one.default,
        optional=optional,
        within=limits if isinstance(limits, In) else In(),
        words=limits.words if isinstance(limits, OneOf) else (),
        several=several,
        metric=one.metadata.get("metric"),
        free=one.metadata.get("free", False),
    )


def _without_none(hint: Any) -> tuple[Any, bool]:
    """Return a type without None, and whether it may be None."""
    if get_origin(hint) not in (typing.Union, types.UnionType):
        return hint, False
    return next(part for part in get_args(hint) if part is not types.NoneType), True


# ------------------------------------------------------------------------------ values with units


def spelt(word: str) -> str:
    """Return a unit as `DIMENSIONS` spells it: the micro sign for a Greek mu, "m2" for "m^2"."""
    return word.replace("\N{GREEK SMALL LETTER MU}", "\N{MICRO SIGN}").replace("^", "")


def words_of(unit: str | None) -> Sequence[str]:
    """Return the units that a field takes; None for a pure number."""
    return () if unit is None else tuple(DIMENSIONS[unit][1])


def read_quantity(text: str, unit: str | None) -> float:
    """Return a number with its unit, "0.6 mm" for instance, in the unit of a field.

    The field's is one of `DIMENSIONS`; None for a pure number, which may come in %.

    Raises:
        ParameterError: There is no number, no unit, an unknown unit, or one of something else.
    """
    found = quantity(text, unit)
    if isinstance(found, str):
        raise ParameterError(f"{shown(text)} {found}")
    return found


def quantity(text: str, unit: str | None) -> float | str:
    """Return the number of `read_quantity`, or the end of a sentence that says why it is none."""
    known = "" if unit is None else "; known are " + ", ".join(words_of(unit))
    match = _VALUE.fullmatch(text[: LONGEST_QUANTITY + 1])
    if match is None or len(text) > LONGEST_QUANTITY:
        none = " This value cannot be left out." if text.strip().lower() == "none" else ""
        return f"does not start with a number{known}.{none}"
    number, word = match[1], spelt(match[2])
    if not word:
        advice = "without quotes" if unit is None else f"without quotes, in {unit}"
        return f"has no unit{known}; a plain number, {advice}."
    found = next((one for one, (_, words) in DIMENSIONS.items() if word in words), None)
    if found is None and re.match(r",\d", match[2]):
        point = f": {text.strip().replace(',', '.')!r}" * ("." not in number)
        return f"has a comma. Write a point{point or ', and one alone'}."
    if found is None:
        near = [one for one in words_of(unit) if one.lower() == word.lower()]
        advice = f"; did you mean {near[0]!r}?" if near else f"{known}."
        return f"has the unknown unit {shown(word)}{advice}"
    if found != (unit or "%"):
        wanted = "a pure number" if unit is None else DIMENSIONS[unit][0]
        return f"is {DIMENSIONS[found][0]}, but {wanted} is needed{known}."
    with localcontext(prec=40) as context:
        context.clear_traps()  # what overflows is infinite
        factor = DIMENSIONS[found][1][word] / (100 if unit is None else 1)
        value = float(Decimal(number) * factor)
    if not math.isfinite(value):
        return "is too large for a number."
    return value


def write_quantity(value: float, unit: str) -> str:
    """Return a finite number in the unit of a field with a handy unit, as `read_quantity` reads."""
    words, factors = SHOWN.get(unit, (unit,)), DIMENSIONS[unit][1]
    chosen = [words[0], *(word for word in words[1:] if abs(value) >= factors[word])][-1]
    with localcontext(prec=40):
        scaled = Decimal(repr(value)) / factors[chosen]
    # Plain where that is short: 150 rather than 1.5E+2.
    plain = f"{scaled:f}"
    if "." in plain:
        plain = plain.rstrip("0").rstrip(".")
    return f"{plain if len(plain) < 18 else scaled} {chosen}"


def duration(seconds: float) -> str:
    """Return a time in h, min or s, in about two digits."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    number, unit = (seconds / 60, "min") if seconds < 3600 else (seconds / 3600, "h")
    return f"{number:.1f} {unit}" if number < 10 else f"{number:.0f} {unit}"
