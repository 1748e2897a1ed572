"""Several stable equilibria of one design under one load, and the one of lowest energy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.base.mpi import norm, require_alike
from toros_fem.base.validation import require_between, require_count, require_kind, require_positive
from toros_fem.mechanics.equilibrium.solver import EquilibriumResult, EquilibriumSolver

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
        best: The one of lowest energy; it is the solver's last one, so that the solver's tangent
            and reactions belong to it.
        energies: Energy in J of each distinct state, ascending.
        counts: How often each of them was found.
        failures: Number of tries that found no equilibrium.
    """

    best: EquilibriumResult
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


def find_states(
    solver: EquilibriumSolver,
    density: Floats,
    pressure: float,
    *,
    force: Floats | None = None,
    start: EquilibriumResult | None = None,
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
        solver: Equilibrium solver.
        density: Projected density of its owned triangles.
        pressure: Pressure in Pa.
        force: Dead forces in N on all assembled vertices, (n, 3).
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
    require_alike(solver.skin.comm, tries=tries, size=size, seed=seed)
    require_count(1, tries=tries)
    require_count(0, seed=seed)
    require_between(0.0, np.inf, pressure=pressure)
    what = "an EquilibriumResult, or None"
    require_kind("start", start, (EquilibriumResult, type(None)), what)
    require_positive(size=size, at_most=0.5)
    if start is not None and not start.converged:
        raise ParameterError(f"the start is no equilibrium: {start.reason}")
    begin = None if start is None else start.state
    best = solver.solve(density, pressure, force=force, start=begin)
    seen, failures = [best.energy], 0
    rng = np.random.default_rng(seed)
    for number in range(tries):
        try:
            if pressure > 0 and number % EVERY == EVERY - 1:
                begin = _inflated(solver, density, pressure, force, best, rng)
            else:
                grown = size * 10 ** (number / max(1, tries - 1) - 1)
                begin = _kicked(solver, best, rng, grown)
            found = solver.solve(density, pressure, force=force, start=begin)
            seen.append(found.energy)
        except NoEquilibriumError:  # raised by all ranks or by none
            found = None
            failures += 1
        if found is not None and found.energy < best.energy - SAME_ENERGY * abs(best.energy):
            best = found
        else:  # the solver's factors are those of the best again
            best = solver.solve(density, pressure, force=force, start=best.state.copy())
    energies: list[float] = []
    counts: list[int] = []
    for energy in sorted(seen):
        if energies and energy - energies[-1] <= SAME_ENERGY * abs(energies[-1]):
            counts[-1] += 1
        else:
            energies.append(energy)
            counts.append(1)
    return FoundStates(best, tuple(energies), tuple(counts), failures)


def _inflated(
    solver: EquilibriumSolver,
    density: Floats,
    pressure: float,
    force: Floats | None,
    at: EquilibriumResult,
    rng: np.random.Generator,
) -> Floats:
    """Return a state on the way down from a larger pressure, near the requested one."""
    factor, ratio = MOST ** rng.uniform(0.25, 1.0), rng.uniform(*LOWERED)
    state = at.state
    while factor > 1:
        # A copy is no state that the solver knows: jumps on the way are wanted here.
        found = solver.solve(
            density, factor * pressure, force=force, start=state.copy(), trial=True
        )
        state, factor = found.state, factor / ratio
    return state.copy()


def _kicked(
    solver: EquilibriumSolver, at: EquilibriumResult, rng: np.random.Generator, size: float
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
