"""Design of robotic skins: printed patterns that make an inflated fabric bend, twist or grip.

The public names are those of `toros_fem.public`. Other names are imported from the module that
defines them, such as `toros_fem.measures.gap`. All quantities are in SI units.

The first public name loads them all, with dolfinx and PETSc. Under MPI all ranks take it together,
since PETSc starts on all of them.
"""

from __future__ import annotations

import contextlib
import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toros_fem.base.versions import __version__ as __version__

# FEniCSx from wheels finds its MPI only if this comes before dolfinx and petsc4py.
with contextlib.suppress(ImportError, RuntimeError):  # dolfinx then tells it too
    import dolfinx_solver as dolfinx_solver

# In a checkout `forms/` and `meshes/` lie beside this folder, in an installed package inside it.
if not (Path(__file__).parent / "forms").is_dir():
    __path__.append(str(Path(__file__).parent.parent))

if TYPE_CHECKING:
    from toros_fem.public import *  # noqa: F403
    from toros_fem.public import __all__ as __all__
else:  # hidden from type checkers, to which every name would be known otherwise

    def __getattr__(name: str) -> Any:
        """Return a public name or a room, loaded at the first call: `toros --help` needs none."""
        if name == "__all__" or not name.startswith("__"):
            public = importlib.import_module("toros_fem.public")
            globals().update({one: getattr(public, one) for one in public.__all__})
            globals()["__all__"] = ["__version__", *public.__all__]
            if name in globals():
                return globals()[name]
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        """Return the public names and what is loaded."""
        return sorted({*globals(), *__getattr__("__all__")})
