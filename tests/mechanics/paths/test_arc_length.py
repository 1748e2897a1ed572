"""Paths through limit points: against closed forms, dense eigenvalues, and solves by pressure."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from helpers.models import dense_tangent
from helpers.scenes import TABLE_A
from helpers.standing import solver_on_base
from mpi4py import MPI
from scipy.optimize import brentq

from benchmarks.accuracy.snapping import Scene, roof, unbounded_tube
from toros_fem.base.errors import ParameterError
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.bodies import Ground
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths import arc_length
from toros_fem.mechanics.paths.arc_length import ArcLengthOptions
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import TracePoint, limit_points
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.loads import Weight
from toros_fem.meshes import Skin, sew
from toros_fem.meshes.pattern import Panel, Pattern

HALF, HEIGHT = 0.01, 4e-3  # m, half side and height of the pyramid


@pytest.fixture(scope="module")
def pyramid(alone: MPI.Comm) -> Scene:
    """Four triangles on a fixed square, their apex pushed down by a force of 1 N."""
    slant = np.hypot(HALF, HEIGHT)
    flat = np.array([[-HALF, 0], [HALF, 0], [0, slant]])
    panels = []
    for k in range(4):
        c, s = np.cos(k * np.pi / 2).round(), np.sin(k * np.pi / 2).round()
        corners = np.array([[-HALF, -HALF, 0], [HALF, -HALF, 0], [0, 0, HEIGHT]])
        turned = corners @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        panels.append(Panel(f"side {k}", flat, np.array([[0, 1, 2]]), turned))
    pattern = Pattern.from_panels(panels, tolerance=1e-9)
    apex = pattern.points[:, 2] > HEIGHT / 2
    supports = Supports(np.repeat(~apex[:, None], 3, axis=1))
    composite = Composite(fabric=TABLE_A, reinforcement=TABLE_A, c1=1e5, c2=1e5, bending=None)
    skin = sew(alone, pattern)
    solver = EquilibriumSolver(skin, composite, supports)
    force = np.asarray(np.outer(apex, [0.0, 0.0, -1.0]))
    return Scene(pattern, solver, np.zeros(len(skin.owned_cells)), force=force)


def pyramid_force(height: float | np.ndarray) -> float | np.ndarray:
    """The force in N that holds the apex at a height in m: only the slant heights stretch."""
    rest, slant = np.hypot(HALF, HEIGHT), np.hypot(HALF, height)
    stiffness = TABLE_A.thickness * (TABLE_A.mu + TABLE_A.lam / 2)
    return -4 * HALF * rest * 4 * stiffness / 2 * (slant / rest - 1) * height / slant / rest


def followed(scene: Scene, **options: float | None) -> list[TracePoint]:
    path = trace(  # type: ignore[call-overload]
        scene.solver,
        scene.density,
        Load(scene.pressure, force=scene.force),
        by="arc-length",
        options=ArcLengthOptions(**options),  # type: ignore[arg-type]
    )
    return list(path)


def require_counts(scene: Scene, points: Sequence[TracePoint]) -> None:
    """Check the negative eigenvalues against those of the whole matrix."""
    model = scene.solver.model
    for point in points:
        force = None if scene.force is None else point.load_factor * scene.force
        model.set_density(scene.density)
        model.set_load(Load(np.array([point.result.pressure]), force))
        eigenvalues = np.linalg.eigvalsh(dense_tangent(model, point.result.state))
        assert point.negative_eigenvalues == np.count_nonzero(eigenvalues < 0)
        assert point.stable == point.result.converged == (eigenvalues[0] > 0)


def test_a_pyramid_follows_its_closed_form(pyramid: Scene) -> None:
    """Through both limit points and the unstable branch between, upside down to the other side."""
    top = float(pyramid_force(brentq(lambda z: HALF**2 * np.hypot(HALF, HEIGHT)
                                     - np.hypot(HALF, z) ** 3, 0, HEIGHT)))  # fmt: skip
    points = followed(
        pyramid, first=0.02 * top, first_increment=0.1 * top, largest_increment=0.2 * top,
        lowest=None, highest=2 * top,
    )  # fmt: skip
    apex = int(np.argmax(pyramid.pattern.points[:, 2]))
    heights = np.array([point.positions[apex, 2] for point in points])
    factors = np.array([point.load_factor for point in points])
    assert factors == pytest.approx(pyramid_force(heights), rel=1e-8, abs=1e-10 * top)
    assert heights[0] > 0.9 * HEIGHT
    assert heights[-1] < -HEIGHT
    assert factors[-1] == 2 * top
    highest, lowest = limit_points(points)
    assert highest.largest
    assert not lowest.largest
    assert highest.load_factor == pytest.approx(top, rel=1e-3)
    assert lowest.load_factor == pytest.approx(-top, rel=1e-3)
    assert [p.stable for p in points[: highest.after + 1]] == [True] * (highest.after + 1)
    assert not any(p.stable for p in points[highest.after + 1 : lowest.after + 1])
    require_counts(pyramid, points)


def test_a_coarse_roof_snaps_through(alone: MPI.Comm) -> None:
    """Limit points, counts of negative eigenvalues, energy along the path, and stable solves."""
    scene, top = roof(6, 6.35e-3)
    points = followed(scene, first=0.01, lowest=None, highest=0.3)
    first, second = limit_points(points)
    assert first.largest
    assert second.load_factor < 0 < first.load_factor
    require_counts(scene, points[::4])
    down = np.array([-point.positions[top, 2] for point in points])
    assert (np.diff(down[first.after + 1 : second.after]) < 0).any(), "the roof snaps back"
    # Along equilibria the energy changes by what the loads do not do: dE/dλ = −f · u.
    work = [np.vdot(scene.force, p.positions - scene.pattern.points) for p in points]
    energy = np.array([point.result.energy for point in points])
    factors = np.array([point.load_factor for point in points])
    change = [-(b - a) * (u + v) / 2 for (a, b), (u, v) in
              zip(pairwise(factors), pairwise(work), strict=True)]  # fmt: skip
    assert np.sum(change) == pytest.approx(energy[-1] - energy[0], rel=0.02)
    # Both stable branches are those that Newton's method finds at a fixed load.
    for point in (points[first.after], points[-1]):
        found = scene.solver.solve(
            scene.density,
            Load(0.0, force=point.load_factor * scene.force),
            start=point.result.state,
        )
        assert found.steps <= 1
        positions = scene.solver.skin.gather_vertices(found.positions)
        assert positions == pytest.approx(point.positions, abs=1e-9)


def test_all_loads_are_scaled_by_one_factor(short_tube: Skin) -> None:
    """Pressure, dead forces and weight: at load factor 1 the path meets the solve at once."""
    pattern = short_tube.pattern
    solver = solver_on_base(short_tube, weight=Weight(0.2, 0.7))
    density = np.full(len(short_tube.owned_cells), 0.3)
    force = np.asarray(np.outer(pattern.vertex_areas, [30.0, 0.0, 0.0]))
    options = ArcLengthOptions(first=0.3, first_increment=0.3, largest_increment=0.4)
    points = list(trace(solver, density, Load(2e3, force=force), by="arc-length", options=options))
    assert points[-1].load_factor == 1
    assert points[0].result.pressure == pytest.approx(600)
    assert all(point.stable for point in points)
    direct = solver.solve(density, Load(2e3, force=force))
    positions = short_tube.gather_vertices(direct.positions)
    assert points[-1].positions == pytest.approx(positions, abs=1e-7 * pattern.size)
    # And back down from there, with another start.
    options = ArcLengthOptions(first=1.0, first_increment=-0.3, largest_increment=0.4, lowest=0.3)
    back = list(
        trace(
            solver, density, Load(2e3, force=force), start=direct, by="arc-length", options=options
        )
    )
    assert back[-1].load_factor == 0.3
    assert back[-1].positions == pytest.approx(points[0].positions, abs=1e-7 * pattern.size)


def test_a_load_that_stays(pyramid: Scene) -> None:
    """A weight on the apex, while another grows: their sum follows the closed form."""
    assert pyramid.force is not None
    stays = 5.0
    path = trace(
        pyramid.solver, pyramid.density, Load(force=pyramid.force), by="arc-length",
        options=ArcLengthOptions(
            first=0.5, first_increment=2.0, largest_increment=4.0, lowest=None, highest=None,
            max_points=30,
        ),
        held=Load(force=stays * pyramid.force),
    )  # fmt: skip
    points = list(path)
    apex = int(np.argmax(pyramid.pattern.points[:, 2]))
    heights = np.array([point.positions[apex, 2] for point in points])
    factors = np.array([point.load_factor for point in points])
    assert np.ptp(heights) > HEIGHT
    assert factors + stays == pytest.approx(pyramid_force(heights), rel=1e-7, abs=1e-7)
    last = points[-1].result.load.force
    assert last == pytest.approx((stays + factors[-1]) * pyramid.force)


def test_volumes_lead_past_the_largest_pressure(alone: MPI.Comm) -> None:
    """Of a tube that bulges: volume by volume the pressures are those of the path by arc length."""
    scene = unbounded_tube(8)
    by_arc = followed(scene, first=1.0, first_increment=1.0, lowest=None, highest=None,
                      largest_increment=5.0, max_points=60)  # fmt: skip
    pressures = np.array([point.result.pressure for point in by_arc])
    volumes = np.array([point.result.volume for point in by_arc])
    peak = int(np.argmax(pressures))
    assert 3 < peak < len(by_arc) - 6, "the pressure falls"
    chosen = [peak - 3, peak + 2, peak + 4, peak + 6]
    assert not by_arc[chosen[1]].stable
    start = scene.solver.solve(scene.density, pressures[0])
    path = trace(scene.solver, scene.density, [*volumes[chosen]], by="volume", start=start)
    for number, point in zip(chosen, path, strict=True):
        assert point.result.volume == pytest.approx(volumes[number], rel=1e-8)
        assert point.result.pressure == pytest.approx(pressures[number], rel=1e-5)
        assert point.result.converged == by_arc[number].stable, "at a held pressure"
        assert point.negative_eigenvalues == max(by_arc[number].negative_eigenvalues - 1, 0)


def test_a_path_by_volume_begins_under_pressure(short_tube: Skin) -> None:
    solver = solver_on_base(short_tube)
    density = np.full(len(short_tube.owned_cells), 0.3)
    rest = solver.solve(density, 1e3)
    with pytest.raises(ParameterError, match="needs start=solver.solve"):
        next(trace(solver, density, [2e-5], by="volume"))
    with pytest.raises(ParameterError, match="volume 1 = -1"):
        next(trace(solver, density, [-1.0], by="volume", start=rest))
    with pytest.raises(ParameterError, match="held belongs to a path"):
        next(trace(solver, density, [1e3], held=Load(1.0)))
    # The remedy, from a start with other loads, which stay.
    force = np.asarray(np.outer(short_tube.pattern.vertex_areas, [30.0, 0.0, 0.0]))
    loaded = solver.solve(density, Load(1e3, force=force))
    same, point = trace(
        solver, density, [loaded.volume, 1.05 * loaded.volume], by="volume", start=loaded
    )
    assert same.result.pressure == pytest.approx(1e3, rel=1e-6)
    again = solver.solve(density, Load(point.result.pressure, force=force), loaded)
    assert again.volume == pytest.approx(1.05 * loaded.volume, rel=1e-6)


def test_a_path_ends_where_it_is_told(pyramid: Scene) -> None:
    points = followed(pyramid, first=1e-3, first_increment=1e-3, max_points=3)
    assert len(points) == 3
    path = trace(
        pyramid.solver, pyramid.density, Load(0.0, force=pyramid.force), by="arc-length",
        options=ArcLengthOptions(first=1e-3, first_increment=1e-3),
        stop=lambda point: point.load_factor > 3e-3,
    )  # fmt: skip
    factors = [point.load_factor for point in path]
    assert factors[-2] <= 3e-3 < factors[-1]
    # Another user of the solver does not disturb the path, nor the path them.
    path = trace(
        pyramid.solver, pyramid.density, Load(0.0, force=pyramid.force), by="arc-length",
        options=ArcLengthOptions(first=1e-3, first_increment=1e-3, max_points=3),
    )  # fmt: skip
    disturbed = []
    for point in path:
        disturbed.append(point.load_factor)
        other = pyramid.solver.solve(np.ones_like(pyramid.density), Load(0.0, force=pyramid.force))
    assert disturbed == [point.load_factor for point in points]
    forces = pyramid.solver.reactions(other)
    next(trace(pyramid.solver, pyramid.density, Load(0.0, force=pyramid.force), by="arc-length"))
    assert pyramid.solver.reactions(other) == pytest.approx(forces, abs=1e-12)


def test_a_step_that_fails_is_halved(pyramid: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """However small the first one was: steps grow until one takes too many of Newton's."""
    monkeypatch.setattr(arc_length, "MAX_STEPS", 2)
    assert len(followed(pyramid, first=1e-3, first_increment=1e-6, max_points=25)) == 25


def test_paths_that_cannot_be_followed(pyramid: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    held = np.where(pyramid.force[:, [2]] < 0, 0.0, np.ones(3))
    path = trace(pyramid.solver, pyramid.density, Load(0.0, force=held), by="arc-length")
    with pytest.raises(ParameterError, match="do not move the skin"):
        next(path)
    # What comes before the end is yielded, and the error has the last point.
    options = ArcLengthOptions(first=1e-3, first_increment=1e-3)
    path = trace(
        pyramid.solver,
        pyramid.density,
        Load(0.0, force=pyramid.force),
        by="arc-length",
        options=options,
    )
    assert next(path).load_factor == 1e-3
    monkeypatch.setattr(arc_length, "TURN", 2.0)
    with pytest.raises(EquilibriumError, match="the path ends at load factor 0.001") as caught:
        next(path)
    assert not caught.value.result.converged
    assert caught.value.result.load_factor == 1e-3


@pytest.mark.slow
def test_a_path_on_which_contact_begins(short_tube: Skin) -> None:
    """The tube bulges onto a floor: the path ends where the pressure alone leads."""
    pytest.importorskip("ipctk")
    floor = Contact(ground=Ground((-0.0112, 0.0, 0.0), (1.0, 0.0, 0.0)), self_contact=False)
    solver = solver_on_base(short_tube, contact=floor)
    density = np.full(len(short_tube.owned_cells), 0.02)
    options = ArcLengthOptions(first=0.1, first_increment=0.3, largest_increment=0.3)
    path = list(trace(solver, density, 5e3, by="arc-length", options=options))
    distances = [point.result.smallest_distance for point in path]
    reach = floor.sizes(Composite()).distance
    assert distances[0] == reach
    assert 0 < distances[-1] < reach
    alone = solver.solve(density, 5e3)
    assert path[-1].result.energy == pytest.approx(alone.energy, rel=1e-9)
