"""Tiles for tests, and the exact states of sheets made of stripes."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from toros_fem.materials import Composite, Material
from toros_fem.mechanics.periodicity import UNIAXIAL, Periodic
from toros_fem.meshes import Tile, sew, tile
from toros_fem.tiles.solver import TileSolver
from toros_fem.tiles.stiffness_profile import Profile, ProfileSolver

SIDE = 0.02
ANGLES = np.arange(12) * np.pi / 12
# Materials A and R of the reference tables, for a metre of thickness: stresses are in Pa.
A = Material(young=400e3 / 3, poisson=1 / 3, thickness=1.0)
R = Material(young=400e5 / 3, poisson=1 / 3, thickness=1.0)


def table_composite() -> Composite:
    return Composite(A, R, c1=1.8, c2=2.0, bending=None)


# Making a solver takes longer than using it: tests share tiles and solvers.
@cache
def tile_of(
    edges: int,
    mesh: str = "crossed",
    shape: tuple[float, float] = (1.0, 1.0),
    symmetry: str = "none",
) -> Tile:
    """A tile of so many edges along the length SIDE, its sides as many times that long."""
    sides = (SIDE * shape[0], SIDE * shape[1])
    return tile(MPI.COMM_WORLD, sides, SIDE / edges, mesh, symmetry)


@cache
def solver_of(
    found: Tile,
    composite: Composite | None = None,
    fixed: tuple[tuple[bool, bool], ...] = UNIAXIAL,
    flat: bool = True,
    alone: bool = False,
) -> TileSolver:
    """A solver of a tile parted over the ranks, or one on each rank alone."""
    skin = sew(MPI.COMM_SELF if alone else MPI.COMM_WORLD, found.pattern)
    return TileSolver(skin, composite or Composite(), Periodic(found, fixed, flat))


def pulled(
    solver: TileSolver, density: np.ndarray, strain: float, angles: np.ndarray = ANGLES
) -> Profile:
    """The profile of a density, given for all triangles of the tile."""
    owned = density[solver.skin.owned_cells]
    return ProfileSolver(solver, angles, strain).solve(owned, gradients=False)


def numbers(profile: Profile) -> np.ndarray:
    """What a profile tells, (k, 4): stress and tangent over the largest, contraction, shear."""
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


def drawn(found: Tile, seed: int = 0) -> np.ndarray:
    """A random density of all triangles."""
    return np.random.default_rng(seed).uniform(0, 1, len(found.wraps))


def blob(found: Tile) -> np.ndarray:
    """A smooth density of all triangles without any symmetry."""
    x, y = (2 * np.pi * found.pattern.centroids / np.diagonal(found.lattice)).T
    waves = np.sin(x) + np.cos(y) + np.sin(x + y) + np.cos(2 * x - y + 0.3)
    return np.asarray(1 / (1 + np.exp(-2 * waves)))


def carried(
    found: Tile, operation: np.ndarray, shift: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Where triangles go by an operation about the corner and a shift by shares of the tile."""
    size = np.diagonal(found.lattice)
    centroids = found.pattern.centroids
    tree = cKDTree(centroids / size, boxsize=1.0)
    away, image = tree.query((centroids @ np.transpose(operation) / size + shift) % 1.0)
    assert away.max() < 1e-9
    return np.asarray(image)


def turned_density(density: np.ndarray, image: np.ndarray) -> np.ndarray:
    """A density carried along with the triangles."""
    out = np.empty_like(density)
    out[image] = density
    return out


def law(gradient: np.ndarray, material: Material, c1: float, c2: float) -> np.ndarray:
    """First Piola-Kirchhoff stress of eq. (1) times the thickness, (2, 2), in N/m."""
    left, stretches, right = np.linalg.svd(gradient)
    strains = stretches - 1
    both = strains.sum()
    principal = 2 * material.mu * strains / (1 - (strains / (c1 - 1)) ** 2)
    principal += material.lam * both / (1 - (both / (c2 - 1)) ** 2)
    return np.asarray(material.thickness * (left * principal) @ right)


@dataclass(frozen=True)
class Laminate:
    """Stripes of two materials: the state of either is homogeneous.

    Attributes:
        composite: The materials.
        share: Of the reinforcement.
        normal: Direction across the stripes in rad.
    """

    composite: Composite
    share: float
    normal: float

    def pulled(self, angle: float, strain: float) -> np.ndarray:
        """Stress in N/m, contraction and shear of the sheet pulled along a direction."""
        c, share = self.composite, self.share
        n = np.array([np.cos(self.normal - angle), np.sin(self.normal - angle)])
        scale = c.reinforcement.mu * c.reinforcement.thickness

        def mean(x: np.ndarray, strain: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            gradient = np.array([[1 + strain, x[0]], [0, 1 + x[1]]])
            jump = np.outer(x[2:], n)
            hard = law(gradient + (1 - share) * jump, c.reinforcement, c.c1, c.c2)
            soft = law(gradient - share * jump, c.fabric, c.c1, c.c2)
            return gradient, share * hard + (1 - share) * soft, (hard - soft) @ n

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
        """Membrane stiffness in N/m, (3, 3), of strains (xx, yy, 2xy)."""
        # Along and across first: strains along are common, and so are stresses across.
        (l1, m1), (l2, m2) = (
            (k.thickness * k.lam, k.thickness * k.mu)
            for k in (self.composite.reinforcement, self.composite.fabric)
        )
        weights = np.array([self.share, 1 - self.share])
        whole, cross, shear = np.array([[l1 + 2 * m1, l2 + 2 * m2], [l1, l2], [m1, m2]])
        across = 1 / (weights @ (1 / whole))
        ratio = weights @ (cross / whole)
        along = weights @ (whole - cross**2 / whole) + ratio**2 * across
        local = np.array([[across, ratio * across, 0], [ratio * across, along, 0], [0, 0, 0]])
        local[2, 2] = 1 / (weights @ (1 / shear))
        return seen_at(local, -self.normal)


def seen_at(stiffness: np.ndarray, angle: float) -> np.ndarray:
    """A membrane stiffness in axes turned by an angle in rad."""
    c, s = np.cos(angle), np.sin(angle)
    # Strains (xx, yy, 2xy) in the old axes from those in the new ones.
    turn = np.array([[c * c, s * s, -c * s], [s * s, c * c, c * s], [2 * c * s, -2 * c * s, 0]])
    turn[2, 2] = c * c - s * s
    return np.asarray(turn.T @ stiffness @ turn)


def modulus(stiffness: np.ndarray, angle: float) -> float:
    """E h in N/m along a direction: pulled along it, free across."""
    return float(1 / np.linalg.inv(seen_at(stiffness, angle))[0, 0])


def stripes(found: Tile, count: int, printed: int, diagonal: bool = False) -> np.ndarray:
    """A density of `printed` out of `count` stripes along x, or with their normal at 45°."""
    place = found.pattern.centroids / np.diagonal(found.lattice)
    across = place.sum(axis=1) if diagonal else place[:, 1]
    return (np.floor(count * across) % count < printed).astype(float)
