"""Total energy of a skin, its first variation and its tangent, eqs. (8-10), from its terms."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import ufl

from toros_fem.forms.bending import Edges, edge_angles
from toros_fem.forms.bubbles import POINTS, Bubbles
from toros_fem.forms.jets import Jet, Scalar, Vector, by_vectors, compose, total
from toros_fem.forms.kinematics import CELL, Strain, Triangle, edge_products
from toros_fem.forms.lines import Lines
from toros_fem.forms.membrane import Logarithm, log1p, plain_log

# Metric of a part of a triangle as a function of vectors, and these between its nodes.
Metric = Callable[..., list[Jet]]
Part = tuple[Metric, Sequence[Vector]]


class EnergyTerm:
    """Laws of one term per flat area, in J/m²; a term has none but those that it defines.

    Attributes:
        edges: Constants of the triangles' edges, of the term by which the sheet bends.
        bubbles: Unknowns of edges by which strains are linear in a triangle; None for none.
        symbols: All else that its laws read, as of `base.fenicsx.SharedForms`: terms of one
            class differ in nothing but these. NotImplemented: not known, no forms are shared.
    """

    symbols: Any = NotImplemented
    edges: Edges | None = None
    bubbles: Bubbles | None = None

    def place(self, patch: Sequence[Any]) -> Sequence[Any]:
        """Return the nodes that a triangle sees from the parts of a patch, or of a variation."""
        return patch

    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        """Return a law of the strain.

        It is convex in C, or outweighed by others: their sum makes the material part of the
        tangent. It is asked twice, for value and derivatives, with another `log`, y ↦ ln(1 + y)
        (`forms.membrane.barrier`).
        """
        return 0

    def of_curvature(self, t: Triangle, Lambda: Sequence[Scalar]) -> Scalar:
        """Return a law of the curvature (xx, yy, xy)."""
        return 0

    def of_both(self, t: Triangle, e: Strain, Lambda: Sequence[Scalar]) -> Scalar:
        """Return a law that couples strain and curvature."""
        return 0

    def of_place(self, t: Triangle) -> Jet | None:
        """Return the potential of a load, of the positions themselves."""
        return None


@dataclass(frozen=True)
class SkinForms:
    """UFL forms of one skin.

    Attributes:
        energy: E of eq. (8), in J.
        residual: First variation of E, the negative of the force of eq. (9), in N.
        tangent: Entries of the second variation of E, in N/m: for each triangle the upper
            triangle of its element matrix, row by row, as a linear form on piecewise constants.
        sensitivities: ∂(residual · adjoint) by each coefficient of the design, as linear forms on
            their spaces, in J.
        loads: Potential of each term that is a load, in J, and its first variation, in N, by the
            term's number.
    """

    energy: Any
    residual: Any
    tangent: Any
    sensitivities: Sequence[Any]
    loads: Mapping[int, tuple[Any, Any]]


def skin_forms(
    q: Any,
    adjoint: Any,
    entries: Any,
    design: tuple[Any, Lines | None],
    geometric: Any,
    terms: Sequence[EnergyTerm],
) -> SkinForms:
    """Return energy, first variation, tangent and sensitivities of a skin, eqs. (8-10, 19).

    UFL differentiates the laws of the terms; `forms.jets` states the chain rule. With `geometric`
    = 0 the tangent's entries are those of its material part, positive semidefinite: with |N| for
    the membrane stress N, and without the second derivatives of angles, couplings and loads.

    Args:
        q: Patch positions: a function of three corners; with bending of three flaps too, and of
            the rotation unknowns as a seventh vector, if there are any; then what `place` reads.
        adjoint: A function of the same space, for the sensitivities.
        entries: Test function of the tangent's entries: n(n + 1)/2 piecewise constants for a
            patch of n components.
        design: Projected density ρ̄, and the line families of a relaxed design.
        geometric: Two numbers, of strains and loads, and of angles and couplings: 1 for the
            tangent, 0 for its material part.
        terms: The skin's energy terms.
    """
    space = q.ufl_function_space()
    domain = space.ufl_domain()
    dx = ufl.dx(domain=domain, metadata=CELL)

    def seen(whole: Any) -> list[Any]:
        patch: Sequence[Any] = ufl.split(whole)
        for term in terms:
            patch = term.place(patch)
        return list(patch)

    density, lines = design
    t = Triangle(seen(q), ufl.Jacobian(domain), density, lines)
    variation, adjoint_parts = seen(ufl.TestFunction(space)), seen(adjoint)
    bubbles = next((term.bubbles for term in terms if term.bubbles is not None), None)
    metrics = _metrics(t, bubbles, geometric[0])
    whole = _stored(t, metrics, terms, geometric)
    placed = ((number, term.of_place(t)) for number, term in enumerate(terms))
    loads = {number: load for number, load in placed if load is not None}
    for load in loads.values():
        whole = whole + load.scaled_hessian(geometric[0])

    size = 3 * len(t.nodes)
    numbers = enumerate(combinations_with_replacement(range(size), 2))
    values = [whole.hessian[pair] * entries[n] for n, pair in numbers if pair in whole.hessian]
    along_adjoint = _first(whole, adjoint_parts) * dx
    designed = [density] if lines is None else [density, lines.state]
    return SkinForms(
        energy=whole.value * dx,
        residual=_first(whole, variation) * dx,
        tangent=total(values) * dx,
        sensitivities=[
            ufl.derivative(along_adjoint, by, ufl.TestFunction(by.ufl_function_space()))
            for by in designed
        ],
        loads={
            number: (load.value * dx, _first(load, variation) * dx)
            for number, load in loads.items()
        },
    )


def _first(jet: Jet, variation: Sequence[Any]) -> Any:
    return total(slope * variation[i // 3][i % 3] for i, slope in jet.gradient.items())


def _stored(
    t: Triangle, metrics: Sequence[Part], terms: Sequence[EnergyTerm], geometric: Any
) -> Jet:
    """Return the energy of strain and curvature; its value keeps the digits of small strains."""

    def of_strain(log: Logarithm, *of: Scalar) -> Scalar:
        e = t.strain(of)
        return total(term.of_strain(t, e, log) for term in terms)

    part = 1 / len(metrics)
    jet, value = Jet(0), 0
    for metric, vectors in metrics:

        def strained(*given: Vector, metric: Metric = metric) -> Jet:
            return compose(
                lambda *of: of_strain(plain_log, *of),
                metric(*given),
                lambda first: _positive(first, geometric[0]),
            )

        jet = jet + by_vectors(strained, *vectors) * part
        value = value + part * of_strain(log1p, *(one.value for one in metric(*vectors)))
    edges = next((term.edges for term in terms if term.edges is not None), None)
    if edges is None:
        return Jet(value, jet.gradient, jet.hessian)

    def of_curvature(*angles: Scalar) -> Scalar:
        Lambda = edges.curvature(angles)
        return total(term.of_curvature(t, Lambda) for term in terms)

    def of_both(*given: Scalar) -> Scalar:
        e, Lambda = t.strain(given[:3]), edges.curvature(given[3:])
        return total(term.of_both(t, e, Lambda) for term in terms)

    angles = edge_angles(t, edges)
    bent = compose(of_curvature, angles, lambda first: [geometric[1] * d for d in first])
    jet, value = jet + bent, value + bent.value
    for metric, vectors in metrics:
        given = [*metric(*vectors), *angles]
        coupled = of_both(*(one.value for one in given))
        if not isinstance(coupled, int):  # some term has such a law
            both = compose(of_both, given) * part
            jet, value = jet + both.scaled_hessian(geometric[1]), value + both.value
    return Jet(value, jet.gradient, jet.hessian)


def _metrics(t: Triangle, bubbles: Bubbles | None, geometric: Any) -> list[Part]:
    """Return (e₁·e₁, e₂·e₂, e₁·e₂) of equal parts of a triangle, each as a function of vectors."""
    if bubbles is None:
        return [(lambda *edges: edge_products((edges[0], edges[1])), t.edges)]
    held = t.nodes[bubbles.first : bubbles.first + 2]
    return [
        (lambda *given, at=at: bubbles.metric(at, geometric, *given), (*t.edges, *held))
        for at in POINTS
    ]


def _positive(first: Sequence[Scalar], geometric: Any) -> list[Scalar]:
    """Return derivatives by the metric where `geometric` is 1, those of |N| where it is 0.

    N, their symmetric 2×2 matrix, is the membrane stress; |N| = (N² + |det N| 1)/√(N:N + 2 |det N|)
    has the absolute values of its eigenvalues.
    """
    a, b, c = 2 * first[0], 2 * first[1], first[2]
    det = abs(a * b - c * c)
    root = ufl.sqrt(a * a + b * b + 2 * c * c + 2 * det + 1e-300)
    size = (a * a + c * c + det) / root / 2, (b * b + c * c + det) / root / 2, (a + b) * c / root
    return [geometric * d + (1 - geometric) * s for d, s in zip(first, size, strict=True)]
