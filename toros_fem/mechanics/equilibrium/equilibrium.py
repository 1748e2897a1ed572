"""A stable equilibrium of a skin, with the design and the load that it belongs to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.continuation import NewtonStep
from toros_fem.mechanics.equilibrium.diagnostics import Condition
from toros_fem.mechanics.equilibrium.path import PathPoint
from toros_fem.mechanics.skin.load import Load


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium:
    """Result of a solve; later solves, tangents and reactions need nothing else.

    Attributes:
        density: Projected density of the owned triangles, or rows of a relaxed design.
        load: The requested load, on this skin.
        state: Owned unknowns in m, a flat array, as `SkinModel` has them.
        positions: Positions of the owned nodes in m, (n, 3), a view of `state`.
        converged: Whether `state` is a stable equilibrium under the requested load; of a trial,
            whether it is near to one.
        complete: Whether the state was proven stable; `EquilibriumSolver.finish` completes a trial.
        load_factor: Fraction of the requested load that acts on `state`.
        reason: Why the solve ended, as a sentence.
        pressures: Pressure of each chamber in Pa.
        energy: Energy of eq. (8) in J, less the work of dead forces from the assembled positions.
        volumes: Volume of each chamber in m³.
        stretch_use: Largest fraction of the stretch bounds that a triangle uses, < 1.
        residual: Norm of the first variation over the applied load.
        condition: Whether it may have snapped, is near a limit point, blown up or folded.
        smallest_distance: Smallest distance in m between faces of skin, bodies and ground,
            positive; at most the distance from which on contact acts. None without contact.
        poses: Poses of all bodies, a row of six for each: translation in m, rotation vector in
            rad. None without bodies.
        steps: Number of Newton steps, each with the tangent at its state.
        modified_steps: Number of modified Newton steps, with an older tangent.
        factorisations: Number of factorisations of the tangent, retries with a shift included.
        history: One row for each step of either kind, and one that ends each solve.
        begin: Where the skin stuck at the begin of the step; None for a skin at rest, and without
            friction.
        sliding: Where it sticks to ground and bodies now, for the next step of a path; None without
            friction.
        before: Of a trial the equilibrium that it came from, by which its path is judged.
    """

    density: Floats
    load: Load
    state: Floats
    positions: Floats
    converged: bool
    complete: bool
    load_factor: float
    reason: str
    pressures: tuple[float, ...]
    energy: float
    volumes: tuple[float, ...]
    stretch_use: float
    residual: float
    condition: Condition
    smallest_distance: float | None
    poses: tuple[tuple[float, ...], ...] | None
    steps: int
    modified_steps: int
    factorisations: int
    history: tuple[NewtonStep, ...]
    begin: Floats | None = None
    sliding: Floats | None = None
    before: PathPoint | None = None

    @property
    def pressure(self) -> float:
        """Pressure of `state` in Pa, the largest of all chambers."""
        return max(self.pressures)

    @property
    def volume(self) -> float:
        """Enclosed volume in m³."""
        return sum(self.volumes)

    @property
    def point(self) -> PathPoint:
        """Its design, load and state."""
        return PathPoint(self.density, self.load, self.state)

    def __repr__(self) -> str:
        pressures = ", ".join(f"{pressure:.4g} Pa" for pressure in self.pressures)
        return f"Equilibrium({pressures}, {self.volume:.4g} m³, {self.steps} steps: {self.reason})"

    def numbers(self) -> dict[str, Any]:
        """Return all numbers that JSON can hold; `numbers_read` makes them fields again."""
        found = {name: getattr(self, name) for name in SAVED}
        found["condition"] = asdict(self.condition)
        found["history"] = [asdict(row) for row in self.history]
        found["begin"] = None if self.begin is None else self.begin.tolist()
        found["weight_fraction"] = self.load.weight_fraction
        return found


def readings(model: SkinModel, state: Floats) -> dict[str, Any]:
    """Return the fields that the model tells of a state under its load (collective)."""
    volumes, contact, poses = tuple(float(v) for v in model.volumes(state)), model.contact, None
    if contact is not None and len(contact.poses):
        poses = tuple(tuple(map(float, pose)) for pose in contact.poses_of(state))
    return {
        "state": state,
        "positions": model.positions(state),
        "pressures": tuple(float(p) for p in model.load.pressures),
        "energy": model.energy(state),
        "volumes": volumes,
        "stretch_use": model.bounds.worst(model.corners(state)),
        "smallest_distance": None if contact is None else contact.gap(state),
        "poses": poses,
    }


# Fields that are saved as they are.
SAVED = tuple(
    one.name
    for one in fields(Equilibrium)
    if one.type in ("bool", "int", "float", "str", "float | None")
    or one.name in ("pressures", "volumes", "poses")
)


def numbers_read(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields of an equilibrium from `Equilibrium.numbers`, which may have been JSON."""
    found: dict[str, Any] = {key: numbers[key] for key in SAVED}
    found |= {key: tuple(numbers[key]) for key in ("pressures", "volumes")}
    if numbers["poses"] is not None:
        found["poses"] = tuple(tuple(pose) for pose in numbers["poses"])
    found["condition"] = Condition(**numbers["condition"])
    found["history"] = tuple(NewtonStep(**row) for row in numbers["history"])
    anchors = numbers["begin"]
    found["begin"] = None if anchors is None else np.array(anchors)
    return found


class EquilibriumError(NoEquilibriumError):
    """No equilibrium was found; `result` holds the last good state and the history."""

    def __init__(self, message: str, result: Equilibrium) -> None:
        super().__init__(message)
        self.result = result

    def __reduce__(self) -> tuple[Any, ...]:
        # Exceptions are pickled by their message alone, and ranks exchange them so.
        return type(self), (str(self), self.result)

    @property
    def steps(self) -> int:
        """Number of Newton steps."""
        return self.result.steps

    @property
    def factorisations(self) -> int:
        """Number of factorisations."""
        return self.result.factorisations
