"""The package and what it stands on: versions, extras, names that are loaded late, its command."""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import shlex
import shutil
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from toros_fem.base.errors import MissingPackageError

__version__ = "0.1.0"
# Variable by which a script that calls the command line says how it was called itself.
VARIABLE = "TOROS_COMMAND"


def blas_kernel() -> str | None:
    """Return the kernel type that OpenBLAS has chosen for the processor; None without OpenBLAS."""
    for library in ("libblas.so.3", "libopenblas.so.0"):  # a distribution's, that of wheels
        with contextlib.suppress(OSError, AttributeError):
            name = ctypes.CDLL(library).openblas_get_corename
            name.restype = ctypes.c_char_p
            return str(name().decode())
    return None


def versions() -> dict[str, str]:
    """Return what a result depends on: versions, and the kernel type of OpenBLAS."""
    # Imported here: the number above is asked for by `toros --version`, which is to be quick.
    import importlib.metadata

    import dolfinx
    import numpy as np
    import petsc4py

    gmsh = None
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):  # some have no metadata
        gmsh = importlib.metadata.version("gmsh")
    return {
        "toros_fem": __version__,
        "dolfinx": dolfinx.__version__,
        "petsc4py": petsc4py.__version__,
        "numpy": np.__version__,
        "gmsh": gmsh or "unknown",
        "blas_kernel": blas_kernel() or "unknown",
        "python": sys.version.split()[0],
        "platform": platform.platform(),
    }


# -------------------------------------------------------------------------- extras and late names


def required(name: str, extra: str = "manufacture") -> Any:
    """Return a package of an extra, or raise a MissingPackageError."""
    try:
        return import_module(name)
    except ImportError as missing:
        what = f"{name} is needed ({missing})"
        raise MissingPackageError(f"{what}; in the checkout: pip install '.[{extra}]'") from None


def template(package: str, name: str, extra: str = "manufacture") -> Any:
    """Return a file of a package as a template, which escapes all that it is given."""
    jinja2 = required("jinja2", extra)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(package, ""), autoescape=True,
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.policies["json.dumps_kwargs"] = {"sort_keys": False}  # tables have an order
    return environment.get_template(name)


def late_names(
    package: str, own: Sequence[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package whose public names load at the first call.

    They are those of its module `public`; `own` are further ones, which it has from the start.
    """

    def load(name: str) -> Any:
        here = vars(sys.modules[package])
        if name == "__all__" or not name.startswith("__"):
            public = import_module(f"{package}.public")
            here.update({one: getattr(public, one) for one in public.__all__})
            here["__all__"] = [*own, *public.__all__]
            if name in here:
                return here[name]
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def listed() -> list[str]:
        return sorted({*vars(sys.modules[package]), *load("__all__")})

    return load, listed


# ------------------------------------------------------------------------------------ the command


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
