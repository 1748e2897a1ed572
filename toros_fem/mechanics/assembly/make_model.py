"""The terms that a skin has: the one place that makes them."""

from __future__ import annotations

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.contact.settings import Contact
from toros_fem.mechanics.contact.skin_contact import SkinContact
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.dead_loads import Weight
from toros_fem.mechanics.skin.designs import Densities, LineDesign
from toros_fem.mechanics.skin.periodicity import Periodic
from toros_fem.mechanics.skin.planes import Planes
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.bend import Bend, OffsetPrint
from toros_fem.mechanics.terms.courses import Courses
from toros_fem.mechanics.terms.dead_loads import DeadForce, OwnWeight
from toros_fem.mechanics.terms.images import Images
from toros_fem.mechanics.terms.line_families import LineFamilies
from toros_fem.mechanics.terms.pressure import Pressure
from toros_fem.mechanics.terms.sheet import RubberLayer, Sheet, TensionSheet
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.skin import Skin


def make_model(
    skin: Skin,
    composite: Composite,
    supports: Supports,
    *,
    chambers: Chambers | None = None,
    weight: Weight | None = None,
    contact: Contact | None = None,
    design: Densities | None = None,
    periodic: Periodic | None = None,
) -> SkinModel:
    """Return the model of a skin with the terms that it has (collective).

    Args:
        skin: The sewn skin.
        composite: The two materials and the stretch bounds.
        supports: Fixed components and directions; with the prescribed ones of a tile's mean
            deformation they must leave no rigid motion.
        chambers: Pressure chambers; None for one.
        weight: The skin's own weight; None for none.
        contact: What the skin touches; None for nothing.
        design: What is designed; None for densities.
        periodic: The tile that the skin is; None for a skin that does not repeat.

    Raises:
        ParameterError: The supports leave a rigid motion, or are made for another pattern; or the
            walls between the chambers cannot be found.
        OpenSkinError: Chambers of a skin with free edges that no symmetry plane closes.
    """
    pattern, bending = skin.pattern, composite.bending
    design = design or Densities(skin)
    if periodic is None and (contact is None or not contact.holds):
        supports.require_no_rigid_motion(pattern, bends=bending is not None)
    planes = Planes(pattern, supports)

    sheet = TensionSheet if composite.membrane.relaxed else Sheet
    terms: list[Term] = [sheet(skin, composite, design)]
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
