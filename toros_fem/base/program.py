"""How the command line is called where it runs, for lines that say what to type next."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path

# Variable by which a script that calls the command line says how it was called itself.
VARIABLE = "TOROS_COMMAND"


def program() -> str:
    """Return the words that call the command line from the current folder, `toros` if they do."""
    if own := os.environ.get(VARIABLE):
        return shlex.quote(own)
    if shutil.which("toros"):
        return "toros"
    called = Path(sys.argv[0])
    if called.name == "toros":  # in an environment that is not activated
        return shlex.quote(str(called))
    return f"{shlex.quote(sys.executable)} -m toros_fem"
