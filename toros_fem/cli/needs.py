"""What the package needs, looked for with the standard library alone, and how to get it."""

from __future__ import annotations

import importlib
import json
import os
import shutil
import sys
import sysconfig
from collections.abc import Callable, Sequence
from pathlib import Path

# Exit code.
MISSING = 5
MEANING = "something that the package needs is missing; `toros doctor` says what"

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
