"""Configurations of scenes whose skin touches something."""

from __future__ import annotations

from dataclasses import dataclass

from toros_fem.base.config import Config, quantity


@dataclass(frozen=True)
class ContactConfig(Config):
    """Friction and distance of contact; SI units."""

    friction: float | None = quantity(
        None, "coefficient of Coulomb's friction on ground and bodies; none for none", above=0
    )
    contact_distance: float | None = quantity(
        None,
        "distance of two faces from which on contact acts; none takes half of the fabric's "
        "thickness",
        "m",
        above=0,
    )
