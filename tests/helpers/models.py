"""Small models and their states."""

from functools import partial

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_matrix

from helpers.scenes import square
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.designs import CROSSING, LineDesign
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.loads import Weight
from toros_fem.mechanics.terms.model import SkinModel, make_model
from toros_fem.mechanics.terms.tangent import EXACT, Part, UpperTangent
from toros_fem.meshes import Skin, sew

SIZE = 0.02


def sheet_model(comm: MPI.Comm, composite: Composite) -> SkinModel:
    pattern = square(size=SIZE)
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    fixed[(pattern.points[:, 0] < 1e-9) | (np.arange(len(fixed)) == 6)] = True
    return make_model(sew(comm, pattern), composite, Supports(fixed))


def pressurize(model: SkinModel, *pressures: float) -> None:
    """Let pressures act alone, one for each chamber, in Pa."""
    model.set_load(Load(np.array(pressures, dtype=float)))


def affine(model: SkinModel, F: np.ndarray) -> np.ndarray:
    state = model.assembled
    model.positions(state)[:] = model.positions(state)[:, :2] @ F.T
    return state


def bent_tube(model: SkinModel) -> np.ndarray:
    """A smooth state far from symmetry, the same on any number of ranks but for rotations."""
    state = model.assembled
    x, y, z = model.positions(state).T.copy()
    s = z / 0.06
    model.positions(state).T[:] = x * (1.2 + 0.1 * np.sin(6 * s)) + 0.01 * s**2, 1.1 * y, 1.05 * z
    rotations = state[model.positions(state).size :]
    rotations[:] = 1e-3 * np.sin(np.arange(len(rotations)))
    return state


def spread_by_rounding(model: SkinModel, state: np.ndarray) -> float:
    """Largest difference of the energies of 20 states that differ by rounding."""
    rng, energies = np.random.default_rng(2), []
    for _ in range(20):
        signs = rng.choice([-1.0, 1.0], model.skin.pattern.points.shape)
        noise = signs[model.skin.owned_vertices].ravel()
        energies.append(model.energy(state * (1 + 2**-52 * noise)))
    return max(energies) - min(energies)


def drawn(model: SkinModel, seed: int) -> np.ndarray:
    """A direction, the same on any number of ranks."""
    rng = np.random.default_rng(seed)
    whole = rng.standard_normal(model.skin.pattern.points.shape)
    direction = np.zeros(model.size_local)
    model.positions(direction)[:] = whole[model.skin.owned_vertices]
    rotations = direction[model.positions(direction).size :]
    # Edges have no numbers of their own; which values they get does not matter.
    rotations[:] = np.resize(whole.ravel(), len(rotations))
    return direction * model.free


def dense_tangent(model: SkinModel, state: np.ndarray, part: Part = EXACT) -> np.ndarray:
    """The whole tangent, or a part of it, on every rank."""
    tangent = UpperTangent(model)
    values = np.zeros(len(tangent.columns))
    tangent.assemble(state, values, part)
    shape = (model.size_local, model.space.dofmap.index_map.size_global)
    rows = csr_matrix((values, tangent.columns, tangent.indptr), shape=shape).toarray()
    upper = np.concatenate(model.skin.comm.allgather(rows))
    return upper + np.triu(upper, 1).T


def relaxed_model(
    skin: Skin,
    composite: Composite,
    supports: Supports,
    families: int,
    *,
    weight: Weight | None = None,
    crossing: float = CROSSING,
) -> SkinModel:
    """The model of a relaxed design."""
    design = partial(LineDesign, families=families, crossing=crossing)
    return make_model(skin, composite, supports, weight=weight, design=design)


def line_design(skin: Skin, families: int, seed: int, cover: float = 0.5) -> np.ndarray:
    """Owned rows of a random relaxed design, the same on any number of ranks."""
    rng = np.random.default_rng(seed)
    count = len(skin.pattern.panel)
    shares = cover / families * rng.uniform(0.4, 1, (count, families))
    angles = rng.uniform(-np.pi / 2, np.pi / 2, (count, families))
    vectors = rng.uniform(0.5, 2, (count, families))
    density = rng.uniform(0.02, 0.2, count)
    rows = [density, shares, vectors * np.cos(2 * angles), vectors * np.sin(2 * angles)]
    return np.asarray(np.column_stack(rows)[skin.owned_cells])
