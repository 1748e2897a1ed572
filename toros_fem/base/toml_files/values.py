"""Values of TOML files: fields of configurations, in their units, read and written."""

from __future__ import annotations

import json
from typing import Any

from toros_fem.base.config import KINDS as WORDS
from toros_fem.base.config import Config
from toros_fem.base.errors import ParameterError
from toros_fem.base.units import read_quantity, write_quantity
from toros_fem.base.validation import require_choice

# Largest whole number, far beyond what makes sense, and the word for None.
LARGEST = 10**15
NONE = "none"


def field_value(config: Config | type[Config], name: str, value: Any) -> Any:
    """Return the value of a field, in its unit, from what a file holds.

    Args:
        config: A configuration with this field, or its type.
        name: Name of the field.
        value: A number, a text with a number and its unit, a word, true or false; "none" for None.

    Raises:
        ParameterError: It has another type or unit, or is out of its bounds.
    """
    kind, optional = config.kinds()[name]
    spec = config.quantity(name)
    if optional and isinstance(value, str) and value.lower() == NONE:
        return None
    if kind is float and isinstance(value, str):
        value = read_quantity(value, spec.unit)
    number = isinstance(value, int | float) and not isinstance(value, bool)
    good = {
        float: number,
        int: number and isinstance(value, int),
        bool: isinstance(value, bool),
        str: isinstance(value, str),
    }[kind]
    if not good:
        shown = repr(value) if isinstance(value, str | int | float) else f"a {_word(value)}"
        unit = f', "5 {spec.unit}" for instance' if kind is float and spec.unit else ""
        wanted = "true or false" if kind is bool else WORDS[kind]
        none = f', or "{NONE}"' if optional else ""
        raise ParameterError(f"{shown} must be {wanted}{unit}{none}.")
    if kind is int and abs(value) > LARGEST:
        raise ParameterError(f"a whole number of {len(str(LARGEST))} digits or more is too large.")
    if kind is float:
        try:
            value = float(value)
        except OverflowError:
            raise ParameterError("the number is too large.") from None
    if spec.choices is not None:
        require_choice(name, value, spec.choices)
    elif kind in (float, int):
        spec.check(name, value)
    return value


def _word(value: Any) -> str:
    if isinstance(value, dict):
        return "table"
    return "list" if isinstance(value, list) else "date or time"


def written_value(config: Config | type[Config], name: str, value: Any) -> str:
    """Return the value of a field as a file holds it, in a handy unit."""
    if value is None:
        return f'"{NONE}"'
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return quoted(value)
    unit = config.quantity(name).unit
    if isinstance(value, float) and unit is not None:
        return f'"{write_quantity(value, unit)}"'
    return repr(value)


def quoted(text: str) -> str:
    """Return a text as a TOML string; JSON's rules are those of TOML for all but one character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
