"""Panels that are held and moved as rigid bodies: force, torque, stiffness, and where they rest.

A pose, (6,), is the shift in m of a point of a panel and a rotation vector in rad about it, from
the assembled place. A wrench, (6,), is a force in N and a torque in N m about that point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from dolfinx import la
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from toros_fem.base.errors import ParameterError
from toros_fem.base.fenicsx import work_vector
from toros_fem.base.validation import (
    Bools,
    Floats,
    Ints,
    checked_bools,
    checked_floats,
    require_callable,
    require_finite,
    require_kind,
    require_positive,
    vector,
)
from toros_fem.measures.shape import best_rotation
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load, Pressure, load_of
from toros_fem.mechanics.skin.supports import (
    Planes,
    centre_of,
    rigid_displacement,
    vertices_of_panels,
)
from toros_fem.mechanics.terms.tangent import CHUNK, TriangleMatrices, symmetric
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import skew

# A free panel rests where its wrench is below this part of the forces at its vertices.
RESTS = 1e-7
MOST_STEPS, MOST_HALVINGS = 40, 8
# Largest motion of a free panel in one step, over the skin's size, and its largest turn in rad.
LONGEST_SHIFT, LONGEST_TURN = 0.1, 0.3


def wrench(
    solver: EquilibriumSolver,
    at: Equilibrium,
    panels: Sequence[str],
    about: Sequence[float] | Floats | None = None,
) -> Floats:
    """Return force in N and torque in N m by which supports hold panels, (6,) (collective).

    The skin pushes with the opposite of it. Of a part that symmetry planes cut it is that of the
    part.

    Args:
        solver, at: The solver, and an equilibrium of it.
        panels: Names of panels, which are held as one.
        about: Point in m that the torque is about, (3,); None takes the centre of their area where
            they are.

    Raises:
        PanelError: A panel of that name does not exist.
        ParameterError: No component of the panels is fixed; or as of `tangent_at`.
    """
    require_kind("solver", solver, EquilibriumSolver, "an EquilibriumSolver")
    pattern, held = solver.skin.pattern, solver.model.supports.fixed
    vertices = vertices_of_panels(pattern, panels)
    if not held[vertices].any():
        raise ParameterError(
            f"nothing holds {_names(panels)}, so that no force acts there. Hold it by "
            "clamp(pattern, panels) or displace(…) in the solver's supports."
        )
    pulls = solver.reactions(at)[vertices]
    positions = solver.positions(at)
    point = _point(pattern, panels, positions, about)
    return _resultant(pulls, positions[vertices] - point)


def pose_of_panel(pattern: Pattern, panel: str, positions: Floats) -> Floats:
    """Return the pose of a panel, (6,), whose rigid motion is nearest to what it has.

    The pose is about the centre of its area; positions of all vertices, (n, 3), are in m.
    """
    vertices = vertices_of_panels(pattern, [panel])
    rest, moved = pattern.points[vertices], positions[vertices]
    turn = Rotation.from_matrix(best_rotation(rest, moved))
    centre, middle = centre_of(pattern, [panel], pattern.points), rest.mean(axis=0)
    shift = moved.mean(axis=0) + turn.apply(centre - middle) - centre
    return np.concatenate([shift, turn.as_rotvec()])


def panel_stiffness(
    solver: EquilibriumSolver,
    at: Equilibrium,
    panels: Sequence[str],
    about: Sequence[float] | Floats | None = None,
) -> Floats:
    """Return the derivative of the wrench of held panels by their pose, (6, 6) (collective).

    Row by row force in N and torque in N m, column by column shifts in m and turns in rad about
    fixed axes through the point, which moves with the panels. Pressures are held. It is exact: six
    solves with the tangent. Where a wrench acts it is not symmetric in its turns.

    Args:
        solver, at, panels, about: As of `wrench`.

    Raises:
        ParameterError: A component of the panels is free, there is contact, or the skin is a tile.
    """
    require_kind("solver", solver, EquilibriumSolver, "an EquilibriumSolver")
    model, skin = solver.model, solver.skin
    vertices = _held_vertices(solver, panels)
    solver.tangent_at(at)
    positions = solver.positions(at)
    arms = positions[vertices] - _point(skin.pattern, panels, positions, about)
    modes: Floats = np.zeros((len(positions), 3, 6))
    modes[vertices, :, :3] = np.eye(3)
    modes[vertices, :, 3:] = -skew(arms)
    moved: Floats = np.zeros((model.size_local, 6))
    for mode in range(6):
        model.positions(moved[:, mode])[:] = modes[skin.owned_vertices, :, mode]
    near = _Near(solver, vertices, at.state)
    resisted = near.product(moved)
    for mode in range(6):
        moved[:, mode] -= solver.solve_tangent(resisted[:, mode], at)
    change = near.product(moved)
    forces = np.stack(
        [skin.gather_vertices(model.positions(change[:, mode]))[vertices] for mode in range(6)],
        axis=2,
    )
    pulls = solver.reactions(at)[vertices]
    torques = np.cross(arms[:, :, None], forces, axis=1)
    # The arms turn with the panel.
    torques[:, :, 3:] += np.cross(modes[vertices, :, 3:], pulls[:, :, None], axis=1)
    return np.concatenate([forces.sum(axis=0), torques.sum(axis=0)])


def wrench_sensitivity(
    solver: EquilibriumSolver,
    at: Equilibrium,
    panels: Sequence[str],
    by_wrench: Sequence[float] | Floats,
    *,
    free: Sequence[bool] = (False,) * 6,
    about: Sequence[float] | Floats | None = None,
) -> Floats:
    """Return the derivative of `by_wrench` · `wrench` by the owned design (collective).

    Pressures are held. Free components of the plate move so that their wrench stays what it is, as
    in `solve_rigid`; their entries of `by_wrench` do not count. It takes a solve with the tangent,
    and those of `panel_stiffness` where a component is free.

    Args:
        solver, at, panels, about: As of `wrench`.
        by_wrench: Derivative by force in 1/N and by torque in 1/(N m), (6,).
        free: As of `solve_rigid`.

    Raises:
        ParameterError: As of `panel_stiffness`.
    """
    require_kind("solver", solver, EquilibriumSolver, "an EquilibriumSolver")
    model, skin, loose = solver.model, solver.skin, np.asarray(free)
    vertices = _held_vertices(solver, panels)
    solver.tangent_at(at)
    weights = np.where(loose, 0.0, by_wrench)
    if loose.any():
        stiffness = panel_stiffness(solver, at, panels, about)
        pull = stiffness[np.ix_(~loose, loose)].T @ weights[~loose]
        weights[loose] = -np.linalg.solve(stiffness[np.ix_(loose, loose)].T, pull)
    positions = solver.positions(at)
    arms = positions[vertices] - _point(skin.pattern, panels, positions, about)
    ways = np.zeros_like(positions)
    ways[vertices] = weights[:3] + np.cross(weights[3:], arms)
    adjoint = np.zeros(model.size_local)
    model.positions(adjoint)[:] = ways[skin.owned_vertices]
    resisted = _Near(solver, vertices, at.state).product(adjoint[:, None])[:, 0]
    adjoint -= solver.solve_tangent(resisted, at)
    return model.density_sensitivity(at.state, adjoint)


def solve_rigid(
    solver: EquilibriumSolver,
    density: Floats,
    load: Load | Pressure,
    panels: Sequence[str],
    *,
    free: Sequence[bool] = (True,) * 6,
    applied: Sequence[float] | Floats = (0.0,) * 6,
    about: Sequence[float] | Floats | None = None,
    pose: Sequence[float] | Floats = (0.0,) * 6,
    start: Floats | Equilibrium | None = None,
) -> tuple[Equilibrium, Floats]:
    """Solve for the equilibrium of a skin with panels that move as one rigid plate (collective).

    The solver's supports hold the panels: the plate is moved by the load's displacement, until the
    wrench that holds it is the applied one in all free components. Newton's method takes
    `panel_stiffness`, with the sizes of its eigenvalues, so that it ends at stable places.

    Args:
        solver, density, load, start: As of `EquilibriumSolver.solve`.
        panels: Names of the panels.
        free: Whether x, y, z of the point and the turns about x, y, z are free.
        applied: Force in N and torque in N m on the plate, (6,); held components do not count.
        about: Assembled place in m of the point, (3,); None takes the centre of the panels' area.
        pose: Where the plate begins, and stays in its held components, (6,).

    Returns:
        The equilibrium, and the pose of the plate.

    Raises:
        ParameterError: As of `panel_stiffness`.
        EquilibriumError: There is no equilibrium on the way, or the plate finds no rest.
    """
    require_kind("solver", solver, EquilibriumSolver, "an EquilibriumSolver")
    pattern = solver.skin.pattern
    vertices = _held_vertices(solver, panels)
    loose = checked_bools("free", np.asarray(free), "component of the pose", (6,))
    wanted = checked_floats("applied", applied, "a finite wrench (6,), in N and N m", (6,))
    pose = checked_floats("pose", pose, "a finite pose (6,), in m and rad", (6,))
    point = _point(pattern, panels, pattern.points, about)
    given = load_of(load)
    others = np.ones(len(pattern.points), dtype=bool)
    others[vertices] = False

    def solved(pose: Floats, start: Floats | Equilibrium | None) -> Equilibrium:
        moved = rigid_displacement(pattern, panels, pose[:3], pose[3:], point)
        if given.displacement is not None:
            moved[others] = given.displacement[others]
        return solver.solve(density, replace(given, displacement=moved), start)

    def missing(found: Equilibrium, pose: Floats) -> tuple[Floats, float]:
        """Return by how much the wrench is off in its free components, and the size of forces."""
        pulls = solver.reactions(found)[vertices]
        acting = _resultant(pulls, solver.positions(found)[vertices] - point - pose[:3])
        size_of_forces = float(np.abs(pulls).sum() + np.abs(wanted[:3]).sum())
        return (acting - wanted)[loose] / scale, size_of_forces

    size = pattern.size
    scale = np.repeat([1.0, size], 3)[loose]  # torques as forces at the skin's size
    found = solved(pose, start)
    off, forces = missing(found, pose)
    for _ in range(MOST_STEPS):
        if np.abs(off).max(initial=0.0) <= RESTS * forces:
            return found, pose
        stiffness = panel_stiffness(solver, found, panels, point + pose[:3])
        stiffness = stiffness[np.ix_(loose, loose)] / np.outer(scale, scale)
        step = np.zeros(6)
        step[loose] = _downhill(stiffness, off) / scale
        longest = max(
            np.linalg.norm(step[:3]) / (LONGEST_SHIFT * size),
            np.linalg.norm(step[3:]) / LONGEST_TURN,
            1.0,
        )
        step /= longest
        for _ in range(MOST_HALVINGS):
            tried = _composed(pose, step)
            with_step: Equilibrium | None = None
            try:
                with_step = solved(tried, found)
            except EquilibriumError:  # raised by all ranks or by none
                step /= 2
                continue
            left, forces_there = missing(with_step, tried)
            if longest > 1 or np.linalg.norm(left) < np.linalg.norm(off):
                break
            step /= 2
        else:
            break
        assert with_step is not None
        found, pose, off, forces = with_step, tried, left, forces_there
    raise EquilibriumError(
        f"{_names(panels)} finds no rest: at the pose {np.round(pose, 6).tolist()} (m, rad) "
        f"{np.abs(off).max():.3g} N of its wrench are not the applied one. Begin with a pose that "
        "is nearer, let the load grow in steps, or hold more components.",
        replace(found, converged=False),
    )


def solve_for(
    solver: EquilibriumSolver,
    density: Floats,
    load: Callable[[float], Load | Pressure],
    reading: Callable[[Equilibrium], float],
    goal: float,
    between: tuple[float, float],
    *,
    tolerance: float,
    start: Floats | Equilibrium | None = None,
) -> tuple[float, Equilibrium]:
    """Solve for the number at which a reading of the equilibrium has a value (collective).

    The number is a pressure, a turn of a panel or whatever `load` makes a load of. Each solve
    starts from the equilibrium of the nearest number; Brent's method finds the next.

    Args:
        solver, density, start: As of `EquilibriumSolver.solve`; `start` is for the first number.
        load: Returns the load of a number.
        reading: Returns a value of an equilibrium, the same on all ranks: a component of `wrench`,
            for instance.
        goal: Value that is asked for.
        between: Two numbers, with readings on both sides of the goal.
        tolerance: Largest error of the number.

    Returns:
        The number, and its equilibrium.

    Raises:
        ParameterError: Both readings are on one side of the goal.
        EquilibriumError: A load has no equilibrium.
    """
    require_kind("solver", solver, EquilibriumSolver, "an EquilibriumSolver")
    require_callable("load", load, "a function of a number")
    require_callable("reading", reading, "a function of an Equilibrium")
    first, second = map(float, checked_floats("between", between, "two finite numbers", (2,)))
    require_finite(goal=goal)
    require_positive(tolerance=tolerance)
    known: dict[float, tuple[Equilibrium, float]] = {}

    def off(number: float) -> float:
        if number not in known:
            nearest = min(known, key=lambda other: abs(other - number), default=None)
            begin = start if nearest is None else known[nearest][0]
            found = solver.solve(density, load(number), begin)
            known[number] = found, float(reading(found)) - goal
        return known[number][1]

    ends = off(first), off(second)
    if ends[0] * ends[1] > 0:
        raise ParameterError(
            f"the reading is {ends[0] + goal:.6g} at {first:g} and {ends[1] + goal:.6g} at "
            f"{second:g}, both on one side of the goal {goal:g}. Give numbers further apart."
        )
    root = float(brentq(off, first, second, xtol=tolerance))
    off(root)
    return root, known[root][0]


class _Near:
    """Products of the tangent with rows and columns of held panels, from the triangles there."""

    def __init__(self, solver: EquilibriumSolver, vertices: Ints, state: Floats) -> None:
        model = solver.model
        if model.contact is not None or model.images is not None:
            what = "contact" if model.contact is not None else "a tile that repeats"
            raise ParameterError(
                f"the stiffness of a panel knows no {what}; leave it out of the solver, or take "
                "differences of `wrench` between two poses."
            )
        _require_closed(solver, vertices)
        triangles = TriangleMatrices(model)
        entries = np.zeros(triangles.count + sum(term.pairs.shape[1] for term in model.terms))
        triangles.compute(state, entries)
        self._vector, self._size = work_vector(model.space), model.size_local
        marked = self._vector
        marked.array[:] = 0
        held = np.zeros(len(solver.skin.pattern.points), dtype=bool)
        held[vertices] = True
        nodes = model.positions(marked.array[: self._size])
        nodes[:] = held[solver.skin.owned_vertices, None]
        marked.scatter_forward()
        dofs = np.where(triangles.present, triangles.dofs, triangles.dofs[:, :1])
        met = np.where(triangles.present, marked.array[dofs] > 0, False).any(axis=1)
        self._dofs, self._present = dofs[met], triangles.present[met]
        of_triangle = entries[: triangles.count].reshape(len(dofs), -1)
        self._entries = of_triangle[triangles.rows[met]]

    def product(self, x: Floats) -> Floats:
        """Return the product with owned unknowns (n, k) in rows of the panels (collective).

        Other rows have the part of the triangles that meet the panels.
        """
        return np.stack([self._times(column) for column in x.T], axis=1)

    def _times(self, x: Floats) -> Floats:
        work = self._vector
        work.array[: self._size] = x
        work.scatter_forward()
        local, out = work.array.copy(), np.zeros(len(work.array))
        count = self._dofs.shape[1]
        for begin in range(0, len(self._dofs), CHUNK):
            part = slice(begin, begin + CHUNK)
            dofs, present = self._dofs[part], self._present[part]
            matrices = symmetric(self._entries[part], count)
            values = np.where(present, local[dofs], 0.0)
            products = np.where(present, np.einsum("ijk,ik->ij", matrices, values), 0.0)
            np.add.at(out, dofs, products)
        work.array[:] = out
        work.scatter_reverse(la.InsertMode.add)
        return np.array(work.array[: self._size])


def _require_closed(solver: EquilibriumSolver, vertices: Ints) -> None:
    """Check that what closes a chamber does not end at a panel, unless in a symmetry plane."""
    pattern, pressure = solver.skin.pattern, solver.model.pressure
    in_panel = np.zeros(len(pattern.points), dtype=bool)
    in_panel[vertices] = True
    in_symmetry = Planes(pattern, solver.model.supports).of_symmetry()
    edges = pattern.free_edges
    in_plane = np.any(in_symmetry[edges].all(axis=1), axis=1)
    open_there = np.all(in_panel[edges], axis=1) & ~in_plane
    at_wall = pressure is not None and in_panel[pressure.wall_vertices].any()
    if np.any(open_there) or at_wall:
        raise ParameterError(
            "a lid or a wall between chambers ends at the panel, and its stiffness is not known. "
            "Close the panel by a cap of its own, or take differences of `wrench` between poses."
        )


def _resultant(forces: Floats, arms: Floats) -> Floats:
    """Return the sum of forces (n, 3) and of their torques by their arms, (6,)."""
    return np.concatenate([forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)])


def _held_vertices(solver: EquilibriumSolver, panels: Sequence[str]) -> Ints:
    """Return the vertices of panels, all of whose components are held."""
    vertices = vertices_of_panels(solver.skin.pattern, panels)
    held: Bools = solver.model.supports.fixed[vertices]
    if not held.all():
        raise ParameterError(
            f"{int((~held).sum())} components of {_names(panels)} are free, so that it is no rigid "
            "plate. Hold it by clamp(pattern, panels) in the solver's supports; its pose moves it."
        )
    return vertices


def _point(
    pattern: Pattern,
    panels: Sequence[str],
    positions: Floats,
    about: Sequence[float] | Floats | None,
) -> Floats:
    if about is None:
        return centre_of(pattern, panels, positions)
    return vector("about", about)


def _names(panels: Sequence[str]) -> str:
    words = ", ".join(map(repr, panels))
    return f"panel {words}" if len(panels) == 1 else f"the plate of {words}"


def _composed(pose: Floats, step: Floats) -> Floats:
    """Return a pose after a further shift and turn; its rotation vector goes on beyond π."""
    turned = (Rotation.from_rotvec(step[3:]) * Rotation.from_rotvec(pose[3:])).as_rotvec()
    axis = turned / max(float(np.linalg.norm(turned)), np.finfo(float).tiny)
    turns = np.round(float(axis @ (pose[3:] - turned)) / (2 * np.pi))
    return np.concatenate([pose[:3] + step[:3], turned + 2 * np.pi * turns * axis])


def _downhill(stiffness: Floats, off: Floats) -> Floats:
    """Return the Newton step, or where the stiffness is not positive, one with its sizes."""
    values, vectors = np.linalg.eigh((stiffness + stiffness.T) / 2)
    least = np.finfo(float).eps * np.abs(values).max(initial=0.0)
    if values.min(initial=0.0) > least:
        return np.asarray(-np.linalg.solve(stiffness, off))
    return np.asarray(-vectors @ ((vectors.T @ off) / np.maximum(np.abs(values), least)))
