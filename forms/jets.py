"""Scalars of a triangle with gradient and Hessian by its unknowns: the chain rule, once for all.

A jet is written down by `+`, `-`, `*`, `dot` and `cross` where it is a polynomial of positions, and
by `compose` where it is a law of other jets, which `ufl.diff` differentiates. So a law states its
energy alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations_with_replacement
from typing import Any

import ufl

# A UFL scalar, or a number.
Scalar = Any
Pair = tuple[int, int]


def total(terms: Iterable[Scalar]) -> Scalar:
    """Return the sum as a balanced tree, since UFL recurses into sums; zeros are left out."""
    left = [term for term in terms if not (isinstance(term, int | float) and term == 0)]
    while len(left) > 1:
        pairs = zip(left[::2], left[1::2], strict=False)
        left = [a + b for a, b in pairs] + left[len(left) - len(left) % 2 :]
    return left[0] if left else 0


@dataclass(frozen=True)
class Jet:
    """A scalar with its derivatives by the numbered unknowns of a triangle.

    Attributes:
        value: The scalar.
        gradient: First derivatives; those that are missing are zero.
        hessian: Second derivatives by unknowns i ≤ j, without those that are zero.
    """

    value: Scalar
    gradient: Mapping[int, Scalar] = field(default_factory=dict)
    hessian: Mapping[Pair, Scalar] = field(default_factory=dict)

    def __add__(self, other: Jet | Scalar) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.value + other, self.gradient, self.hessian)
        return Jet(
            self.value + other.value,
            _added(self.gradient, other.gradient),
            _added(self.hessian, other.hessian),
        )

    __radd__ = __add__

    def __neg__(self) -> Jet:
        return -1 * self

    def __sub__(self, other: Jet | Scalar) -> Jet:
        return self + (-1 * other)

    def __mul__(self, other: Jet | Scalar) -> Jet:
        if not isinstance(other, Jet):
            return Jet(
                self.value * other,
                {i: d * other for i, d in self.gradient.items()},
                {pair: d * other for pair, d in self.hessian.items()},
            )
        hessian = dict(
            _added(
                {pair: d * other.value for pair, d in self.hessian.items()},
                {pair: d * self.value for pair, d in other.hessian.items()},
            )
        )
        for i, a in self.gradient.items():
            for j, b in other.gradient.items():
                pair, both = _ordered(i, j), a * b * (2 if i == j else 1)
                hessian[pair] = hessian[pair] + both if pair in hessian else both
        gradient = _added(
            {i: d * other.value for i, d in self.gradient.items()},
            {i: d * self.value for i, d in other.gradient.items()},
        )
        return Jet(self.value * other.value, gradient, hessian)

    __rmul__ = __mul__

    def scaled_hessian(self, factor: Scalar) -> Jet:
        """Return the jet with its second derivatives times a factor."""
        return Jet(self.value, self.gradient, {k: factor * d for k, d in self.hessian.items()})


Vector = tuple[Jet, Jet, Jet]


def dot(u: Sequence[Any], v: Sequence[Any]) -> Any:
    """Return the scalar product of two vectors of three, of jets or of scalars."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def cross(u: Sequence[Any], v: Sequence[Any]) -> tuple[Any, Any, Any]:
    """Return the vector product."""
    return (
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    )


def minus(u: Sequence[Any], v: Sequence[Any]) -> tuple[Any, Any, Any]:
    """Return the difference of two vectors of three."""
    return u[0] - v[0], u[1] - v[1], u[2] - v[2]


def compose(
    law: Callable[..., Scalar],
    inputs: Sequence[Jet],
    stress: Callable[[list[Scalar]], Sequence[Scalar]] = lambda first: first,
    bend: Scalar = 1,
) -> Jet:
    """Return a law of jets as a jet; `ufl.diff` differentiates the law, a function of scalars.

    `stress` makes what stands for the law's first derivatives in front of the second ones of the
    inputs; the derivatives themselves give the exact Hessian. `bend` is a factor on the law's own
    second derivatives.
    """
    given = [ufl.variable(jet.value) for jet in inputs]
    value = law(*given)
    first = [ufl.diff(value, x) for x in given]
    count = range(len(given))
    second: dict[Pair, Scalar] = {
        (a, b): _times(ufl.diff(first[a], given[b]), bend)
        for a, b in combinations_with_replacement(count, 2)
    }
    unknowns = sorted(set().union(*(jet.gradient for jet in inputs)))
    by_input = {
        (a, j): total(
            second[_ordered(a, b)] * inputs[b].gradient[j] for b in count if j in inputs[b].gradient
        )
        for a in count
        for j in unknowns
    }
    gradient = {
        i: total(first[a] * inputs[a].gradient[i] for a in count if i in inputs[a].gradient)
        for i in unknowns
    }
    factors = stress(first)
    hessian = {}
    for i, j in combinations_with_replacement(unknowns, 2):
        hessian[i, j] = total(
            [
                *(inputs[a].gradient[i] * by_input[a, j] for a in count if i in inputs[a].gradient),
                *(
                    factors[a] * inputs[a].hessian[i, j]
                    for a in count
                    if (i, j) in inputs[a].hessian
                ),
            ]
        )
    return Jet(value, gradient, hessian)


def by_vectors(function: Callable[..., Jet], *vectors: Vector) -> Jet:
    """Return a function of vectors that are linear in the unknowns.

    Its derivatives are formed by the vectors' own components first. A triangle's energy depends
    on the two vectors of its edges, which have 21 second derivatives where its three corners have
    45; a mirrored flap is linear in a flap and a corner.
    """
    fresh, linear = [], {}
    for n, vector in enumerate(vectors):
        fresh.append(tuple(Jet(x.value, {3 * n + k: 1}) for k, x in enumerate(vector)))
        linear.update({3 * n + k: x.gradient for k, x in enumerate(vector)})
    jet = function(*fresh)

    gradient: dict[int, list[Scalar]] = {}
    for own, slope in jet.gradient.items():
        for i, factor in linear[own].items():
            gradient.setdefault(i, []).append(_times(slope, factor))
    half: dict[Pair, list[Scalar]] = {}  # rows by own components, columns by unknowns
    for (one, two), slope in jet.hessian.items():
        for row, column in {(one, two), (two, one)}:
            for j, factor in linear[column].items():
                half.setdefault((row, j), []).append(_times(slope, factor))
    whole: dict[Pair, list[Scalar]] = {}
    for (row, j), slopes in sorted(half.items()):
        slope = total(slopes)
        for i, factor in linear[row].items():
            if i <= j:
                whole.setdefault((i, j), []).append(_times(slope, factor))
    return Jet(
        jet.value,
        {i: total(slopes) for i, slopes in gradient.items()},
        {pair: total(slopes) for pair, slopes in whole.items()},
    )


def _ordered(i: int, j: int) -> Pair:
    return (i, j) if i <= j else (j, i)


def _times(slope: Scalar, factor: Scalar) -> Scalar:
    """Return the product; plain signs leave no multiplication behind."""
    if isinstance(factor, int) and abs(factor) == 1:
        return slope if factor == 1 else -slope
    return slope * factor


def _added(one: Mapping[Any, Scalar], two: Mapping[Any, Scalar]) -> dict[Any, Scalar]:
    return {
        key: one[key] + two[key] if key in one and key in two else one.get(key, two.get(key))
        for key in {**one, **two}
    }
