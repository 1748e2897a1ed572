"""A term of a skin's energy: what it may add, and nothing by default."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, override

import numpy as np
from dolfinx import fem, la

from toros_fem.base.fenicsx import assembled
from toros_fem.base.validation import Floats, Ints, LocalInts
from toros_fem.forms.energy import EnergyTerm, SkinForms
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.designs import Densities
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import Patch, Unknowns
from toros_fem.mechanics.skin.stretch_bounds import StretchBounds
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.skin import Skin

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


class ContactTerm(Term, ABC):
    """Term of contact, with what the solver asks of surfaces that may meet, rub and move.

    Attributes:
        distance: Distance of faces in m from which on contact acts.
        self_contact: Whether the skin's layers touch each other.
        slides: Whether there is friction, by which the residual has no potential.
        free_bodies: Number of free bodies, which have unknowns.
        poses: Poses of all bodies, (k, 6) in m and rad, of those without unknowns as the load has
            them.
    """

    distance: float
    self_contact: bool
    slides: bool
    free_bodies: int
    poses: Floats

    @abstractmethod
    def crossed(self, x: Floats) -> bool:
        """Return whether surfaces intersect, by a test of its own."""

    @abstractmethod
    def gap(self, x: Floats) -> float:
        """Return the smallest distance of faces in m, at most that from which on contact acts."""

    # Bodies.

    @abstractmethod
    def poses_of(self, x: Floats) -> Floats:
        """Return the poses of all bodies in a state, (k, 6), in m and rad."""

    @abstractmethod
    def reach(self, change: Floats) -> float:
        """Return the largest motion in m of a body by a change of the poses, (k, 6)."""

    @abstractmethod
    def set_motions(self, x: Floats, motions: Floats) -> None:
        """Write the unknowns of the free bodies, which all ranks but the first ignore."""

    @abstractmethod
    def with_short_turns(self, x: Floats) -> Floats:
        """Return the same places, with rotations of free bodies of at most π."""

    # Friction; without it the first two do nothing.

    @abstractmethod
    def begin_step(self, sliding: Floats | None, load: Load) -> None:
        """Begin a step of a path with friction, under the load of the step.

        It goes on from the end of the step before; None stands for a skin at rest at its assembled
        positions.
        """

    @abstractmethod
    def lag_friction(self, x: Floats) -> None:
        """Let friction have the normal forces and tangent planes of a state."""

    @abstractmethod
    def end_step(self, x: Floats) -> Floats | None:
        """Return where the vertices stick at the end of a step; None without friction."""

    @abstractmethod
    def coupling(self, x: Floats, change: Floats, *, transposed: bool = False) -> Floats:
        """Return the change of friction by that of the normal forces: the part without symmetry.

        x is the state of the last `lag_friction`, and `change` that of the state; `transposed`
        multiplies by the transpose.
        """


class ContactSettings(ABC):
    """What is given of contact: a `mechanics.contact.contact.Contact`, which makes its own term.

    So a solver without contact knows nothing of ground, bodies and friction.
    """

    @property
    @abstractmethod
    def holds(self) -> bool:
        """Whether it may keep the skin from moving as a whole."""

    @abstractmethod
    def term(self, skin: Skin, composite: Composite, supports: Supports) -> ContactTerm:
        """Return the term of a skin (collective)."""
