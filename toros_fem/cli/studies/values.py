"""Values of a study, from words such as "pressure=2..10kPa:5"."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Key, nearest, plain_value

# Most runs of a study.
MOST = 10_000
_RANGE = re.compile(r"(?P<low>.+?)\.\.(?P<high>.+?)(?::(?P<count>\d+))?")
_NUMBER = re.compile(r"\s*[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?\s*(?P<unit>.*?)\s*")


def values_of(words: str, keys: Mapping[str, Key]) -> tuple[str, list[object]]:
    """Return a key and its values from KEY=VALUES.

    VALUES is a list with commas, as in "1,2,5"; LOW..HIGH:COUNT for so many even steps, or
    LOW..HIGH for all whole numbers between. The unit of the last number is that of both.

    Args:
        words: The words.
        keys: What is known of each key.

    Raises:
        ParameterError: The key is unknown, or a value is wrong.
    """
    name, equals, text = (part.strip() for part in words.partition("="))
    name = name.rpartition(".")[2]
    if not equals or not text:
        raise ParameterError(f"{words!r}: write KEY=VALUES, pressure=2..10kPa:5 for instance.")
    if name not in keys:
        raise ParameterError(f"{words!r}: unknown key {name!r}; {nearest(name, keys)}", name)
    one, found = keys[name], _RANGE.fullmatch(text)
    if found is None:
        return name, [one.read(plain_value(part)) for part in text.split(",")]
    low, high, count = found["low"], found["high"], found["count"]
    unit, own = (_NUMBER.fullmatch(end) for end in (high, low))
    if unit is not None and own is not None and not own["unit"]:
        low += unit["unit"]
    ends = [one.read(plain_value(end)) for end in (low, high)]
    if not all(isinstance(end, int | float) and not isinstance(end, bool) for end in ends):
        raise ParameterError(f"{words!r}: a range needs numbers. Give a list with commas.", name)
    if one.kind is int and count is None:
        return name, _distinct(words, name, list(range(ends[0], ends[1] + 1)))
    if count is None or int(count) < 2:
        raise ParameterError(
            f"{words!r}: say how many values, at least 2, as in {name}={low}..{high}:5.", name
        )
    if int(count) > MOST:
        raise ParameterError(f"{words!r}: {count} values are more than {MOST}.", name)
    steps = [one.kind(step) for step in np.linspace(float(ends[0]), float(ends[1]), int(count))]
    return name, _distinct(words, name, steps)


def combinations(over: Mapping[str, Sequence[object]]) -> list[dict[str, object]]:
    """Return all combinations of the values of keys, the last key first to change.

    Raises:
        ParameterError: There are too many.
    """
    count = int(np.prod([len(values) for values in over.values()], dtype=float))
    if count > MOST:
        raise ParameterError(f"{count} combinations are more than {MOST}. Give fewer values.")
    return [dict(zip(over, values, strict=True)) for values in itertools.product(*over.values())]


def _distinct(words: str, name: str, values: list[object]) -> list[object]:
    if len(set(values)) != len(values) or not values:
        raise ParameterError(f"{words!r}: its values are not different, or there is none.", name)
    return values
