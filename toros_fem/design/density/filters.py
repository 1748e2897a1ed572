"""Choice of a density filter by its name."""

from __future__ import annotations

from toros_fem.base.array_types import Floats
from toros_fem.base.validation import require_choice, require_kind
from toros_fem.design.density.cone import cone_filter
from toros_fem.design.density.helmholtz import helmholtz_filter
from toros_fem.design.density.linear import Filter
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin

FILTERS = ("cone", "helmholtz")


def make_filter(
    name: str,
    skin: Skin,
    radius: float,
    beyond: Floats | Mirrored | None = None,
) -> Filter:
    """Return the filter of a given name with a radius in m (collective).

    "cone" is `cone_filter`, with what lies beyond the borders, as of `Neighbourhood`. "helmholtz"
    is `helmholtz_filter`, which need not know: it crosses all seams, and its free borders act as
    planes of symmetry.
    """
    require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
    require_choice("filter", name, FILTERS)
    if name == "cone":
        return cone_filter(skin, radius, beyond)
    return helmholtz_filter(skin, radius)
