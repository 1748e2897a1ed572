"""Where Python makes errors of warnings, all ranks raise them together; each warning is tried."""

from __future__ import annotations

import ast
import warnings
from collections.abc import Callable

import numpy as np
import pytest
from helpers.scenes import ROOT
from mpi4py import MPI

import toros_fem as tf
from toros_fem.base.errors import TorosWarning
from toros_fem.design.density.filters import make_filter
from toros_fem.mechanics.equilibrium.newton import given_options
from toros_fem.meshes import Pattern, cylinder

SOFT = tf.Material(young=1e3, poisson=0.3, thickness=0.5e-3)


def solver(comm: MPI.Comm, **changes: object) -> tf.EquilibriumSolver:
    pattern = tube(comm)
    composite = tf.Composite(bending=None, **changes)  # type: ignore[arg-type]
    held = tf.clamp(pattern, ["base"])
    return tf.EquilibriumSolver(tf.sew(comm, pattern), composite, held)


def tube(comm: MPI.Comm) -> Pattern:
    return cylinder(comm, 0.04, 0.02, 7e-3, mesh="structured")


def misspelt(comm: MPI.Comm) -> None:
    with given_options("-toros_snes_monitr"):
        made = solver(comm)
        made.solve(np.zeros(len(made.skin.owned_cells)), 10.0)


# Each place that warns: its file and how many there are, and calls that lead there.
WARNS: dict[str, list[tuple[type[TorosWarning], Callable[[MPI.Comm], object]]]] = {
    "toros_fem/design/density/filters.py": [
        (TorosWarning, lambda c: make_filter("cone", tf.sew(c, tube(c)), 9e-3))
    ],
    "toros_fem/mechanics/equilibrium/solver.py": [
        (TorosWarning, lambda c: solver(c, fabric=tf.Material(1e5, 0.3, 0.5))),
        (TorosWarning, lambda c: solver(c, reinforcement=SOFT)),
        (
            TorosWarning,
            lambda c: solver(c, reinforcement=tf.Material(26e6, 0.3, 1e-3, c1=2.5, c2=3.0)),
        ),
    ],
    "toros_fem/mechanics/equilibrium/newton.py": [(TorosWarning, misspelt)],
}
CALLS = [(place, k) for place, of in WARNS.items() for k in range(len(of))]


@pytest.mark.parametrize(("place", "number"), CALLS)
def test_a_warning_is_an_error_of_all_ranks(comm: MPI.Comm, place: str, number: int) -> None:
    kind, call = WARNS[place][number]
    with warnings.catch_warnings():
        warnings.simplefilter("error", TorosWarning)
        with pytest.raises(kind) as caught:
            call(comm)
    assert len(set(comm.allgather(str(caught.value)))) == 1


def named(function: ast.expr) -> bool:
    """Whether a function is called by a name, maybe of a module: to write others takes seconds."""
    return isinstance(getattr(function, "value", function), ast.Name)


def test_every_place_that_warns_is_tried() -> None:
    """And no file warns in another way, on one rank alone."""
    found: dict[str, int] = {}
    for top in ("toros_fem", "meshes", "forms"):
        for path in sorted((ROOT / top).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if not isinstance(node, ast.Call):
                    continue
                name = ast.unparse(node.func) if named(node.func) else ""
                place = path.relative_to(ROOT).as_posix()
                if name == "warn_together":
                    found[place] = found.get(place, 0) + 1
                assert name != "warnings.warn" or place == "toros_fem/base/mpi.py", place
    assert found == {place: len(of) for place, of in WARNS.items()}
