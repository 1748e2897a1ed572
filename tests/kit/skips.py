"""Why tests may be skipped where every optional package and a browser are there."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec
from typing import Any

# What only one of the ways to FEniCSx has.
NO_HEADER = "FEniCSx from wheels has no header of CHOLMOD"
NO_WHEELS = "FEniCSx is not from wheels"
# The others are comparisons of several ranks with one, on one.
EXPECTED = (
    NO_HEADER if find_spec("dolfinx_solver") else NO_WHEELS,
    "needs two ranks to compare with one",
    "one rank has nothing to differ from",
)


def unexpected_skips(reports: Iterable[Any]) -> list[str]:
    """Return the tests that were skipped for another reason, with it."""
    found = []
    for report in reports:
        why = str(report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr)
        if not why.removeprefix("Skipped: ").startswith(EXPECTED):
            found.append(f"{report.nodeid}: {why}")
    return found
