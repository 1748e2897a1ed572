"""Version of the package, and of what it stands on."""

import contextlib
import ctypes
import platform
import sys

__version__ = "0.1.0"


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
