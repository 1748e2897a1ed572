"""What is compiled for each kind of skin: the forms of its energy and of its gradient, by rank."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from functools import partial
from typing import Any

import dolfinx.fem
import numpy as np
import pytest
from helpers.standing import solver_on_base
from mpi4py import MPI

from toros_fem.base import fenicsx
from toros_fem.materials.sheet import Bending, Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.designs import LineDesign
from toros_fem.mechanics.terms.loads import Weight
from toros_fem.mechanics.terms.periodic import UNIAXIAL, Periodic
from toros_fem.meshes import cylinder, sew, tile
from toros_fem.products.kinds import KINDS
from toros_fem.products.tiles.stiffness_profile import tile_solver

Maker = Callable[[MPI.Comm], Any]
# A coarse tube of some 250 triangles, and robots as coarse.
EDGE = 9e-3


def scene(name: str, families: int | None = None, **changes: Any) -> Maker:
    """Return what makes the solver of a kind of scene, or that of its relaxed design."""

    def make(comm: MPI.Comm) -> EquilibriumSolver:
        of: Any = KINDS[name].of(edge_length=EDGE, **changes)
        case = of.case(comm, of.finest_level)
        return EquilibriumSolver(
            sew(comm, case.pattern),
            case.composite,
            case.supports,
            chambers=case.chambers,
            contact=case.contact,
            design=None if families is None else partial(LineDesign, families=families),
        )

    return make


def heavy(comm: MPI.Comm) -> EquilibriumSolver:
    """Return the solver of a tube with weight and two chambers, curved when it is made."""
    pattern = cylinder(comm, 0.06, 0.02, EDGE, mesh="structured")
    upper = pattern.points[pattern.triangles, 2].mean(axis=1) > 0.03
    return solver_on_base(
        sew(comm, pattern),
        Composite(bending=Bending(rest="assembled")),
        chambers=Chambers(("lower", "upper"), upper.astype(int)),
        weight=Weight(0.2, 0.5),
    )


def periodic(comm: MPI.Comm, *, flat: bool) -> EquilibriumSolver:
    """Return the solver of a tile that stays in its plane or may leave it."""
    part = tile(comm, 0.02, 5e-3)
    return tile_solver(sew(comm, part.pattern), Composite(), Periodic(part, UNIAXIAL, flat))


SKINS: dict[str, Maker] = {
    "bend": scene("bend"),
    "bend, whole": scene("bend", whole=True),
    "bend, membrane": scene("bend", bending=None),
    "bend, average curvature": scene("bend", bending="average"),
    "bend, hinged seams": scene("bend", seams="hinged"),
    "bend, wrinkling": scene("bend", bending=None, wrinkling="tension-field"),
    "bend, knit": scene("bend", knit_ratio=3.0),
    "bend, bladder": scene("bend", bladder_young=1e5, bladder_thickness=1e-3),
    "bend, print outside": scene("bend", print_side="outside"),
    "bend, bounds of the print": scene("bend", reinforcement_c1=1.2),
    "contract, two families": scene("contract", 2),
    "contract, twelve families": scene("contract", 12),
    "twist, two families": scene("twist", 2),
    "walker": scene("walker"),
    "gripper": scene("gripper"),
    "weight and chambers": heavy,
    "tile": lambda comm: periodic(comm, flat=True),
    "tile out of plane": lambda comm: periodic(comm, flat=False),
}


def described(forms: list[Any]) -> dict[str, str]:
    """Return how many forms of each rank there are, where they act and what they depend on."""
    ranks: dict[int, list[Any]] = defaultdict(list)
    for form in forms:
        ranks[len(form.arguments())].append(form)
    found = {}
    for rank, group in sorted(ranks.items()):
        domains = sorted({part.integral_type() for form in group for part in form.integrals()})
        counts = sorted(len(form.coefficients()) for form in group)
        text = (
            f"{len(group)} by {', '.join(domains)}, of {', '.join(map(str, counts))} coefficients"
        )
        found[f"forms of rank {rank}"] = text
    return found


@pytest.mark.slow
def test_forms_of_an_equilibrium_and_its_gradient(
    comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch, pinned: Callable[..., None]
) -> None:
    """Whatever terms a skin has, and no more than these terms need."""
    compiled: list[Any] = []
    original = dolfinx.fem.form

    def form(given: Any, *rest: Any, **named: Any) -> Any:
        compiled.append(given)
        return original(given, *rest, **named)

    monkeypatch.setattr(dolfinx.fem, "form", form)
    found = {}
    for name, make in SKINS.items():
        compiled.clear()
        monkeypatch.setattr(fenicsx, "_KERNELS", {})
        model = make(comm).model
        # The gradient waits for the first design step.
        model.density_sensitivity(model.assembled, np.zeros(model.size_local))
        found[name] = described(compiled)
    pinned("forms", found)
