"""Several stable equilibria of one design under one load, and the one of lowest energy."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.base.mpi import collective, norm
from toros_fem.base.validation import require_count, require_kind, require_positive
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load, Pressure, load_of

# Energies that differ by less than this fraction are those of one state or of its mirror image.
SAME_ENERGY = 1e-7
# Inverse iterations for a soft mode, each from another random vector: few keep several soft modes.
ITERATIONS = 3
# Fraction of the distance to the stretch bounds that a kick may use up.
TO_THE_BOUNDS = 0.5
# Every third try inflates the skin by a pressure up to MOST times the requested one and lowers it
# by a factor in this range at a time.
EVERY, MOST, LOWERED = 3, 100.0, (1.3, 2.0)


@dataclass(frozen=True, eq=False)
class FoundStates:
    """Stable equilibria that a search saw.

    Attributes:
        best: The one of lowest energy.
        energies: Energy in J of each distinct state, ascending.
        counts: How often each of them was found.
        failures: Number of tries that found no equilibrium.
    """

    best: Equilibrium
    energies: tuple[float, ...]
    counts: tuple[int, ...]
    failures: int

    def __str__(self) -> str:
        listed = ", ".join(
            f"{energy:.6g} J ({count}×)"
            for energy, count in zip(self.energies, self.counts, strict=True)
        )
        noun = "state" if len(self.energies) == 1 else "states"
        missed = f"; {self.failures} tries found none" if self.failures else ""
        return f"{len(self.energies)} stable {noun} seen: {listed}{missed}."


@collective("solver.skin.comm", owned=("density", "start"))
def find_states(
    solver: EquilibriumSolver,
    density: Floats,
    load: Load | Pressure,
    *,
    start: Equilibrium | None = None,
    tries: int = 12,
    size: float = 0.02,
    seed: int = 0,
) -> FoundStates:
    """Find several stable equilibria, and the one of lowest energy (collective).

    Two of three tries move the best state so far along a random mixture of its soft modes and
    release it. The third inflates it by a larger pressure, if one acts, and lowers that in steps:
    crumples then form anew. A search like this finds low states; it does not prove that there is
    no lower one.

    Args:
        solver, density: As of `EquilibriumSolver.solve`.
        load: What acts; a number is a pressure in Pa.
        start: An equilibrium of this solver at this density and load; None solves for it.
        tries: Number of tries.
        size: Largest motion along soft modes over the skin's size; the last tries have it, the
            first ones a tenth of it.
        seed: Of the random mixtures; they do not depend on the number of ranks.

    Raises:
        ParameterError: An argument is outside its bounds, or the start is no equilibrium.
        EquilibriumError: There is no equilibrium to start from.
    """
    require_kind("solver", solver, EquilibriumSolver, "an EquilibriumSolver")
    require_count(1, tries=tries)
    require_count(0, seed=seed)
    what = "an Equilibrium, or None"
    require_kind("start", start, (Equilibrium, type(None)), what)
    require_positive(size=size, at_most=0.5)
    if start is not None and not start.converged:
        raise ParameterError(f"the start is no equilibrium: {start.reason}")
    acting = load_of(load).on(solver.model)
    best = solver.solve(density, acting, start)
    seen, failures = [best.energy], 0
    rng = np.random.default_rng(seed)
    for number in range(tries):
        try:
            if acting.largest > 0 and number % EVERY == EVERY - 1:
                begin = _inflated(solver, best, rng)
            else:
                grown = size * 10 ** (number / max(1, tries - 1) - 1)
                begin = _kicked(solver, best, rng, grown)
            found = solver.solve(density, acting, begin)
        except NoEquilibriumError:  # raised by all ranks or by none
            failures += 1
            continue
        seen.append(found.energy)
        if found.energy < best.energy - SAME_ENERGY * abs(best.energy):
            best = found
    counts: dict[float, int] = {}
    same = np.nan
    for energy in sorted(seen):
        same = same if energy - same <= SAME_ENERGY * abs(same) else energy
        counts[same] = counts.get(same, 0) + 1
    return FoundStates(best, tuple(counts), tuple(counts.values()), failures)


def _inflated(solver: EquilibriumSolver, at: Equilibrium, rng: np.random.Generator) -> Floats:
    """Return a state on the way down from a larger pressure, near the requested one."""
    factor, ratio = MOST ** rng.uniform(0.25, 1.0), rng.uniform(*LOWERED)
    state = at.state
    while factor > 1:
        # Starts are states, not equilibria: jumps on the way are wanted here.
        larger = replace(at.load, pressure=factor * at.load.pressures)
        state = solver.solve(at.density, larger, state, trial=True).state
        factor /= ratio
    return state


def _kicked(
    solver: EquilibriumSolver, at: Equilibrium, rng: np.random.Generator, size: float
) -> Floats:
    """Return a state moved along soft modes, as far as bounds and contact allow (collective)."""
    model, skin = solver.model, solver.skin
    # Drawn by assembled vertex: the same on any number of ranks.
    drawn = rng.standard_normal(skin.pattern.points.shape)
    mode = np.zeros_like(at.state)
    model.positions(mode)[:] = drawn[skin.owned_vertices]
    for _ in range(ITERATIONS):
        mode = solver.solve_tangent(mode, at)
        mode /= norm(skin.comm, mode)
    farthest = np.abs(skin.gather_vertices(model.positions(mode))).max()
    mode *= size * skin.pattern.size / farthest
    allowed = model.largest_step(at.state, mode, TO_THE_BOUNDS)
    return np.asarray(at.state + allowed * mode)
