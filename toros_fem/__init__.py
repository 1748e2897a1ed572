"""Design of robotic skins: printed patterns that make an inflated fabric bend, twist or grip.

The public names are those of `toros_fem.public`. Other names are imported from the module that
defines them, such as `toros_fem.measures.regions`. All quantities are in SI units.

The first public name loads them all, with dolfinx and PETSc. Under MPI all ranks take it together,
since PETSc starts on all of them.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

from toros_fem.base.packages import __version__ as __version__
from toros_fem.base.packages import late_names

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
    __getattr__, __dir__ = late_names(__name__, ["__version__"])
