"""Panels, seams and the sewn skin; ready-made patterns; target shapes.

The public names are those of `meshes.public`. The first one loads them all, so that who imports
one module alone, as the solver does, loads no makers of meshes and no readers of surfaces.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from toros_fem.meshes.public import *  # noqa: F403
    from toros_fem.meshes.public import __all__ as __all__
else:  # hidden from type checkers, to which every name would be known otherwise

    def __getattr__(name: str) -> Any:
        """Return a public name, loaded at the first call."""
        if name == "__all__" or not name.startswith("__"):
            public = importlib.import_module("toros_fem.meshes.public")
            globals().update({one: getattr(public, one) for one in ("__all__", *public.__all__)})
            if name in globals():
                return globals()[name]
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        """Return the public names and what is loaded."""
        return sorted({*globals(), *__getattr__("__all__")})
