"""Wrong input ends in a typed error that is short and names the remedy, on all ranks alike."""

# The types are wrong on purpose.
# mypy: disable-error-code="arg-type"

from __future__ import annotations

import re
from collections.abc import Callable
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
from toros_fem.mechanics.paths.states import find_states

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


DIFFERENT: Table = {
    "length": lambda s: m.cylinder(s.comm, s.by_rank(0.04, 0.05), 0.02, 7e-3),
    "edge_length": lambda s: m.cylinder(s.comm, 0.04, 0.02, s.by_rank(7e-3, "fine")),
    "outline": lambda s: m.two_panels(s.comm, s.by_rank(SQUARE, SQUARE[::-1]), 4e-3),
    "path": lambda s: m.read_surface(s.comm, s.by_rank("a.stl", "b.stl")),
    "pattern": lambda s: tf.sew(s.comm, s.by_rank(s.pattern, square())),
    "composite": lambda s: _solver(s, composite=tf.Composite(c1=s.by_rank(1.9, 1.8), bending=None)),
    "supports": lambda s: _solver(s, supports=s.by_rank(s.held, tf.clamp(s.pattern, ["tip"]))),
    "load": lambda s: s.solver.solve(s.plain, s.by_rank(100.0, 200.0)),
    "trial": lambda s: s.solver.solve(s.plain, 100.0, trial=s.by_rank(False, True)),
    "start": lambda s: s.solver.solve(s.plain, 100.0, s.by_rank(None, s.solver.model.assembled)),
    "loads": lambda s: list(tf.trace(s.solver, s.plain, s.by_rank([1e2, 2e2], [1e2, np.nan]))),
    "direct": lambda s: tf.estimate_error(s.solver, s.result, [], direct=s.by_rank(False, True)),
    "tries": lambda s: find_states(s.solver, s.plain, 100.0, tries=s.by_rank(2, 3)),
    "filter_radius": lambda s: s.designed(filter_radius=s.by_rank(0.012, 0.013)),
    "target": lambda s: s.designed(target=s.by_rank(s.pattern.points, 1.1 * s.pattern.points)),
    "seed": lambda s: tf.optimize(s.design, [tf.Stage(1)], seed=s.comm.rank),
    "folder": lambda s: tf.open_run(s.comm, s.folder / f"run {s.comm.rank}", {}),
    "inputs": lambda s: tf.open_run(s.comm, s.folder / "run", {"seed": s.comm.rank}),
    "resume": lambda s: tf.open_run(s.comm, s.folder / "run", {}, resume=s.by_rank(False, True)),
    "options": lambda s: tf.optimize(s.design, [tf.Stage(1 + s.comm.rank)]),
}


@pytest.mark.parametrize("name", list(DIFFERENT))
def test_different_arguments_on_the_ranks(scene: Scene, name: str) -> None:
    if scene.comm.size == 1:
        pytest.skip("one rank has nothing to differ from")
    with pytest.raises(e.ParameterError, match=f"{name} differs between the ranks: .* on rank 1"):
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
