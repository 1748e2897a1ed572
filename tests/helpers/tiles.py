"""Tiles and targets for tests, and the exact states of laminates."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import shapely
from mpi4py import MPI
from scipy.spatial import cKDTree
from shapely.affinity import translate
from shapely.geometry import box
from shapely.geometry.base import BaseGeometry

from toros_fem.base.mpi import dot
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import Stage
from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.terms.periodic import UNIAXIAL, Periodic
from toros_fem.meshes import Tile, sew, tile
from toros_fem.products.tiles.problem import (
    TileCase,
    TileDesignScene,
    TileResult,
    simulated_print,
    tile_problem,
)
from toros_fem.products.tiles.report import MEMBRANE, PrintedTile
from toros_fem.products.tiles.stiffness_profile import (
    Contrast,
    Profile,
    ProfileSolver,
    ProfileTarget,
    tile_solver,
)
from toros_fem.products.tiles.tile import random_waves

SIDE = 0.02
ANGLES = np.arange(12) * np.pi / 12
# Materials A and R of the reference tables, 1 mm thick, with moduli in kPa: N/m are Pa.
A = Material(young=400e6 / 3, poisson=1 / 3, thickness=1e-3)
R = Material(young=400e8 / 3, poisson=1 / 3, thickness=1e-3)


def table_composite() -> Composite:
    return Composite(A, R, c1=1.8, c2=2.0, bending=None)


# Making a solver takes longer than a solve, so tests share tiles and solvers.
@cache
def tile_of(
    edges: int,
    mesh: str = "crossed",
    shape: tuple[float, float] = (1.0, 1.0),
    symmetry: str = "none",
) -> Tile:
    """Return a tile with sides `shape` times SIDE and this number of edges along SIDE."""
    sides = (SIDE * shape[0], SIDE * shape[1])
    return tile(MPI.COMM_WORLD, sides, SIDE / edges, mesh, symmetry)


@cache
def solver_of(
    tile: Tile,
    composite: Composite | None = None,
    prescribed: tuple[tuple[bool, bool], ...] = UNIAXIAL,
    flat: bool = True,
    alone: bool = False,
) -> EquilibriumSolver:
    """Return the solver of a tile distributed over the ranks, or of a whole one on each rank."""
    skin = sew(MPI.COMM_SELF if alone else MPI.COMM_WORLD, tile.pattern)
    return tile_solver(skin, composite or Composite(), Periodic(tile, prescribed, flat))


def pulled(
    solver: EquilibriumSolver,
    density: np.ndarray,
    angle: float,
    gradient: np.ndarray,
    start: Equilibrium | np.ndarray | None = None,
    *,
    once: bool = False,
) -> Equilibrium:
    """Return the equilibrium of an owned density at a mean deformation along a direction."""
    return solver.solve(density, Load(gradient=gradient, angle=angle), start, once=once)


def mean_gradient(solver: EquilibriumSolver, at: Equilibrium) -> np.ndarray:
    return solver.model.images.mean_gradient(at.state)


def area_of(solver: EquilibriumSolver) -> float:
    return float(solver.skin.pattern.areas.sum())


def mean_stress(solver: EquilibriumSolver, at: Equilibrium) -> np.ndarray:
    """Return the mean stress in N/m, (3, 2), zero where F̄ is free."""
    solver.tangent_at(at)
    images = solver.model.images
    stress = images.mean_force(solver.model.variation(at.state)) / area_of(solver)
    return np.where(np.array(images.periodic.prescribed), stress, 0.0)


def mean_stiffness(solver: EquilibriumSolver, at: Equilibrium, changes: np.ndarray) -> np.ndarray:
    """Return the second derivative of the mean energy in N/m, (k, k), by parts of F̄."""
    pairs = [solver.stretch(at, change) for change in changes]
    return np.array([[dot(solver.skin.comm, f, q) for _, q in pairs] for f, _ in pairs]) / area_of(
        solver
    )


def owned(solver: EquilibriumSolver, density: np.ndarray) -> np.ndarray:
    """The owned part of a density of all triangles."""
    return density[solver.skin.owned_cells]


def profile_of(
    solver: EquilibriumSolver, density: np.ndarray, strain: float, angles: np.ndarray = ANGLES
) -> Profile:
    """Return the profile of a density at all triangles of the tile."""
    owned = density[solver.skin.owned_cells]
    return ProfileSolver(solver, angles, strain).solve(owned, gradients=False)


def profile_table(profile: Profile) -> np.ndarray:
    """Return stress and tangent relative to the largest stress, contraction and shear, (k, 4)."""
    largest = np.abs(profile.stress).max()
    return np.stack(
        [
            profile.stress / largest,
            profile.tangent * abs(profile.strain) / largest,
            profile.contraction,
            profile.shear / profile.strain,
        ],
        axis=1,
    )


def random_cells(tile: Tile, seed: int = 0) -> np.ndarray:
    """Return a random density of all triangles."""
    return np.random.default_rng(seed).uniform(0, 1, len(tile.wraps))


def smooth_cells(tile: Tile) -> np.ndarray:
    """Return a smooth density of all triangles without any symmetry."""
    x, y = (2 * np.pi * tile.pattern.centroids / np.diagonal(tile.lattice)).T
    waves = np.sin(x) + np.cos(y) + np.sin(x + y) + np.cos(2 * x - y + 0.3)
    return np.asarray(1 / (1 + np.exp(-2 * waves)))


def cell_map(
    tile: Tile, operation: np.ndarray, shift: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Return the image of each triangle by an operation about the corner, then a shift.

    The shift is in units of the tile's sides.
    """
    size = np.diagonal(tile.lattice)
    centroids = tile.pattern.centroids
    tree = cKDTree(centroids / size, boxsize=1.0)
    away, image = tree.query((centroids @ np.transpose(operation) / size + shift) % 1.0)
    assert away.max() < 1e-9
    return np.asarray(image)


def mapped_cells(density: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Return a density moved with the triangles."""
    out = np.empty_like(density)
    out[image] = density
    return out


EDGES = 6
RADIUS = 1.6 * SIDE / EDGES
DIRECTIONS = ANGLES[:7:2] + 0.05
TARGET = ProfileTarget(
    stiffness=np.array([3e3, np.nan, 6e3, 4e3]),
    contraction=np.array([0.2, 0.1, np.nan, -0.3]),
)
CONTRAST = Contrast(np.array([True, False, False, True]), np.array([False, True, True, False]))


def profile_solver(
    batched: bool, angles: np.ndarray = DIRECTIONS, strain: float = 0.1
) -> ProfileSolver:
    """Return a profile solver of a square tile."""
    batch = MPI.COMM_WORLD if batched else None
    return ProfileSolver(solver_of(tile_of(EDGES), alone=batched), angles, strain, batch)


def stress_law(gradient: np.ndarray, material: Material, c1: float, c2: float) -> np.ndarray:
    """Return the first Piola-Kirchhoff stress of eq. (1) times the thickness, (2, 2), in N/m."""
    left, stretches, right = np.linalg.svd(gradient)
    strains = stretches - 1
    both = strains.sum()
    principal = 2 * material.mu * strains / (1 - (strains / (c1 - 1)) ** 2)
    principal += material.lam * both / (1 - (both / (c2 - 1)) ** 2)
    return np.asarray(material.thickness * (left * principal) @ right)


@dataclass(frozen=True)
class Laminate:
    """Stripes of two materials, each in a homogeneous state.

    Attributes:
        composite: The materials.
        fraction: Area fraction of the reinforcement.
        normal: Direction across the stripes in rad.
    """

    composite: Composite
    fraction: float
    normal: float

    def pulled(self, angle: float, strain: float) -> np.ndarray:
        """Return stress in N/m, contraction and shear of the sheet pulled along a direction."""
        c, fraction = self.composite, self.fraction
        n = np.array([np.cos(self.normal - angle), np.sin(self.normal - angle)])
        scale = c.reinforcement.mu * c.reinforcement.thickness

        def mean(x: np.ndarray, strain: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            gradient = np.array([[1 + strain, x[0]], [0, 1 + x[1]]])
            jump = np.outer(x[2:], n)
            hard, soft = (
                stress_law(gradient + part * jump, material, *bounds)
                for part, material, bounds in (
                    (1 - fraction, c.reinforcement, c.reinforcement_bounds),
                    (-fraction, c.fabric, c.fabric_bounds),
                )
            )
            return gradient, fraction * hard + (1 - fraction) * soft, (hard - soft) @ n

        def unbalanced(x: np.ndarray, strain: float) -> np.ndarray:
            _, stress, traction = mean(x, strain)
            return np.concatenate([stress[:, 1], traction]) / scale

        x: np.ndarray = np.zeros(4)
        steps, h = 4, 1e-5 * abs(strain) * np.eye(4)
        for step in range(1, steps + 1):
            here = strain * step / steps
            x = x * step / max(step - 1, 1)
            for _ in range(4):
                slopes = [unbalanced(x + d, here) - unbalanced(x - d, here) for d in h]
                x = x - 2 * h[0, 0] * np.linalg.solve(np.transpose(slopes), unbalanced(x, here))
        assert np.abs(unbalanced(x, strain)).max() < 1e-14
        gradient, stress, _ = mean(x, strain)
        return np.array([stress[0, 0], (1 - gradient[1, 1]) / strain, gradient[0, 1]])

    def stiffness(self) -> np.ndarray:
        """Return the membrane stiffness in N/m, (3, 3), of strains (xx, yy, 2xy)."""
        # Both materials have the same strain along the stripes and the same stress across them.
        (l1, m1), (l2, m2) = (
            (k.thickness * k.lam, k.thickness * k.mu)
            for k in (self.composite.reinforcement, self.composite.fabric)
        )
        weights = np.array([self.fraction, 1 - self.fraction])
        whole, cross, shear = np.array([[l1 + 2 * m1, l2 + 2 * m2], [l1, l2], [m1, m2]])
        across = 1 / (weights @ (1 / whole))
        ratio = weights @ (cross / whole)
        along = weights @ (whole - cross**2 / whole) + ratio**2 * across
        local = np.array([[across, ratio * across, 0], [ratio * across, along, 0], [0, 0, 0]])
        local[2, 2] = 1 / (weights @ (1 / shear))
        return rotated(local, -self.normal)


def rotated(stiffness: np.ndarray, angle: float) -> np.ndarray:
    """Return a membrane stiffness in axes turned by an angle in rad."""
    c, s = np.cos(angle), np.sin(angle)
    # Strains (xx, yy, 2xy) in the old axes from those in the new ones.
    turn = np.array([[c * c, s * s, -c * s], [s * s, c * c, c * s], [2 * c * s, -2 * c * s, 0]])
    turn[2, 2] = c * c - s * s
    return np.asarray(turn.T @ stiffness @ turn)


def modulus(stiffness: np.ndarray, angle: float) -> float:
    """Return E h in N/m for a pull along a direction, free across."""
    return float(1 / np.linalg.inv(rotated(stiffness, angle))[0, 0])


def stripes(tile: Tile, count: int, printed: int, diagonal: bool = False) -> np.ndarray:
    """Return a density with `printed` of `count` stripes along x, or with their normal at 45°."""
    place = tile.pattern.centroids / np.diagonal(tile.lattice)
    across = place.sum(axis=1) if diagonal else place[:, 1]
    return (np.floor(count * across) % count < printed).astype(float)


def repeating(shape: BaseGeometry, size: tuple[float, float]) -> BaseGeometry:
    """Return the part in a tile of a shape that repeats."""
    a, b = size
    copies = [translate(shape, i * a, j * b) for i, j in np.ndindex(5, 5)]
    return translate(shapely.union_all(copies, grid_size=1e-9), -2 * a, -2 * b) & box(0, 0, a, b)


def printed_tile() -> PrintedTile:
    """Return an oblong tile with an oblique line, and a disc on its border."""
    size = a, b = 0.012, 0.008
    line = shapely.LineString([(-a, -b), (a, b)]).buffer(0.8e-3)
    region = repeating(line | shapely.Point(0, b / 2).buffer(1.2e-3), size)
    composite = replace(MEMBRANE, fabric=replace(MEMBRANE.fabric, thickness=3e-4))
    return PrintedTile(region, size, 1e-3, composite)


def small_case(comm: MPI.Comm, edge_length: float = 0.8e-3) -> TileCase:
    """Return a tetragonal tile of 1 cm with a target in four directions."""
    target = ProfileTarget(np.array([2000.0, 1000.0, 500.0, 400.0]))
    angles = np.radians([0.0, 15.0, 30.0, 45.0])
    return TileCase(comm, (0.01, 0.01), edge_length, "crossed", "tetragonal", angles, target)


SMALL = TileDesignScene.of(
    filter_radius=2e-3,
    starts=2,
    trial_iterations=2,
    draft_iterations=2,
    finish_iterations=2,
    corrections=1,
    correction_iterations=2,
)


@cache
def small_result() -> tuple[TileCase, TileResult]:
    """Return the small case and the print of a design after two steps (collective)."""
    case = small_case(MPI.COMM_WORLD)
    problem = tile_problem(case, SMALL)
    start = random_waves(case.tile, 1)[problem.skin.owned_cells]
    result = optimize(problem, [Stage(2, 80.0, constrained=True)], start=start)
    return case, simulated_print(case, SMALL, problem, result)
