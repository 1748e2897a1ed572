"""`toros doctor`: what the package runs on."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import shutil
import time
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.keys import Flag, key
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.packages import versions
from toros_fem.cli.command import Answer, Command
from toros_fem.cli.process import MISSING, lacking, lacking_to_compile

PACKAGES = (
    "mpi4py", "scipy", "gmsh", "meshio", "h5py", "shapely", "tqdm", "cvxopt", "jinja2",
    "matplotlib", "ezdxf", "ipctk", "lib3mf", "u-nesting",
)  # fmt: skip
# A tube of some hundred triangles, on which all is tried.
LENGTH, DIAMETER, EDGE, PRESSURE = 0.06, 0.02, 5e-3, 2e3


class Doctor(Command, kw_only=True):
    """Says what the package runs on, and tries it.

    Versions, MPI, solvers, caches and their sizes. The equilibrium of a small tube is found, which
    takes a second, or half a minute where forms are compiled first. Where something is missing, it
    says what to do. Please add what it prints to a report of a fault.
    """

    no_solve: Flag = key(False, "leave out the equilibrium of a small tube")

    EXAMPLES: ClassVar = ("toros doctor", "toros doctor --json", "mpirun -n 2 toros doctor")

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Look around, and solve (collective)."""
        missing = [one for of in comm.allgather(lacking()) for one in of]
        if missing:
            missing = list(dict.fromkeys([*missing, *lacking_to_compile()]))
            return Answer("\n".join(missing), {"missing": missing}, MISSING)
        from toros_fem.mechanics.equilibrium import cholmod

        figures: dict[str, Any] = on_first_rank(comm, lambda: _environment(comm))
        calls = cholmod.library(comm)
        figures["solvers"]["cholmod"] = None if calls is None else f"by {calls.source}"
        if not self.no_solve:
            figures["tried"] = _solve(comm)
        return Answer(_text(figures), figures)


def _environment(comm: MPI.Comm) -> dict[str, Any]:
    from petsc4py import PETSc

    known = versions()
    system = known.pop("platform")
    library = MPI.Get_library_version().strip("\x00").splitlines()[0].strip()
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return {
        "versions": {
            **known,
            "PETSc": ".".join(str(part) for part in PETSc.Sys.getVersion()),
            **{name: _version(name) for name in PACKAGES},
        },
        "platform": system,
        "mpi": {"library": library, "ranks": comm.size, "standard": MPI.Get_version()},
        "memory_gib": memory_gib(),
        "solvers": {"mumps": PETSc.Sys.hasExternalPackage("mumps")},
        "to_compile": lacking_to_compile(),
        "compiler": shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc"),
        # Compiled forms, and the compiled calls of CHOLMOD.
        "caches": {str(home / name): _size(home / name) for name in ("fenics", "toros_fem")},
    }


def _version(name: str) -> str | None:
    """Return the version of a package, or None where it is missing."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        # Some distributions install modules without metadata.
        return None if importlib.util.find_spec(name) is None else "of unknown version"


def memory_gib() -> float | None:
    """Return the machine's memory in GiB, or None where it is not told."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30)
    except (AttributeError, ValueError, OSError):
        return None


def _size(folder: Path) -> dict[str, float] | None:
    """Return number and size of the files in a folder; None if there is no such folder."""
    if not folder.is_dir():
        return None
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {"files": len(files), "mb": sum(path.stat().st_size for path in files) / 1e6}


def _solve(comm: MPI.Comm) -> dict[str, Any]:
    """Find the equilibrium of a small tube, which also compiles the forms (collective)."""
    from toros_fem.materials.sheet import Composite
    from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
    from toros_fem.mechanics.skin.supports import clamp
    from toros_fem.meshes.sheets import cylinder
    from toros_fem.meshes.skin import sew

    begin = time.perf_counter()
    pattern = cylinder(comm, LENGTH, DIAMETER, EDGE)
    solver = EquilibriumSolver(sew(comm, pattern), Composite(), clamp(pattern, ["base"]))
    found = solver.solve(np.zeros(len(solver.model.skin.owned_cells)), PRESSURE)
    return {
        "triangles": len(pattern.panel),
        "newton_steps": found.steps,
        "linear_solver": solver.linear_solver,
        "seconds": comm.bcast(time.perf_counter() - begin),
    }


def _text(figures: dict[str, Any]) -> str:
    mpi, memory = figures["mpi"], figures["memory_gib"]
    rows = [
        ("platform", figures["platform"]),
        ("memory", f"{memory:.1f} GiB" if memory else None),
        ("MPI", f"{mpi['library']}; {mpi['ranks']} rank{'s' * (mpi['ranks'] > 1)} now"),
        ("compiler", _known(figures["compiler"])),
        ("solvers", _listed(figures["solvers"])),
    ]
    for place, size in figures["caches"].items():
        held = "empty" if size is None else f"{size['files']} files, {size['mb']:.1f} MB"
        rows.append(("cache", f"{place}: {held}"))
    if tried := figures.get("tried"):
        told = f"{tried['triangles']} triangles: {tried['newton_steps']} Newton steps, "
        rows.append(("tried", f"{told}{tried['seconds']:.1f} s, {tried['linear_solver']}"))
    lines = [f"  {name:<12} {_known(value)}" for name, value in figures["versions"].items()]
    lines = ["versions", *lines, *(f"{what:<14} {text}" for what, text in rows)]
    return "\n".join([*lines, *figures["to_compile"]])


def _listed(found: dict[str, Any]) -> str:
    return ", ".join(f"{name}: {_known(value)}" for name, value in found.items())


def _known(value: Any) -> str:
    return {True: "yes", False: "no", None: "missing"}.get(value, str(value))
