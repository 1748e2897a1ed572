"""What a skin may touch, and the distances of contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from toros_fem.base.array_types import Bools
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    checked_bools,
    checked_floats,
    checked_list,
    checked_names,
    require_flag,
    require_kind,
    require_positive,
    unit_vector,
)
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.bodies import RigidBody

# Distance within which contact acts, over the thickness.
RANGE = 0.5


@dataclass(frozen=True)
class Ground:
    """A half-space that nothing enters.

    Attributes:
        point: A point of its surface, in m.
        normal: Direction out of it; its length does not matter.
    """

    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        point = checked_floats("point", self.point, "a finite vector of three, in m", (3,))
        normal = unit_vector("normal", self.normal, "that out of the ground")
        object.__setattr__(self, "point", tuple(float(v) for v in point))
        object.__setattr__(self, "normal", tuple(float(v) for v in normal))


@dataclass(frozen=True, eq=False)
class Contact:
    """Contact of a skin with itself, the ground and rigid bodies.

    Faces keep their distance by the barriers of incremental potential contact (Li et al. 2020):
    contact acts from `distance` on and grows without bound towards zero. The distance is that of
    the faces of sheets with `thickness`: middle surfaces stay a whole thickness apart, and half of
    it from bodies and ground. Both are lengths of the sheet, not of the mesh.

    Attributes:
        ground: The ground, or several half-spaces; None for none.
        bodies: Rigid bodies: held, moved with the load, or free.
        self_contact: Whether the skin's layers touch each other.
        friction: Coefficient μ of Coulomb's friction of the skin on ground and bodies; None for
            none. Layers of the skin slide on each other without friction, and so do bodies on each
            other and on the ground.
        pads: Vertices that slide on the ground by coefficients of their own; None for none.
        thickness: In m, which the sheet takes up between its faces; None takes the fabric's.
        distance: In m, from which on contact acts; None takes half of the thickness.
        stiffness: In Pa, the scale of the contact pressure: it is reached where the distance has
            shrunk by about a half; None takes the fabric's E.
        slip: In m, the tangential motion at which friction is fully mobilised; None takes
            `distance`.
    """

    ground: Ground | Sequence[Ground] | None = None
    bodies: Sequence[RigidBody] = ()
    self_contact: bool = True
    friction: float | None = None
    pads: Pads | None = None
    thickness: float | None = None
    distance: float | None = None
    stiffness: float | None = None
    slip: float | None = None

    def __post_init__(self) -> None:
        grounds = () if self.ground is None else self.ground
        if isinstance(grounds, Ground):
            grounds = (grounds,)
        what = "Grounds, by Ground(point, normal), or None"
        object.__setattr__(self, "ground", checked_list("ground", grounds, Ground, what))
        what = "RigidBodies, by rigid_sphere for instance"
        object.__setattr__(self, "bodies", checked_list("bodies", self.bodies, RigidBody, what))
        checked_names("names of bodies", [body.name for body in self.bodies])
        require_flag(self_contact=self.self_contact)
        names = ["friction", "thickness", "distance", "stiffness", "slip"]
        given = {name: getattr(self, name) for name in names}
        require_positive(**{name: size for name, size in given.items() if size is not None})
        require_kind("pads", self.pads, (Pads, type(None)), "Pads, or None")
        if self.pads is not None and (not self.ground or self.friction is None):
            raise ParameterError(
                "pads slide on the ground, and all other faces have friction: give ground and "
                "friction, or leave the pads out."
            )
        if not (self.ground or self.bodies or self.self_contact):
            raise ParameterError(
                "this contact touches nothing: give ground or bodies, set self_contact, or give "
                "no contact at all."
            )

    @property
    def grounds(self) -> tuple[Ground, ...]:
        """All half-spaces."""
        assert isinstance(self.ground, tuple)
        return self.ground

    @property
    def free_bodies(self) -> tuple[int, ...]:
        """Numbers of the bodies that move freely."""
        return tuple(k for k, body in enumerate(self.bodies) if body.free)

    @property
    def holds(self) -> bool:
        """Whether it may keep the skin from moving as a whole: it rubs on ground or body."""
        return self.friction is not None and bool(self.ground or self.bodies)

    def sizes(self, composite: Composite) -> ContactSizes:
        """Return thickness, distance, stiffness and slip, each as given or as the sheet has it."""
        fabric = composite.fabric
        thickness = fabric.thickness if self.thickness is None else self.thickness
        distance = RANGE * thickness if self.distance is None else self.distance
        return ContactSizes(
            thickness,
            distance,
            fabric.young if self.stiffness is None else self.stiffness,
            distance if self.slip is None else self.slip,
        )


@dataclass(frozen=True)
class ContactSizes:
    """Numbers of a contact, all given.

    Attributes:
        thickness, distance, slip: In m, as of `Contact`.
        stiffness: In Pa.
    """

    thickness: float
    distance: float
    stiffness: float
    slip: float

    @property
    def reach(self) -> float:
        """Distance in m of middle surfaces from which on contact acts."""
        return self.thickness + self.distance


@dataclass(frozen=True, eq=False)
class Pads:
    """Pads on a skin that slide easily in one direction along the ground.

    Attributes:
        vertices: Whether each assembled vertex carries a pad, (n,).
        direction: Direction in which they slide easily; its length does not matter. What of it is
            normal to the ground is left out.
        forward: Coefficient of friction in this direction.
        backward: Coefficient against this direction and across it, at least `forward`.
    """

    vertices: Bools
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    forward: float = 0.2
    backward: float = 0.8

    def __post_init__(self) -> None:
        require_positive(backward=self.backward)
        require_positive(at_most=self.backward, forward=self.forward)
        shape = (len(self.vertices),)
        vertices = checked_bools("vertices", self.vertices, "assembled vertex", shape).copy()
        vertices.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        given = unit_vector("direction", self.direction)
        object.__setattr__(self, "direction", tuple(float(v) for v in given))
