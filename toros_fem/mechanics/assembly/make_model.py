"""The terms that a skin has: the one place that makes them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypedDict, Unpack

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import require_alike
from toros_fem.base.validation import require_callable, require_kind
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.contact.settings import Contact
from toros_fem.mechanics.contact.skin_contact import SkinContact
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.dead_loads import Weight
from toros_fem.mechanics.skin.designs import Densities, LineDesign
from toros_fem.mechanics.skin.hinges import neighbours
from toros_fem.mechanics.skin.periodicity import Periodic
from toros_fem.mechanics.skin.planes import Planes
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.bend import Bend, OffsetPrint
from toros_fem.mechanics.terms.dead_loads import DeadForce, OwnWeight
from toros_fem.mechanics.terms.images import Images
from toros_fem.mechanics.terms.lines import Courses, LineFamilies
from toros_fem.mechanics.terms.pressure import Pressure
from toros_fem.mechanics.terms.sheet import RubberLayer, Sheet, TensionSheet
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.skin import Skin

# Types of these, and what to say of another one.
_KINDS = {
    "chambers": (Chambers, "Chambers, or None for one"),
    "weight": (Weight, "a Weight, or None for none"),
    "contact": (Contact, "a Contact, or None for none"),
    "periodic": (Periodic, "a Periodic, or None for a skin that does not repeat"),
}


class Further(TypedDict, total=False):
    """What a skin may have besides materials and supports; None, or no entry, leaves it out.

    Attributes:
        chambers: Pressure chambers; None for one.
        weight: The skin's own weight.
        contact: What it touches: itself, the ground, bodies.
        design: Makes of skin and composite what is designed; None for `Densities`. A
            `functools.partial` of `LineDesign` makes line families.
        periodic: The tile that the skin is.
    """

    chambers: Chambers | None
    weight: Weight | None
    contact: Contact | None
    design: Callable[[Skin, Composite], Densities] | None
    periodic: Periodic | None


def make_model(
    skin: Skin, composite: Composite, supports: Supports, **further: Unpack[Further]
) -> SkinModel:
    """Return the model of a skin with the terms that it has (collective).

    The supports, with the prescribed ones of a tile's mean deformation, must leave no rigid motion.

    Raises:
        ParameterError: They leave one, or are made for another pattern; an argument is of another
            type or differs between the ranks; the walls between the chambers cannot be found; or
            a relaxed design is to touch something.
        OpenSkinError: Chambers of a skin with free edges that no symmetry plane closes.
    """
    unknown = further.keys() - Further.__annotations__
    if unknown:
        raise TypeError(
            f"there is no argument {', '.join(sorted(unknown))}; known are "
            f"{', '.join(Further.__annotations__)}."
        )
    require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
    require_alike(skin.comm, composite=composite, supports=supports, **further)
    require_kind("composite", composite, Composite, "a Composite, by Composite(fabric, …)")
    require_kind("supports", supports, Supports, "Supports, by clamp(pattern, panels) for instance")
    for name, (kind, wanted) in _KINDS.items():
        require_kind(name, further.get(name), (kind, type(None)), wanted)
    chambers, weight = further.get("chambers"), further.get("weight")
    contact, periodic = further.get("contact"), further.get("periodic")
    make_design = further.get("design")
    if make_design is not None:
        require_callable("design", make_design, "a function of skin and composite, or None")
    if make_design is None:
        design = Densities(skin, neighbours(skin)[0] if composite.membrane.smoothed else None)
    else:
        design = make_design(skin, composite)
    if isinstance(design, LineDesign):
        _require_known(composite, contact)
    pattern, bending = skin.pattern, composite.bending
    if periodic is None and (contact is None or not contact.holds):
        supports.require_no_rigid_motion(pattern, bends=bending is not None)
    planes = Planes(pattern, supports)

    sheet = TensionSheet if composite.membrane.relaxed else Sheet
    terms: list[Term] = [sheet(skin, composite, supports, design)]
    if composite.bladder is not None:
        terms.append(RubberLayer(skin, composite.bladder))
    if isinstance(design, LineDesign):
        terms.append(LineFamilies(skin, composite, design))
    if composite.knit is not None:
        terms.append(Courses(skin, composite, composite.knit))
    if bending is not None:
        terms.append(Bend(skin, composite, bending, supports))
    if composite.print_side is not None:
        terms.append(OffsetPrint(skin, composite))
    if periodic is not None:
        terms.append(Images(skin, periodic, bends=bending is not None))
    if periodic is None and planes.close:  # a pressure can act
        terms.append(Pressure(skin, supports, planes, chambers))
    elif chambers is not None:
        pattern.require_closed()
    if weight is not None:
        terms.append(OwnWeight(skin, weight))
    terms.append(DeadForce(skin))
    if contact is not None:
        sizes = contact.sizes(composite)
        terms.append(SkinContact(skin, contact, sizes, supports.fixed, planes.of_symmetry()))
    return SkinModel(skin, composite, supports, terms, design)


def _require_known(composite: Composite, contact: Contact | None) -> None:
    """Check that relaxed designs know what the skin has."""
    if contact is not None:
        raise ParameterError("relaxed designs know no contact; leave contact out, or families.")
    if composite.membrane.smoothed:
        raise ParameterError(
            "strain = 'smoothed': the lines of a relaxed design differ from triangle to triangle. "
            'Use Membrane(strain="constant") for it, and smoothed strains for its print.'
        )
