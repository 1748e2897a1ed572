"""Conditions on the coordinates of a skin: "z < 5 mm and not x > 0"."""

from __future__ import annotations

import ast
import operator
import re
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from typing import Any, NoReturn

import numpy as np

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.units import DIMENSIONS

# Longest condition in characters, which bounds how deeply one is nested.
LONGEST = 300
AXES = ("x", "y", "z")
# Factor of each unit, and its power of m.
_UNITS = {
    word: (np.float64(factor), power)
    for power, unit in ((1, "m"), (2, "m²"))
    for word, factor in DIMENSIONS[unit][1].items()
}
_QUANTITY = re.compile(
    r"(?<![\w.])((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*"
    rf"({'|'.join(sorted(_UNITS, key=len, reverse=True))})(?![\w²])"
)
_HOW: dict[type, Any] = {
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.USub: operator.neg, ast.UAdd: operator.pos,
    ast.And: np.logical_and, ast.Or: np.logical_or,
}  # fmt: skip
_FUNCTIONS: dict[str, tuple[int, Any]] = {
    "abs": (1, np.abs), "sqrt": (1, np.sqrt), "hypot": (2, np.hypot)
}  # fmt: skip


@dataclass(frozen=True)
class Expression:
    """A condition on the coordinates x, y, z of a point.

    Attributes:
        text: The condition, "z < 5 mm or hypot(x, y) > 2 cm" for instance. Comparisons <, <=, >,
            >= may follow each other, as in "0 < z < 5 mm"; they are joined by "and", "or" and
            "not". +, −, *, /, abs, sqrt and hypot make numbers. A number has a unit of length, or
            is in m.

    Raises:
        ParameterError: It cannot be understood; the message says where.
    """

    text: str

    def __post_init__(self) -> None:
        if len(self.text) > LONGEST:
            raise ParameterError(f"a condition of {len(self.text)} characters; at most {LONGEST}.")
        self(np.zeros((1, 3)))

    def __call__(self, points: Floats) -> Bools:
        """Return whether it holds at points (n, 3) in m, (n,)."""
        reading = _Reading(self.text.strip(), np.asarray(points, dtype=np.float64))
        try:
            with np.errstate(all="ignore"):  # 1/x at x = 0 is infinite, and compares
                found = reading.value(reading.tree(), truth=True)[0]
        except SyntaxError as error:
            at = error.offset or len(reading.text) + 1
            reading.refuse(f"cannot be read at character {at}: {error.msg}")
        except (RecursionError, MemoryError):
            reading.refuse("is nested too deeply")
        return np.broadcast_to(found, (len(points),)).copy()


class _Reading:
    """A condition while its value at points (n, 3) is found, from Python's own syntax tree."""

    def __init__(self, text: str, points: Floats) -> None:
        self.text, self.points = text, points
        self.names: dict[str, tuple[Any, int]] = {a: (points[:, k], 1) for k, a in enumerate(AXES)}
        # Quantities become names of the same length, so that places in the tree are those here.
        self.source = _QUANTITY.sub(self._named, text)

    def _named(self, found: re.Match[str]) -> str:
        name = chr(0x4E00 + len(self.names)).ljust(len(found[0]), "_")
        factor, power = _UNITS[found[2]]
        self.names[name] = np.float64(found[1]) * factor, power
        return name

    def tree(self) -> ast.expr:
        return ast.parse(self.source, mode="eval").body

    def value(self, node: ast.expr, *, truth: bool = False) -> tuple[Any, int | None]:
        """Return a value, and its power of m; None for plain numbers, which fit all units."""
        found, power = self._any(node)
        if (found.dtype == bool) != truth:
            needed = "comparison, z < 5 mm for instance," if truth else "number"
            self.refuse(f"has {self._words(node)}, where a {needed} is needed")
        return found, power

    def _any(self, node: ast.expr) -> tuple[Any, int | None]:
        match node:
            case ast.BoolOp(op, parts):
                each = [self.value(one, truth=True)[0] for one in parts]
                return reduce(_HOW[type(op)], each), None
            case ast.UnaryOp(ast.Not(), of):
                return np.logical_not(self.value(of, truth=True)[0]), None
            case ast.UnaryOp(op, of) if type(op) in _HOW:
                found, power = self.value(of)
                return _HOW[type(op)](found), power
            case ast.BinOp(a, ast.Mult() | ast.Div() as op, b):
                (one, p), (two, q) = self.value(a), self.value(b)
                times = isinstance(op, ast.Mult)
                power = None if p is q is None else (p or 0) + (1 if times else -1) * (q or 0)
                return _HOW[type(op)](one, two), power
            case ast.BinOp(a, op, b) if type(op) in _HOW:
                (one, two), power = self._alike(node, a, b)
                return _HOW[type(op)](one, two), power
            case ast.Compare(first, ops, rest) if all(type(op) in _HOW for op in ops):
                sides = pairwise(self._alike(node, first, *rest)[0])
                each = [_HOW[type(op)](*side) for op, side in zip(ops, sides, strict=True)]
                return reduce(np.logical_and, each), None
            case ast.Call(ast.Name(name), given, []) if len(given) == _FUNCTIONS.get(name, [0])[0]:
                values, power = self._alike(node, *given)
                if name == "sqrt" and power is not None:
                    if power % 2:
                        self.refuse(f"has {self._words(node)}: the root of m^{power} is no length")
                    power //= 2
                return _FUNCTIONS[name][1](*values), power
            case ast.Name(name) if name in self.names:
                return self.names[name]
            case ast.Constant(int() | float() as value) if not isinstance(value, bool):
                return np.float64(value), None
        self.refuse(
            f"has {self._words(node)}, which is not known; known are x, y, z, "
            "abs(…), sqrt(…) and hypot(…, …)"
        )

    def _alike(self, node: ast.expr, *parts: ast.expr) -> tuple[list[Any], int | None]:
        """Return numbers that can be added or compared, and their power of m."""
        values, all_powers = zip(*map(self.value, parts), strict=True)
        powers = {power: None for power in all_powers if power is not None}
        if len(powers) > 1:
            units = " and ".join(f"m^{power}" for power in powers)
            self.refuse(f"has {self._words(node)}: {units} do not go together")
        return list(values), next(iter(powers), None)

    def _words(self, node: ast.expr) -> str:
        """Return what the text has for a node, and where it begins."""
        raw = self.source.encode()
        begin, end = (len(raw[:at].decode()) for at in (node.col_offset, node.end_col_offset))
        return f"{self.text[begin:end]!r} at character {begin + 1}"

    def refuse(self, why: str) -> NoReturn:
        raise ParameterError(
            f"{self.text!r} {why}. Conditions are written as z < 5 mm and not (x > 0 or y > 1 cm)."
        )
