"""Wrong input ends in a typed error that is short and names the remedy, on all ranks alike."""

# The types are wrong on purpose.
# mypy: disable-error-code="arg-type"

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.scenes import shared, square
from kit.pin import GOLDEN, table_of
from mpi4py import MPI

import toros_fem as tf
from contracts.inner_refusals import INNER
from contracts.refusals import ON_RANKS, REFUSALS, SQUARE, Scene, Table, _solver
from toros_fem import errors as e
from toros_fem import meshes as m
from toros_fem.base.files import guarded
from toros_fem.cli.scene_files.reading import read_scene
from toros_fem.design.density.cone import cone_filter
from toros_fem.design.density.field import random_density
from toros_fem.design.loop.physics import InflatedSkin
from toros_fem.mechanics.paths.load_path import LoadPath
from toros_fem.mechanics.paths.states import find_states
from toros_fem.mechanics.readings.error_estimate import estimate_error
from toros_fem.products.tubes.bend import BendScene

# Characters of the longest message: about three lines of a terminal.
LONGEST = 320
# What differs between processes, machines and versions of what reads a file.
NOISE = (
    (r"0x[0-9a-f]{6,}", "0x…"),
    (r"array\([^…]*", "array("),
    (r"\[[-+.e\d]* [-+.e\d ]+\]", "[…]"),  # coordinates with their rounding
    (r"of triangle \d+", "of triangle …"),  # the first in the mesh's own order
    (r"cannot be read: .*\. Give", "cannot be read: …. Give"),
    (r"(\(\w+Error): .*\)", r"\1: …)"),
)


def plain(error: Exception, folder: Path) -> str:
    """Return type and message of an error, without what changes from run to run."""
    text = f"{type(error).__name__}: {error}".replace(str(folder), "FOLDER")
    for noise, mark in NOISE:
        text = re.sub(noise, mark, text)
    return text


@pytest.fixture(scope="module")
def scene(comm: MPI.Comm, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return Scene(comm, shared(comm, tmp_path_factory.mktemp("bad")))


def raised(call: Callable[[], object]) -> Exception | None:
    """Return what a call raises."""
    try:
        call()
    except Exception as error:
        return error
    return None


def test_refusals(scene: Scene, pinned: Callable[..., None]) -> None:
    """Types and messages are pinned; every rank says the same."""
    several = scene.comm.size > 1
    assert not REFUSALS.keys() & INNER.keys(), "each row has a name of its own"
    found: dict[str, str] = dict(table_of(GOLDEN / "refusals.csv")) if several else {}
    for name in ON_RANKS if several else REFUSALS | INNER:
        error = raised(lambda call=(REFUSALS | INNER)[name]: call(scene))  # type: ignore[misc]
        message = str(error)
        assert isinstance(error, e.TorosError), f"{name}: {error!r}"
        assert type(error) is not e.TorosError
        assert len(message) <= LONGEST, f"{len(message)} characters: {message}"
        assert re.search(r"[.?]$", message), message
        assert len(set(scene.comm.allgather(message))) == 1, message
        found[name] = plain(error, scene.folder)
    pinned("refusals", found)


LONGER = replace(m.WALKER, arm_length=0.07)
BEND, RULES = BendScene(), [tf.DesignOptions()] * 2
# By the argument or the field that the message names; what follows a space tells rows apart.
DIFFERENT: Table = {
    "length": lambda s: m.cylinder(s.comm, s.by_rank(0.04, 0.05), 0.02, 7e-3),
    "edge_length": lambda s: m.cylinder(s.comm, 0.04, 0.02, s.by_rank(7e-3, "fine")),
    "edge_length of a new mesh": lambda s: m.remeshed(s.comm, s.finger, s.by_rank(4e-3, 5e-3)),
    "outline": lambda s: m.two_panels(s.comm, s.by_rank(SQUARE, SQUARE[::-1]), 4e-3),
    "star.arm_length": lambda s: m.walker(s.comm, 6e-3, s.by_rank(m.WALKER, LONGER)),
    "path": lambda s: m.read_surface(s.comm, s.by_rank("a.stl", "b.stl")),
    "changes": lambda s: read_scene("a.toml", comm=s.comm, changes=s.by_rank([], ["seed=3"])),
    "pattern.flat_points": lambda s: tf.sew(s.comm, s.by_rank(s.pattern, square())),
    "composite.c1": lambda s: _solver(
        s, composite=tf.Composite(c1=s.by_rank(1.9, 1.8), bending=None)
    ),
    "supports.fixed": lambda s: _solver(
        s, supports=s.by_rank(s.held, tf.clamp(s.pattern, ["tip"]))
    ),
    "options.max_steps": lambda s: s.solver.like(
        options=tf.NewtonOptions(max_steps=s.by_rank(8, 9))
    ),
    "chambers": lambda s: s.solver.like(chambers=s.by_rank(None, "upper")),
    "load": lambda s: s.solver.solve(s.plain, s.by_rank(100.0, 200.0)),
    "trial": lambda s: s.solver.solve(s.plain, 100.0, trial=s.by_rank(False, True)),
    "trial on one rank": lambda s: s.solver.solve(s.plain, 1e2, **s.by_rank({}, {"trial": True})),
    "chambers on one rank": lambda s: s.solver.like(**s.by_rank({}, {"chambers": "upper"})),
    "start": lambda s: s.solver.solve(s.plain, 100.0, s.by_rank(None, s.solver.model.assembled)),
    "loads": lambda s: list(tf.trace(s.solver, s.plain, s.by_rank([1e2, 2e2], [1e2, np.nan]))),
    "pressures": lambda s: LoadPath(s.solver, [1e2]).solve(s.plain, s.by_rank(None, [[1e2]])),
    "direct": lambda s: estimate_error(s.solver, s.result, [], direct=s.by_rank(False, True)),
    "tries": lambda s: find_states(s.solver, s.plain, 100.0, tries=s.by_rank(2, 3)),
    "radius": lambda s: cone_filter(s.skin, s.by_rank(0.012, 0.013)),
    "spread": lambda s: random_density(s.skin, 3, spread=s.by_rank(0.1, 0.2)),
    "regularisation.filter_radius": lambda s: s.designed(filter_radius=s.by_rank(0.012, 0.013)),
    "case.target": lambda s: s.designed(target=s.by_rank(s.pattern.points, 1.1 * s.pattern.points)),
    "pressure": lambda s: InflatedSkin(s.solver, s.by_rank(500.0, 600.0)),
    "pressure of a simulation": lambda s: s.design.simulate(s.plain, pressure=s.by_rank(1.0, 2.0)),
    "case.pressure": lambda s: s.design.towards(replace(s.design.case, pressure=1e2 + s.comm.rank)),
    "seed": lambda s: tf.optimize(s.design, [tf.Stage(1)], seed=s.comm.rank),
    "options": lambda s: tf.optimize(s.design, [tf.Stage(1 + s.comm.rank)]),
    "options of levels": lambda s: tf.optimize_levels([s.design], s.by_rank(RULES, RULES[:1])),
    "levels": lambda s: tf.refinements(s.design, s.by_rank(1, 2)),
    "folder": lambda s: tf.open_run(s.comm, s.folder / f"run {s.comm.rank}", {}),
    "inputs": lambda s: tf.open_run(s.comm, s.folder / "run", {"seed": s.comm.rank}),
    "resume": lambda s: tf.open_run(s.comm, s.folder / "run", {}, resume=s.by_rank(False, True)),
    "BendScene.target.angle": lambda s: BEND.updated(angle=60.0 + s.comm.rank).case(
        s.comm, BEND.finest_level
    ),
    "BendScene.skin.length": lambda s: BEND.updated(length=0.1 + 0.01 * s.comm.rank).run_design(
        s.comm, s.folder / "bend"
    ),
}


@pytest.mark.parametrize("name", list(DIFFERENT))
def test_different_arguments_on_the_ranks(scene: Scene, name: str) -> None:
    if scene.comm.size == 1:
        pytest.skip("one rank has nothing to differ from")
    told = re.escape(name.split()[0])
    with pytest.raises(e.ParameterError, match=f"^{told} differs between the ranks: .* on rank 1"):
        DIFFERENT[name](scene)


def test_a_folder_of_each_rank_is_none_of_all(scene: Scene) -> None:
    if scene.comm.size == 1:
        pytest.skip("one rank has nothing to differ from")
    for call in (tf.DesignReporter, lambda comm, folder: guarded(comm, folder, lambda: None)):
        with pytest.raises(e.ParameterError, match="folder differs between the ranks"):
            call(scene.comm, scene.folder / str(scene.comm.rank))


def test_more_ranks_than_triangles(scene: Scene) -> None:
    """It is told before anything is distributed; as many ranks as triangles are enough."""
    comm = scene.comm
    corners = [(0.0, 0.0, 0.0), (0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.01, 0.01, 0.0)]
    triangles = [[0, 1, 2], [1, 3, 2]][: max(1, comm.size - 1)]
    pattern = m.moulded(np.array(corners)[: 2 + len(triangles)], triangles)
    if comm.size > len(triangles):
        words = f"{len(triangles)} triangles cannot be shared by {comm.size} ranks"
        with pytest.raises(e.PatternError, match=words):
            tf.sew(comm, pattern)
    else:
        assert len(tf.sew(comm, pattern).owned_cells) == len(triangles)
