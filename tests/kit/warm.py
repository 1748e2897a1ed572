"""Compile the forms of every energy term before the tests: `python3 -m kit.warm`.

Two workers would compile the same forms at once, and two ranks would wait for one. What is done is
marked in the cache, so that it costs nothing until a form changes.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from helpers.scenes import ROOT

from toros_fem.base.fenicsx import form_cache
from toros_fem.base.packages import versions


def mark() -> Path:
    """Return the file that says that all these forms are compiled."""
    sources = [*sorted((ROOT / "forms").glob("*.py")), Path(__file__).with_name("terms.py")]
    texts = [*(path.read_bytes() for path in sources), repr(versions()).encode()]
    return form_cache() / f"warm-{hashlib.sha1(b''.join(texts)).hexdigest()[:12]}"


def warm(part: int, parts: int) -> None:
    """Compile the forms of every so many term."""
    from kit.terms import TERMS, model_of, periodic

    steps: list[Callable[[], tuple[np.ndarray, object]]] = [
        *(lambda term=term: model_of(term) for term in TERMS.values()),  # type: ignore[misc]
        periodic,
    ]
    for make in steps[part::parts]:
        state, model = make()
        model.density_sensitivity(state, state)  # type: ignore[attr-defined]


def main() -> None:
    if len(sys.argv) > 1:
        warm(*map(int, sys.argv[1:]))
        return
    if mark().exists():
        return
    parts = min(2, os.cpu_count() or 1)
    command = [sys.executable, "-m", "kit.warm"]
    started = [subprocess.Popen([*command, str(k), str(parts)]) for k in range(parts)]
    if any([process.wait() for process in started]):
        sys.exit("the forms could not be compiled; what is above says why")
    mark().touch()


if __name__ == "__main__":
    main()
