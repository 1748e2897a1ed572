"""Version of the package, and of what it stands on."""

import contextlib
import ctypes
import importlib.metadata
import platform
import sys

import dolfinx
import numpy as np
import petsc4py

__version__ = "0.1.0"


def blas_kernel() -> str | None:
    """Return the kernel type that OpenBLAS has chosen for the processor; None without OpenBLAS."""
    try:
        name = ctypes.CDLL("libblas.so.3").openblas_get_corename
    except (OSError, AttributeError):
        return None
    name.restype = ctypes.c_char_p
    return str(name().decode())


def versions() -> dict[str, str]:
    """Return the versions that a result depends on, and OpenBLAS's kernel type, where known."""
    known: dict[str, str] = {}
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):  # some have no metadata
        known["gmsh"] = importlib.metadata.version("gmsh")
    kernel = blas_kernel()
    if kernel is not None:
        known["blas_kernel"] = kernel
    return {
        **known,
        "toros_fem": __version__,
        "dolfinx": dolfinx.__version__,
        "petsc4py": petsc4py.__version__,
        "numpy": np.__version__,
        "python": sys.version.split()[0],
        "platform": platform.platform(),
    }
