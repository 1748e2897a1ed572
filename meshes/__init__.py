"""Panels, seams and the sewn skin; ready-made patterns; target shapes.

The public names are those of `meshes.public`. The first one loads them all, so that who imports
one module alone, as the solver does, loads no makers of meshes and no readers of surfaces.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from toros_fem.base.packages import late_names

if TYPE_CHECKING:
    from toros_fem.meshes.public import *  # noqa: F403
    from toros_fem.meshes.public import __all__ as __all__
else:  # hidden from type checkers, to which every name would be known otherwise
    __getattr__, __dir__ = late_names(__name__)
