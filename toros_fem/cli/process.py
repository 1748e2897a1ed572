"""The process of `toros`: its exit codes, what it needs, and folders that it can write to.

Only the standard library is loaded here, since nothing else may be there.
"""

from __future__ import annotations

import importlib
import json
import os
import shutil
import stat
import sys
import sysconfig
import tempfile
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from toros_fem.base.errors import (
    NoEquilibriumError,
    OutputError,
    RunStoppedError,
    TorosError,
)

if TYPE_CHECKING:
    from mpi4py import MPI

DONE = 0
INTERNAL = 1
WRONG_INPUT = 2
NO_EQUILIBRIUM = 3
NOT_WRITTEN = 4
MISSING = 5
INTERRUPTED = 130
MEANING = {
    DONE: "done",
    INTERNAL: "an error of the program; please report it",
    WRONG_INPUT: "wrong input: an option, a file or a value",
    NO_EQUILIBRIUM: "no equilibrium was found, or the design failed",
    NOT_WRITTEN: "a folder or file cannot be written or is in use",
    MISSING: "something that the package needs is missing; `toros doctor` says what",
    INTERRUPTED: "stopped by Ctrl-C (SIGINT); the state of a design is written",
    140: "stopped by SIGUSR2, which mpirun passes on; the state of a design is written",
    143: "stopped by SIGTERM; the state of a design is written",
}
WHEELS = (
    "On Linux (x86-64, glibc 2.34 or newer), in the checkout, with Python 3.12 or newer"
    f"{'' if sys.version_info >= (3, 12) else ' (this one is older)'}: pip install '.[fenicsx]'. "
    "Otherwise take the packages of a distribution: see the page Install."
)
LIBRARIES = (
    "It is installed, but needs libraries of the system: on Debian and Ubuntu "
    "apt-get install libgl1 libglu1-mesa libxcursor1 libxft2 libxinerama1 libxrender1."
)
PLAIN = ("numpy", "scipy", "meshio", "h5py", "shapely", "tqdm", "pydantic", "cyclopts")
OLDEST, NEWEST = (0, 9), (0, 11)
HOME, CACHE = "HOME", "XDG_CACHE_HOME"


class UsageError(TorosError, ValueError):
    """The command line is not understood; the message names the word and the nearest known one."""


def exit_code(error: BaseException) -> int:
    """Return the exit code of an error."""
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED
    if isinstance(error, NoEquilibriumError):
        return NO_EQUILIBRIUM
    if isinstance(error, RunStoppedError):
        return 128 + error.signal
    if isinstance(error, OutputError):
        return NOT_WRITTEN
    if isinstance(error, TorosError):
        return WRONG_INPUT
    if isinstance(error, ImportError):
        own = (error.name or "toros_fem").startswith("toros_fem")
        return INTERNAL if own else MISSING
    return INTERNAL


def tell_alone(comm: MPI.Comm, error: Exception) -> None:
    """Print an error that this rank has and others have not."""
    text = f"{type(error).__name__}: {error}"
    if not isinstance(error, TorosError):
        text = "".join(traceback.format_exception(error))
    print(f"rank {comm.rank} alone: {text}", file=sys.stderr, flush=True)


def lacking() -> list[str]:
    """Return what is missing, each with what to do: without it no command works."""
    # In this order: dolfinx from wheels finds its MPI by mpi4py.
    needs: dict[str, tuple[Callable[[], object], str]] = {
        **{name: (_importing(name), f"pip install {name}.") for name in PLAIN},
        "mpi4py": (_importing("mpi4py.MPI"), WHEELS),
        "dolfinx": (_dolfinx, WHEELS),
        "petsc4py": (_petsc, WHEELS),
        "gmsh": (_importing("gmsh"), WHEELS),
    }
    found = []
    for name, (look, remedy) in needs.items():
        try:
            look()
        except Exception as error:
            told = LIBRARIES if isinstance(error, OSError) and name == "gmsh" else remedy
            first = str(error).strip().splitlines()[:1] or [type(error).__name__]
            found.append(f"{name} does not work: {first[0].rstrip('.')}. {told}")
    return found


def lacking_to_compile() -> list[str]:
    """Return what is missing for forms that are not yet compiled, each with what to do."""
    compiler = (os.environ.get("CC") or "cc").split()[0]
    found = []
    if shutil.which(compiler) is None and shutil.which("gcc") is None:
        found.append(
            f"The C compiler {compiler} is not found: forms that are not in the cache cannot be "
            "compiled. Debian and Ubuntu: apt-get install gcc libc6-dev."
        )
    if not (Path(sysconfig.get_path("include")) / "Python.h").exists():
        found.append(
            "Python.h is not found: forms that are not in the cache cannot be compiled. Debian and "
            "Ubuntu: apt-get install python3-dev, or take a Python of uv or pyenv, which has it."
        )
    return found


def tell_missing(words: Sequence[str], error: Exception) -> int:
    """Print what is missing where the command line cannot be loaded; return the exit code."""
    if "doctor" not in words:
        print(f"{error}. `toros doctor` says what to do.", file=sys.stderr)
        return MISSING
    found = [*lacking(), *lacking_to_compile()] or [str(error)]
    if "--json" in words:
        print(json.dumps({"command": "doctor", "exit_code": MISSING, "missing": found}, indent=2))
    else:
        print("\n".join(found), file=sys.stderr)
    return MISSING


def _importing(name: str) -> Callable[[], object]:
    return lambda: importlib.import_module(name)


def _dolfinx() -> None:
    version = str(importlib.import_module("dolfinx").__version__)
    if not OLDEST <= tuple(int(part) for part in version.split(".")[:2]) <= NEWEST:
        raise ImportError(f"version {version} is not one of 0.9 to 0.11")


def _petsc() -> None:
    PETSc = importlib.import_module("petsc4py.PETSc")
    if PETSc.ScalarType is not PETSc.RealType:
        raise ImportError("PETSc is built with complex scalars, real ones are needed")


def use_writable_places() -> None:
    """Let home and cache be folders that can be used, where they are not, in the temporary one.

    Open MPI does not start without a home, and forms are compiled into the cache. All ranks of a
    machine take the same folder.
    """
    home = os.environ.get(HOME, "")
    if not os.path.isdir(home) and (spare := _spare()):
        os.environ[HOME] = home = str(spare)
    cache = os.environ.get(CACHE) or os.path.join(home, ".cache")
    if not _writable(Path(cache)) and (spare := _spare()):
        os.environ[CACHE] = str(spare)


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError):
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def _spare() -> Path | None:
    """Return a temporary folder of this user alone; None if somebody else has its name."""
    folder = Path(tempfile.gettempdir()) / f"toros_fem-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        about = folder.lstat()
    except OSError:
        return None
    own = stat.S_ISDIR(about.st_mode) and about.st_uid == os.getuid()
    return folder if own and not about.st_mode & 0o022 else None
