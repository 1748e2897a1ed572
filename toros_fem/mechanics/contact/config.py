"""Configurations of scenes whose skin touches something."""

from __future__ import annotations

from dataclasses import dataclass

from toros_fem.base.keys import Length, Positive, Table, key


@dataclass(frozen=True)
class ContactConfig(Table):
    """Friction and distance of contact; SI units."""

    friction: Positive | None = key(
        None, "coefficient of Coulomb's friction on ground and bodies; none for none"
    )
    contact_distance: Length | None = key(
        None,
        "distance of two faces from which on contact acts; none takes half of the fabric's "
        "thickness",
    )
