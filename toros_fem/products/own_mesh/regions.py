"""Regions of a skin by coordinates or panels: "z < 5 mm and not x > 0"."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, NoReturn

import numpy as np

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Table, key
from toros_fem.base.units import DIMENSIONS
from toros_fem.meshes.pattern import Pattern

# Longest expression in characters, and how deeply it may be nested.
LONGEST, DEEPEST = 500, 20
AXES = {"x": 0, "y": 1, "z": 2}
_UNITS = {
    **{word: (float(factor), 1) for word, factor in DIMENSIONS["m"][1].items()},
    **{word: (float(factor), 2) for word, factor in DIMENSIONS["m²"][1].items()},
}
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<word>[^\W\d]\w*[²2]?)"
    r"|(?P<sign><=|>=|[<>()+\-*/,])|(?P<other>\S))"
)
_COMPARISONS: dict[str, Callable[[Floats, Floats], Bools]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_SUMS: dict[str, Callable[[Floats, Floats], Floats]] = {"+": operator.add, "-": operator.sub}
_FUNCTIONS: dict[str, tuple[int, Callable[..., Floats]]] = {
    "abs": (1, np.abs),
    "sqrt": (1, np.sqrt),
    "hypot": (2, np.hypot),
}


class _Node(NamedTuple):
    """A part of an expression.

    Attributes:
        truth: Whether it is true or false at a point, and not a number.
        power: Power of m in its unit; None for plain numbers, which fit all units.
        at: Returns its value at points (n, 3).
    """

    truth: bool
    power: int | None
    at: Callable[[Floats], Any]


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
        _Parser(self.text).whole()

    def __call__(self, points: Floats) -> Bools:
        """Return whether it holds at points (n, 3) in m, (n,)."""
        with np.errstate(all="ignore"):  # 1/x at x = 0 is infinite, and compares
            found = _Parser(self.text).whole().at(np.asarray(points, dtype=np.float64))
        return np.broadcast_to(np.asarray(found, dtype=bool), (len(points),)).copy()


class _Parser:
    """Recursive descent: or, and, not, comparisons, sums, products, signs, numbers."""

    def __init__(self, text: str) -> None:
        if len(text) > LONGEST:
            raise ParameterError(f"a condition of {len(text)} characters; at most {LONGEST}.")
        self.text, self.depth, self.next = text, 0, 0
        self.tokens = list(_TOKEN.finditer(text))

    def whole(self) -> _Node:
        found = self.either()
        if self.next < len(self.tokens):
            self.fail("is not expected here")
        if not found.truth:
            raise ParameterError(f"{self.text!r} is a number; compare it: z < 5 mm for instance.")
        return found

    def fail(self, what: str) -> NoReturn:
        if self.next < len(self.tokens):
            token = self.tokens[self.next]
            word, at = token.group().strip(), token.end() - len(token.group().strip()) + 1
            where = f"{word!r}, character {at} of {self.text!r},"
        else:
            where = f"the end of {self.text!r}"
        raise ParameterError(
            f"{where} {what}. Conditions are written as z < 5 mm and not (x > 0 or y > 1 cm)."
        )

    def peek(self) -> str:
        return self.tokens[self.next].group().strip() if self.next < len(self.tokens) else ""

    def take(self, *words: str) -> str:
        """Return the next token and go on if it is one of these, otherwise ""."""
        word = self.peek()
        if word in words:
            self.next += 1
            return word
        return ""

    def either(self) -> _Node:
        self.depth += 1
        if self.depth > DEEPEST:
            raise ParameterError(f"{self.text!r} is nested more than {DEEPEST} times.")
        found = self.both()
        while self.take("or"):
            found = self.joined(found, np.logical_or, self.both())
        self.depth -= 1
        return found

    def both(self) -> _Node:
        found = self.negated()
        while self.take("and"):
            found = self.joined(found, np.logical_and, self.negated())
        return found

    def negated(self) -> _Node:
        count = 0
        while self.take("not"):
            count += 1
        found = self.compared()
        if not count:
            return found
        if not found.truth:
            self.fail("follows a number; 'not' needs a comparison")
        return _Node(
            True, None, lambda p: np.logical_not(found.at(p)) if count % 2 else found.at(p)
        )

    def joined(self, a: _Node, how: Callable[[Floats, Floats], Floats], b: _Node) -> _Node:
        if not (a.truth and b.truth):
            self.fail("comes after a number where a comparison is needed")
        return _Node(True, None, lambda p: how(a.at(p), b.at(p)))

    def compared(self) -> _Node:
        left = self.sum()
        found: _Node | None = None
        while sign := self.take(*_COMPARISONS):
            right = self.sum()
            self.same_unit(left, right)
            one = _compare(_COMPARISONS[sign], left, right)
            found = one if found is None else self.joined(found, np.logical_and, one)
            left = right
        return left if found is None else found

    def same_unit(self, a: _Node, b: _Node) -> int | None:
        """Check that two numbers can be added or compared; return their power of m."""
        if a.truth or b.truth:
            self.fail("comes after a comparison where a number is needed")
        if a.power is not None and b.power is not None and a.power != b.power:
            self.fail(f"comes after m^{a.power} and m^{b.power}, which do not go together")
        return a.power if b.power is None else b.power

    def sum(self) -> _Node:
        found = self.product()
        while sign := self.take(*_SUMS):
            other = self.product()
            found = _combine(_SUMS[sign], found, other, self.same_unit(found, other))
        return found

    def product(self) -> _Node:
        found = self.signed()
        while sign := self.take("*", "/"):
            other = self.signed()
            self.numbers(found, other)
            plain = found.power is None and other.power is None
            a, b = found.power or 0, other.power or 0
            if sign == "*":
                found = _combine(operator.mul, found, other, None if plain else a + b)
            else:
                found = _combine(operator.truediv, found, other, None if plain else a - b)
        return found

    def numbers(self, *nodes: _Node) -> None:
        if any(node.truth for node in nodes):
            self.fail("comes after a comparison where a number is needed")

    def signed(self) -> _Node:
        minus = 0
        while sign := self.take("+", "-"):
            minus += sign == "-"
        found = self.atom()
        if not minus % 2:
            return found
        self.numbers(found)
        return _Node(False, found.power, lambda p: -found.at(p))

    def atom(self) -> _Node:
        if self.next >= len(self.tokens):
            self.fail("comes too early")
        token = self.tokens[self.next]
        if token.group("number"):
            self.next += 1
            return self.number(float(token.group("number")))
        word = self.peek()
        if word in AXES:
            self.next += 1
            return _Node(False, 1, lambda p: p[:, AXES[word]])
        if word in _FUNCTIONS:
            self.next += 1
            return self.function(word)
        if not self.take("("):
            known = ", ".join([*AXES, *_FUNCTIONS])
            self.fail(f"is not known here; a number is needed, or one of {known}")
        found = self.either()
        self.close()
        return found

    def number(self, value: float) -> _Node:
        word = self.peek()
        if word in _UNITS:
            self.next += 1
            factor, power = _UNITS[word]
            return _Node(False, power, lambda p: np.full(len(p), value * factor))
        return _Node(False, None, lambda p: np.full(len(p), value))

    def function(self, name: str) -> _Node:
        count, how = _FUNCTIONS[name]
        if not self.take("("):
            self.fail(f"is not expected after {name}, but (")
        of = [self.either()]
        for _ in range(count - 1):
            if not self.take(","):
                self.fail(f"is not expected in {name}, but a comma")
            of.append(self.either())
        self.numbers(*of)
        power = of[0].power
        for other in of[1:]:
            power = self.same_unit(of[0], other)
        if name == "sqrt" and power is not None:
            if power % 2:
                self.fail(f"comes after the square root of m^{power}, which is no length")
            power //= 2
        self.close()
        return _Node(False, power, lambda p: how(*(node.at(p) for node in of)))

    def close(self) -> None:
        if not self.take(")"):
            self.fail("is not expected here, but )")


def _combine(
    how: Callable[[Floats, Floats], Floats], a: _Node, b: _Node, power: int | None
) -> _Node:
    return _Node(False, power, lambda p: how(a.at(p), b.at(p)))


def _compare(how: Callable[[Floats, Floats], Bools], a: _Node, b: _Node) -> _Node:
    return _Node(True, None, lambda p: how(a.at(p), b.at(p)))


@dataclass(frozen=True)
class Region(Table):
    """A region of a skin.

    Raises:
        ParameterError: Neither a condition nor panels are given, or the condition is wrong.
    """

    where: str | None = key(
        None, 'condition on the coordinates of the assembled skin, "z < 5 mm" for instance'
    )
    panels: str | None = key(
        None,
        "names of panels, or of parts of the mesh file, with commas between them; with a "
        "condition, where it holds on them",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.where is None and self.panels is None:
            raise ParameterError('a region needs where = "z < 5 mm", for instance, or panels.')
        if self.where is not None:
            try:
                Expression(self.where)
            except ParameterError as caught:
                raise ParameterError(f"where: {caught}", "where") from None

    def vertices(self, pattern: Pattern) -> Bools:
        """Return which assembled vertices lie in the region, (n,).

        Raises:
            ParameterError: None does.
            PanelError: There is no panel of a name.
        """
        inside = np.ones(len(pattern.points), dtype=bool)
        if self.panels is not None:
            inside[:] = False
            for name in self._names(pattern):
                inside[pattern.vertices_of(name)] = True
        return self._checked(pattern, inside, pattern.points)

    def cells(self, pattern: Pattern) -> Bools:
        """Return which triangles have their centroid in the region, (t,).

        Raises:
            ParameterError: None does.
            PanelError: There is no panel of a name.
        """
        panels: list[Ints] = []
        if self.panels is not None:
            panels = [pattern.cells_of(name) for name in self._names(pattern)]
        inside = np.full(len(pattern.panel), self.panels is None)
        for cells in panels:
            inside[cells] = True
        return self._checked(pattern, inside, pattern.points[pattern.triangles].mean(axis=1))

    def _names(self, pattern: Pattern) -> list[str]:
        """Return names of panels; a part of a mesh file that was divided has several, "sole-1"."""
        found = []
        for name in (name.strip() for name in (self.panels or "").split(",")):
            numbered = re.compile(rf"{re.escape(name)}-\d+")
            parts = [panel for panel in pattern.panel_names if numbered.fullmatch(panel)]
            found += [name] if name in pattern.panel_names or not parts else parts
        return found

    def _checked(self, pattern: Pattern, inside: Bools, points: Floats) -> Bools:
        if self.where is not None:
            inside = inside & Expression(self.where)(points)
        if not inside.any():
            low, high = (1e3 * f(axis=0) for f in (pattern.points.min, pattern.points.max))
            spans = ", ".join(
                f"{name} from {a:.4g} to {b:.4g}"
                for name, a, b in zip(AXES, low, high, strict=True)
            )
            what = repr(self.where) if self.where is not None else f"panels = {self.panels!r}"
            raise ParameterError(f"the region {what} holds nothing; the skin has {spans} mm.")
        return inside
