"""Numbers that an own skin is judged by: how a region has turned and moved against another."""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import pairwise
from typing import Annotated, Any, NoReturn, Self

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import DIMENSIONS, OneOf, Real, Table, Text, key
from toros_fem.base.validation import Bools, Floats
from toros_fem.measures.metrics import Metric
from toros_fem.measures.regions import (
    DIRECTIONS,
    BodyAxis,
    bend_between,
    length_between,
    tip_frame,
    twist_between,
    unit_vector,
)
from toros_fem.meshes.pattern import Pattern

# Unit of each measure in files, and the measures that "tip" stands for.
MEASURES = {
    "bend": "deg", "turn": "deg", "twist": "deg", "length": "ratio",
    "x": "mm", "y": "mm", "z": "mm", "lean": "deg",
}  # fmt: skip
TIP = ("x", "y", "z", "lean")
# A length that is off by so much counts like an angle that is not there at all.
LENGTH_SCALE = 0.2
WORDS = re.compile(r"\s*(?P<measure>\S+)\s+of\s+(?P<of>.+?)(?:\s+against\s+(?P<against>.+))?\s*")
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


class Region(Table):
    """A region of a skin.

    Raises:
        ParameterError: Neither a condition nor panels are given, or the condition is wrong.
    """

    where: Text | None = key(
        None, 'condition on the coordinates of the assembled skin, "z < 5 mm" for instance'
    )
    panels: Text | None = key(
        None,
        "names of panels, or of parts of the mesh file, with commas between them; with a "
        "condition, where it holds on them",
    )

    def __post_init__(self) -> None:
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
        inside = np.zeros(len(pattern.points), dtype=bool)
        inside[pattern.triangles[self._on_panels(pattern)]] = True
        return self._checked(pattern, inside, pattern.points)

    def cells(self, pattern: Pattern) -> Bools:
        """Return which triangles have their centroid in the region, (t,)."""
        centroids = pattern.points[pattern.triangles].mean(axis=1)
        return self._checked(pattern, self._on_panels(pattern), centroids)

    def require_symmetric(self, name: str, points: Floats, axis: int) -> None:
        """Check that the condition holds at mirror images too; panels are those of the part.

        Raises:
            ParameterError: It does not.
        """
        if self.where is not None:
            holds, flip = Expression(self.where), np.where(np.arange(3) == axis, -1.0, 1.0)
            if (holds(points) != holds(flip * points)).any():
                raise ParameterError(
                    f"{name}: {self.where!r} is not symmetric about {AXES[axis]} = 0. Write "
                    f"abs({AXES[axis]}), or leave this plane out."
                )

    def _on_panels(self, pattern: Pattern) -> Bools:
        """Return which triangles lie on the panels, (t,).

        A part of a mesh file that was divided has several panels, as "sole-1".
        """
        if self.panels is None:
            return np.ones(len(pattern.panel), dtype=bool)
        found: list[int] = []
        for name in (name.strip() for name in self.panels.split(",")):
            numbered = re.compile(rf"{re.escape(name)}-\d+")
            parts = [panel for panel in pattern.panel_names if numbered.fullmatch(panel)]
            names = [name] if name in pattern.panel_names or not parts else parts
            found += map(pattern.panel_index, names)
        return np.isin(pattern.panel, found)

    def _checked(self, pattern: Pattern, inside: Bools, points: Floats) -> Bools:
        if self.where is not None:
            inside = inside & Expression(self.where)(points)
        if not inside.any():
            low, high = (1e3 * f(axis=0) for f in (pattern.points.min, pattern.points.max))
            ends = zip(AXES, low, high, strict=True)
            spans = ", ".join(f"{name} from {a:.4g} to {b:.4g}" for name, a, b in ends)
            what = repr(self.where) if self.where is not None else f"panels = {self.panels!r}"
            raise ParameterError(f"the region {what} holds nothing; the skin has {spans} mm.")
        return inside


class MetricTable(Table):
    """A number to judge by: how a region has turned or moved.

    Raises:
        ParameterError: A region is missing or wrong, or the name is none.
    """

    measure: Annotated[str, OneOf((*MEASURES, "tip"))] = key(
        "bend",
        "what is measured: the bend in the plane of the axis, the turn in all, the twist about the "
        "axis, the length between the regions' means over the assembled one, the way of the mean "
        "along x, y or z, the lean of the axis, or with tip these four",
    )
    of: Text | None = key(
        None, 'region that is measured: a condition, "z > 70 mm" for instance, or names of panels'
    )
    against: Text | None = key(None, "region that it is seen from; none: it is seen from space")
    name: Text | None = key(None, "name of the number; none takes that of the measure")
    target: Real | None = key(
        None, "target in deg, mm, or over the assembled length; none: the number is only watched"
    )
    axis: Annotated[str, OneOf(DIRECTIONS)] | None = key(
        None, "axis of the assembled region; none takes that of the target"
    )
    toward: Annotated[str, OneOf(DIRECTIONS)] | None = key(
        None, "direction that a bend goes to; none takes that of the target"
    )

    def __post_init__(self) -> None:
        for refused, where, why in (
            (self.of is None, "of", 'a metric needs of = "z > 70 mm" for instance.'),
            (
                self.measure == "length" and self.against is None,
                "against",
                "a length needs two regions: give against too.",
            ),
            (
                self.measure == "tip" and self.target is not None,
                "target",
                f"tip is four numbers: give {', '.join(TIP)} a target.",
            ),
            (
                self.name is not None and not self.name.isidentifier(),
                "name",
                f"name = {self.name!r} must be of letters, digits and underscores.",
            ),
        ):
            if refused:
                raise ParameterError(why, where)
        for name in ("of", "against"):
            try:
                _region(getattr(self, name))
            except ParameterError as caught:
                raise ParameterError(str(caught).replace("where", name, 1), name) from None

    @classmethod
    def from_words(cls, text: str) -> Self:
        """Return the metric of a command line, "bend of z > 70 mm against z < 5 mm".

        Raises:
            ParameterError: It has another form, or a part of it is wrong.
        """
        if (found := WORDS.fullmatch(text)) is None:
            known = ", ".join((*MEASURES, "tip"))
            raise ParameterError(
                f"metric {text!r}: write MEASURE of REGION or MEASURE of REGION against REGION, as "
                f"in bend of z > 70 mm against z < 5 mm; MEASURE is one of {known}."
            )
        try:
            return cls(found["measure"], found["of"], found["against"])
        except ParameterError as caught:
            raise ParameterError(f"metric {text!r}: {caught}", caught.key) from None

    def metrics(self, axis: BodyAxis) -> list[Metric]:
        """Return the number, or the four of a tip, of a body along an axis.

        Raises:
            ParameterError: A bend does not go across the axis.
        """
        along = axis.along if self.axis is None else unit_vector(self.axis)
        side = axis.frame[0] if self.toward is None else unit_vector(self.toward)
        if self.measure == "bend" and abs(along @ side) > 0.5:
            raise ParameterError("toward must be perpendicular to axis; give both.", "toward")
        of, against = _region(self.of), _region(self.against)

        def value(measure: str, pattern: Pattern, positions: Floats) -> float:
            tip, root = (None if one is None else one.vertices(pattern) for one in (of, against))
            assert tip is not None
            if measure == "length":
                assert root is not None
                return length_between(pattern, positions, tip, root)
            if measure in ("bend", "turn"):
                toward = side if measure == "bend" else None
                found = bend_between(pattern, positions, tip, root, along=along, toward=toward)
            elif measure == "twist":
                found = twist_between(pattern, positions, tip, root, along=along)
            else:
                frame = tip_frame(pattern, positions, tip, root, along=along)
                if measure != "lean":
                    return float(1e3 * frame.displacement["xyz".index(measure)])
                found = frame.lean
            return float(np.degrees(found))

        several, own = self.measure == "tip", self.name or self.measure
        return [
            Metric(
                f"{own}_{one}" if several else own,
                MEASURES[one],
                self.target,
                partial(value, one),
                LENGTH_SCALE if one == "length" else None,
            )
            for one in (TIP if several else (self.measure,))
        ]


def judged_by(
    entries: Sequence[MetricTable], axis: BodyAxis, known: Sequence[Metric]
) -> list[Metric]:
    """Return known metrics and those of entries; names that nobody gave are numbered if taken."""
    found = list(known)
    for entry in entries:
        for metric in entry.metrics(axis):
            keys, name, number = {one.key for one in found}, metric.name, 1
            while entry.name is None and metric.key in keys:
                number += 1
                metric = replace(metric, name=f"{name}_{number}")
            found.append(metric)
    return found


def _region(text: str | None) -> Region | None:
    """Return the region of a condition, or of panels where the text compares nothing."""
    if text is None:
        return None
    return Region(where=text) if re.search("[<>]", text) else Region(panels=text)


# ------------------------------------------------------------------------------------- conditions


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
