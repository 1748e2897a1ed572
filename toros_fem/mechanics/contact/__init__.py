"""Contact of a skin with itself, the ground and bodies, by barriers and friction (IPC)."""

from toros_fem.mechanics.contact.bodies import RigidBody
from toros_fem.mechanics.contact.pads import Pads
from toros_fem.mechanics.contact.settings import Contact, Ground
from toros_fem.mechanics.contact.solids import rigid_box, rigid_cylinder, rigid_mesh, rigid_sphere

__all__ = [
    "Contact",
    "Ground",
    "Pads",
    "RigidBody",
    "rigid_box",
    "rigid_cylinder",
    "rigid_mesh",
    "rigid_sphere",
]
