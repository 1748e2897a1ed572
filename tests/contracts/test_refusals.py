"""Wrong input ends in a typed error that is short and names the remedy, on all ranks alike."""

# The types are wrong on purpose.
# mypy: disable-error-code="arg-type"

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.scenes import shared
from kit.pin import GOLDEN, table_of
from mpi4py import MPI

import toros_fem as tf
from contracts.inner_refusals import INNER
from contracts.refusals import ON_RANKS, REFUSALS, Scene
from toros_fem import errors as e
from toros_fem import meshes as m

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
