"""Checks that use only the state of the solver.

Energy, force and tangent are those of the model; the test suite compares them with each other. The
checks use other means than the solver: stretches by a singular value decomposition, the sign of the
tangent by a dense Cholesky factorisation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cholesky, eigvalsh
from scipy.sparse import csr_array, triu

from benchmarks.stability.scenes import Floats
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.terms.model import SkinModel
from toros_fem.mechanics.terms.tangent import UpperTangent
from toros_fem.meshes import Skin

# Residual over the applied load that an equilibrium may have …
RESIDUAL = 1e-8
# … and the one up to which it may be MARGIN times what rounding leaves; 55 cells that rounding
# limits have 0.7 to 1.1 times as much.
ROUNDED, MARGIN = 1e-5, 1.5
# Rounding is the largest of so many draws, which move positions by so many units in the last place.
DRAWS, UNITS = 8, 256


@dataclass(frozen=True)
class Finding:
    """Result of a check.

    Attributes:
        residual: Norm of the first variation over the applied load, if there is a state.
        sign: 1 if the tangent is positive definite up to rounding, else -1.
        faults: Contradictions to a stable equilibrium inside the stretch bounds.
    """

    residual: float | None
    sign: int | None
    faults: list[str]


def scaled_tangent(model: SkinModel, state: Floats) -> tuple[Floats, Floats]:
    """Return dense D K D at the free dofs, and the D that makes its diagonal about 1.

    The scaling keeps the signs and removes contrast and thickness from the eigenvalues. Each vertex
    has one scale, since a flat membrane has no stiffness of its own across its plane.
    """
    tangent = UpperTangent(model)
    value = np.zeros(len(tangent.columns))
    tangent.assemble(state, value)
    size = len(tangent.indptr) - 1
    upper = csr_array((value, tangent.columns, tangent.indptr), shape=(size, size))
    whole = (upper + triu(upper, k=1).T).tocsr()
    free = np.flatnonzero(model.free)
    dense = whole[free][:, free].toarray()
    diagonal = np.abs(whole.diagonal())
    by_vertex = model.positions(diagonal)
    by_vertex[:] = by_vertex.mean(axis=1)[:, None]
    scale = 1 / np.sqrt(diagonal[free])
    return dense * scale[:, None] * scale, scale


class Judge:
    """Checks the states of one skin."""

    def __init__(self, skin: Skin, composite: Composite) -> None:
        self._skin, self._composite = skin, composite
        corner = skin.pattern.corners
        chart = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], axis=2)
        self._inverse = np.linalg.inv(chart)

    def check(
        self, model: SkinModel, density: Floats, load: Load | float, state: Floats
    ) -> Finding:
        """Check whether a state is a stable equilibrium at a density and a load or pressure."""
        if not np.isfinite(state).all():
            return Finding(None, -1, [f"{np.sum(~np.isfinite(state))} positions are not finite"])
        model.set_density(density)
        model.set_load(load if isinstance(load, Load) else Load(np.array([load])))
        force = np.linalg.norm(model.residual(state))
        load_force = self._load(model, state)
        residual = float(force / load_force)
        lowest, noise = self._lowest(model, state)
        faults = self._outside(model.positions(state))
        allowed = max(RESIDUAL, min(ROUNDED, MARGIN * rounding(model, state) / load_force))
        if not residual <= allowed:
            faults.append(f"the residual is {residual:.2e} of the load")
        if lowest < -noise:
            faults.append(f"the tangent's lowest eigenvalue is {lowest:.2e}, noise {noise:.0e}")
        return Finding(residual, -1 if lowest < -noise else 1, faults)

    def is_mechanism(self, model: SkinModel, state: Floats) -> bool:
        """Return whether nothing but rounding holds a state: motions of it cost no energy."""
        dense, _ = scaled_tangent(model, state)
        return bool(eigvalsh(dense, subset_by_index=(0, 0))[0] <= _noise(dense))

    def _load(self, model: SkinModel, state: Floats) -> float:
        """Norm of the applied load; without any, or where supports move, that of the reactions.

        It is at least the force of a strain of 1e-4 where no load is applied.
        """
        load = float(np.linalg.norm(model.applied_load(state)))
        if load > 0 and model.load.displacement is None:
            return load
        least = 1e-4 * model.mean_modulus() * float(np.sqrt(self._skin.pattern.areas.sum()))
        return max(load or least, float(np.linalg.norm(model.reaction(state))))

    def _outside(self, positions: Floats) -> list[str]:
        skin = self._skin
        x = skin.gather_vertices(positions)[skin.pattern.triangles]
        edges = np.stack([x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]], axis=2)
        stretch = np.linalg.svd(edges @ self._inverse, compute_uv=False)
        single = np.abs(stretch - 1).max(axis=1)
        both = np.abs(stretch.sum(axis=1) - 2)
        c1, c2 = self._composite.c1, self._composite.c2
        outside = ~((single < c1 - 1) & (both < c2 - 1))
        if not outside.any():
            return []
        k = int(np.flatnonzero(outside)[0])
        return [f"{outside.sum()} triangles leave the bounds, the first {k} by {stretch[k]}"]

    def _lowest(self, model: SkinModel, state: Floats) -> tuple[float, float]:
        """Lowest eigenvalue of the scaled tangent, and its rounding.

        It is computed only where the cheaper Cholesky factorisation does not settle the sign.

        Returns:
            The eigenvalue, or 0 where none is below the rounding, and the rounding.
        """
        dense, _ = scaled_tangent(model, state)
        noise = _noise(dense)
        try:
            cholesky(dense + noise * np.eye(len(dense)), check_finite=False, overwrite_a=True)
        except LinAlgError:
            return float(eigvalsh(dense, subset_by_index=(0, 0))[0]), noise
        return 0.0, noise


def _noise(dense: Floats) -> float:
    """Rounding of the eigenvalues of a symmetric matrix."""
    return float(len(dense) * np.finfo(float).eps * np.abs(dense).sum(axis=1).max())


def rounding(model: SkinModel, state: Floats) -> float:
    """Return the norm in N of the residual that rounding leaves at an equilibrium.

    Each evaluation of the residual is off by some e, most of all in slivers under a small load. So
    is the step that leads to a state: √2 e are left, and what half a unit in the last place of the
    positions makes. On both sides of a state, the second difference of the residual is √6 e, since
    its linear part cancels.
    """
    rng, middle, found = np.random.default_rng(5), model.residual(state), []
    for _ in range(DRAWS):
        units = rng.integers(-UNITS, UNITS, len(state), endpoint=True)
        move = np.spacing(np.abs(state)) * units * model.free
        up, down = model.residual(state + move), model.residual(state - move)
        evaluated = np.linalg.norm(up - 2 * middle + down) / np.sqrt(3)
        positions = np.linalg.norm(up - down) / (4 * UNITS)
        found.append(float(np.hypot(evaluated, positions)))
    return max(found)
