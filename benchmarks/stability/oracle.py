"""Whether a case that the solver gave up has an equilibrium.

The barrier keeps the admissible shapes bounded, hence the volume too: an energy without jumps has
its lowest value inside, at any pressure. Only a fold by 180 degrees, where the dihedral angle
changes its sign, makes this one jump. So an error is rarely right, and the oracle searches on.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.linalg import eigh

from benchmarks.stability.judge import Judge, scaled_tangent
from benchmarks.stability.scenes import Floats
from toros_fem.base.errors import TorosError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.terms.model import SkinModel

# Time in s after which neither one path of the solver nor the minimiser begins anything new.
WAY, MINIMISER = 20.0, 60.0
LEVELS = 40


def search_equilibrium(
    judge: Judge, solver: EquilibriumSolver, density: Floats, load: Load
) -> tuple[bool, str]:
    """Return whether small steps on a path, or another minimiser, find one, and how."""
    model = solver.model
    if not judge.check(model, density, load, model.assembled).faults and judge.is_mechanism(
        model, model.assembled
    ):
        return False, "the assembled shape is a mechanism: motions of it cost no energy"
    mean = density.mean()
    ways: dict[str, Callable[[float], tuple[Floats, Load]]] = {
        "from the fabric": lambda fraction: (fraction * density, load),
        "up": lambda fraction: (
            density if load else mean + fraction * (density - mean),
            load.scaled(fraction),
        ),
        "down from ten times the load": lambda fraction: (
            density,
            load.scaled(10 ** (1 - fraction)),
        ),
    }
    findings = []
    for name, way in ways.items():
        state, reached, levels = walk(solver, way)
        if state is not None and reached == 1:
            faults = judge.check(solver.model, density, load, state).faults
            if not faults:
                return True, f"the oracle came there {name} in {levels} levels"
            findings.append(f"{name} to a wrong end ({faults[0]})")
        else:
            findings.append(f"{name} {100 * reached:.0f} %")
    model.set_density(density)
    model.set_load(load)
    state, steps = minimise(model)
    faults = judge.check(model, density, load, state).faults
    if not faults:
        return True, f"a dense trust-region method found an equilibrium in {steps} steps"
    findings.append(f"by a dense trust-region method to where {faults[0]}")
    return False, "the oracle came so far: " + ", ".join(findings)


def walk(
    solver: EquilibriumSolver, way: Callable[[float], tuple[Floats, Load]]
) -> tuple[Floats | None, float, int]:
    """Follow equilibria along a way from 0 to 1, in steps that shrink where the solver fails.

    Returns:
        The last equilibrium, how far along the way it is, and the levels tried.
    """
    begin = time.perf_counter()
    state, reached, step, levels = None, 0.0, 1 / 16, 0
    while reached < 1 and levels < LEVELS and step > 1e-3 and time.perf_counter() < begin + WAY:
        levels += 1
        fraction = min(1.0, reached + step)
        density, load = way(fraction)
        try:
            state = solver.solve(
                density,
                Load(load.pressures, force=load.force, displacement=load.displacement),
                start=state,
            ).state
        except TorosError:
            step /= 4
            continue
        reached = fraction
        step *= 1.5
    return state, reached, levels


def minimise(model: SkinModel) -> tuple[Floats, int]:
    """Lower the energy from the assembled positions by an exact trust-region method.

    It shares neither steps nor tests with the solver: it knows all eigenvalues of the tangent,
    and leaves a saddle by the lowest mode as soon as it is there. The start is shaken a little,
    since a flat sheet never leaves its plane by itself. Dense, so for small scenes only.

    Returns:
        Where it stopped, which is for the judge to judge, and the steps.
    """
    begin = time.perf_counter()
    free = np.flatnonzero(model.free)
    shake = 1e-5 * model.skin.pattern.size * np.random.default_rng(4).standard_normal(len(free))
    state = model.assembled
    if model.load.displacement is not None:
        moved = model.load.displacement[model.skin.owned_vertices]
        model.positions(state)[: len(moved)] += moved
    state[free] += shake
    energy = model.energy(state)
    if not np.isfinite(energy):  # the moved supports leave the stretch bounds at once
        return state, 0
    noise = 1e-13 * abs(energy)
    radius, steps = 0.0, 0
    while time.perf_counter() < begin + MINIMISER:
        tangent, scale = scaled_tangent(model, state)
        curvature, mode = eigh(tangent, overwrite_a=True, check_finite=False)
        force = model.residual(state)[free]
        slope = mode.T @ (force * scale)
        if steps == 0:
            radius = 1e-2 * float(np.linalg.norm(state[free] / scale))
        while True:
            step = _bounded_step(curvature, slope, radius)
            trial = state.copy()
            trial[free] += scale * (mode @ step)
            lower = model.energy(trial)
            gain = energy - lower
            expected = -float(slope @ step + step @ (curvature * step) / 2)
            if gain >= 1e-4 * expected and gain > noise:
                break
            # Where the energy cannot tell any more, the force can.
            if abs(gain) <= noise and np.linalg.norm(model.residual(trial)) < 0.9 * np.linalg.norm(
                force
            ):
                break
            radius = 0.3 * min(radius, float(np.linalg.norm(step)))
            if radius < 1e-15 * np.linalg.norm(state[free] / scale):
                return state, steps
        if gain > 0.75 * expected:
            radius = max(radius, 2 * float(np.linalg.norm(step)))
        state, energy, steps = trial, lower, steps + 1
    return state, steps


def _bounded_step(curvature: Floats, slope: Floats, radius: float) -> Floats:
    """Lowest point of a quadratic in a ball, in the basis of its modes."""
    if curvature[0] > 0:
        newton = -slope / curvature
        if np.linalg.norm(newton) <= radius:
            return np.asarray(newton)
    low = max(0.0, -curvature[0]) * (1 + 1e-10) + 1e-14 * curvature[-1]
    high = low + float(np.linalg.norm(slope)) / radius
    for _ in range(100):
        middle = (low + high) / 2
        if np.linalg.norm(slope / (curvature + middle)) > radius:
            low = middle
        else:
            high = middle
    step = -slope / (curvature + high)
    if curvature[0] < 0:  # what is left of the radius goes down the lowest mode
        rest = np.sqrt(max(0.0, radius**2 - step @ step))
        step[0] -= 0.9 * np.copysign(rest, slope[0])
    return np.asarray(step)
