"""Starts of a tile's design: random long waves, and families of straight and wavy lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.meshes.makers.tile import SYMMETRIES, Tile

# A random start has waves of 0 to WAVES − 1 periods along each side.
WAVES = 4
# Normals of the two families, in periods along the sides: along the sides, or along the diagonals.
PAIRS = (((0, 1), (1, 0)), ((1, 1), (1, -1)))
# Probabilities that the families are diagonal, and that the lines of a family are straight.
DIAGONAL, STRAIGHT = 0.25, 0.25
# Bounds of the amplitude of wavy lines in periods of the family, and of the width of lines relative
# to that of the narrowest.
AMPLITUDES, WIDTHS = (0.05, 0.15), (1.0, 2.0)
# Largest number of waves of a line in one tile.
MOST_WAVES = 2


@dataclass(frozen=True)
class LineFamily:
    """A family of equal straight or wavy lines on a periodic tile.

    With X the place in units of the sides, u = normal · X and v along the lines, the centres of its
    lines are where u + offset + amplitude cos 2π(waves v + shift) is a whole number.

    Attributes:
        normal: Normal of the lines, in periods along both sides.
        width: Width of the lines in m, across the wave.
        offset: Place of the lines in periods.
        amplitude: Amplitude of the wave in periods; 0 for straight lines.
        waves: Number of waves along a line in a tile.
        shift: Phase of the wave in periods.
    """

    normal: tuple[int, int]
    width: float
    offset: float = 0.0
    amplitude: float = 0.0
    waves: int = 1
    shift: float = 0.0

    def depth(self, tile: Tile) -> Floats:
        """Return the distance in m by which triangles' centroids are inside the lines, (t,)."""
        by_place = np.linalg.inv(tile.lattice)
        across = np.array(self.normal)
        along = np.array([-across[1], across[0]])
        place = tile.pattern.centroids @ by_place
        phase = 2 * np.pi * (self.waves * (place @ along) + self.shift)
        height = place @ across + self.offset + self.amplitude * np.cos(phase)
        slope = 2 * np.pi * self.waves * self.amplitude * np.sin(phase)
        steepness = np.linalg.norm(by_place @ across - np.outer(slope, by_place @ along), axis=1)
        return np.asarray(self.width / 2 - np.abs(height - np.rint(height)) / steepness)


def random_waves(tile: Tile, seed: int) -> Floats:
    """Return a random periodic density of long waves at all triangles, (t,), in [0.1, 0.9]."""
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * tile.pattern.centroids @ np.linalg.inv(tile.lattice)
    density = np.full(len(phase), 0.5)
    for i, j in np.ndindex(WAVES, WAVES):
        amplitude, x, y = rng.standard_normal(), *rng.uniform(0, 2 * np.pi, 2)
        density += 0.25 * amplitude * np.cos(i * phase[:, 0] + x) * np.cos(j * phase[:, 1] + y)
    return np.asarray(np.clip(density, 0.1, 0.9))


def random_lines(tile: Tile, rng: np.random.Generator, symmetry: str, narrowest: float) -> Floats:
    """Return the density of two random families of lines and their images, (t,), in [0.1, 0.9].

    It falls over the width in m of the narrowest lines.
    """
    depths = [family.depth(tile) for family in random_families(rng, symmetry, narrowest)]
    images = np.max(depths, axis=0)[tile.symmetry_maps(symmetry)]
    return np.asarray(np.clip(0.5 + images.max(axis=0) / narrowest, 0.1, 0.9))


def random_families(rng: np.random.Generator, symmetry: str, narrowest: float) -> list[LineFamily]:
    """Return two random families that cross each other, and not their own images."""
    normals = PAIRS[int(rng.random() < DIAGONAL)]
    return [_random_family(rng, normal, symmetry, narrowest) for normal in normals]


def _random_family(
    rng: np.random.Generator, normal: tuple[int, int], symmetry: str, narrowest: float
) -> LineFamily:
    width, straight = narrowest * rng.uniform(*WIDTHS), rng.random() < STRAIGHT
    amplitude, waves = rng.uniform(*AMPLITUDES), int(rng.integers(1, MOST_WAVES + 1))
    # A mirror along or across the lines maps a wave onto itself only if the wave has a crest or a
    # trough there, and a line beside the mirror onto another. Half a turn also maps a wave onto
    # itself if the centre of the turn is between crest and trough. Straight lines in a mirror would
    # do too, but there would be one of them in a period, and such designs came less close to their
    # targets than those with two.
    flips = [np.abs(op @ normal) for op in SYMMETRIES[symmetry] if np.linalg.det(op) < 0]
    mirrored = any(np.array_equal(flip, np.abs(normal)) for flip in flips)
    beside = mirrored or bool(rng.random() < 0.5)
    return LineFamily(
        normal,
        width,
        offset=0.25 if beside else 0.0,
        amplitude=0.0 if straight else amplitude,
        waves=waves,
        shift=0.5 * int(rng.integers(2)) + (0.0 if beside else 0.25),
    )
