"""What each public entry says to bad input: the type of its error and its message."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.scenes import shared
from kit.pin import GOLDEN, table_of
from mpi4py import MPI
from package.test_bad_input import CASES, Scene

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


def test_refusals(
    comm: MPI.Comm, tmp_path_factory: pytest.TempPathFactory, pinned: Callable[..., None]
) -> None:
    """On several ranks those cases that might differ there, which every rank compares."""
    folder = shared(comm, tmp_path_factory.mktemp("bad"))
    scene = Scene(comm, folder)
    known: dict[str, Any] = table_of(GOLDEN / "refusals.csv") if comm.size > 1 else {}
    found = {}
    for bad in CASES:
        if comm.size == 1 or bad.risky:
            with pytest.raises(bad.error) as caught:
                bad.call(scene)
            found[bad.name] = plain(caught.value, folder)
    pinned("refusals", {**known, **found})
