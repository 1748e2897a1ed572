"""A term of a skin's energy: what it may add, and nothing by default."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, override

import numpy as np
from dolfinx import fem, la

from toros_fem.base.array_types import Floats, Ints, LocalInts
from toros_fem.base.compiled_forms import assembled
from toros_fem.forms.energy import EnergyTerm, SkinForms
from toros_fem.mechanics.skin.designs import Densities
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import Patch, Unknowns
from toros_fem.mechanics.skin.stretch_bounds import StretchBounds

# Compiles a form of a skin; the name is one that no other has.
Compiled = Callable[[str, Callable[[SkinForms], Any]], fem.Form]


class Term(EnergyTerm):
    """A term of a skin's energy; each method adds nothing where a term does not define it.

    Most terms are a law in UFL and nothing else, one of those of `forms.energy.EnergyTerm`, and
    `moduli` if it stretches. What UFL cannot say a term states as `energy`, `add_gradient` and
    `entries`, on x, the owned unknowns of a state, to which the model has been set. Methods on x
    are collective.

    Attributes:
        bounds: Stretch bounds, of the term that has them.
        unknowns: Unknowns of the term; None for none.
        pairs: Global rows and columns, row ≤ column, of `entries`, (2, p).
        generation: How often `pairs` has changed.
    """

    bounds: StretchBounds | None = None
    unknowns: Unknowns | None = None
    pairs: Ints = np.zeros((2, 0), dtype=np.int64)
    generation: int = 0

    # What it follows.

    def number(self, patch: Patch, dofs: LocalInts) -> None:
        """Take the unknowns' numbers; `dofs` are the local ones of its own, (blocks, size)."""

    def take_forms(self, number: int, compiled: Compiled, work: la.Vector) -> None:
        """Take the term's number in the skin, the skin's forms, and a vector to assemble into."""

    def set_load(self, load: Load) -> None:
        """Take what acts."""

    def after_design(self) -> None:
        """Follow a change of the design."""

    def after_move(self) -> None:
        """Follow a move of the mesh's flat corners."""

    def add_rest(self, x: Floats) -> None:
        """Change the state at rest, whose positions are the assembled ones."""

    def moved(self, nodes: Floats, q: Floats) -> Floats:
        """Return where triangles see nodes, (cells, k, 3), from these and all local unknowns."""
        return nodes

    # Beyond UFL.

    def energy(self, x: Floats) -> float:
        """Return what is not in `of_…`, in J."""
        return 0.0

    def add_gradient(self, x: Floats, out: Floats) -> None:
        """Add the first variation of `energy` in N."""

    def entries(self, x: Floats, *, definite: bool) -> Floats:
        """Return its second variation at `pairs` in N/m, or a positive semidefinite part."""
        return np.zeros(self.pairs.shape[1])

    def grow(self, x: Floats) -> None:
        """Let `pairs` cover what acts at a state."""

    def add_applied(self, x: Floats, out: Floats) -> None:
        """Add the force in N of a load, by which residuals are measured."""

    def load_energy(self, x: Floats) -> float:
        """Return the size in J of a load's part in the energy, to bound its rounding."""
        return 0.0

    def largest_step(self, x: Floats, step: Floats, factor: float, carried: Floats | None) -> float:
        """Return a factor on a step, at most the given one; see `SkinModel.largest_step`."""
        return factor

    def refusal(self, x: Floats) -> str | None:
        """Return why a state can be no start, as a sentence; None where it can."""
        return None

    def moduli(self, design: Densities) -> Floats | float:
        """Return its part of h (2μ + λ), of the owned triangles or of all, in N/m."""
        return 0.0


class PotentialTerm(Term):
    """A load with a potential, stated by `of_place`."""

    @override
    def take_forms(self, number: int, compiled: Compiled, work: la.Vector) -> None:
        self._work = work
        self._variation = compiled(f"load {number}", lambda forms: forms.loads[number][1])

    def variation(self) -> Floats:
        """Return the first variation of the potential in N: the negative of the force."""
        return assembled(self._variation, self._work)
