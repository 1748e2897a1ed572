"""What a simulated shape has reached, in degrees and metres."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from toros_fem.meshes.pattern import Pattern

Floats = npt.NDArray[np.float64]


def best_rotation(reference: Floats, deformed: Floats) -> Floats:
    """Rotation R (3, 3) that best maps centred points (k, 3) onto others: R a ≈ b (Kabsch 1976)."""
    a, b = reference - reference.mean(axis=0), deformed - deformed.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    sign = np.sign(np.linalg.det(u @ vt))
    return np.asarray((u @ np.diag([1.0, 1.0, sign]) @ vt).T)


def bend_angle(
    pattern: Pattern, positions: Floats, panel: str = "wall", sections: int = 12
) -> float:
    """Angle in rad by which a tube along z bends in the x-z plane towards +x.

    The wall's vertices are cut into sections of equal length along the assembled z. Each
    section's best rigid rotation turns e_z into a direction n; its angle is atan2(n_x, n_z),
    followed continuously from the base so that it may pass 180°. The result is the angle of the
    ring at the tip, the counterpart of `meshes.bend`'s angle.

    Args:
        pattern: The pattern, assembled along z from z = 0.
        positions: Deformed positions of all assembled vertices, (n, 3), in m.
        panel: Name of the wall's panel.
        sections: How many sections; each should span at least one ring of vertices.
    """
    wall = pattern.vertices_of(panel)
    height = pattern.points[wall, 2]
    length = height.max()
    edges = np.linspace(0.0, length, sections + 1)
    rings = [wall[(height >= low) & (height <= high)] for low, high in pairwise(edges)]
    rings = [ring for ring in rings if len(ring) >= 6]
    rings.append(wall[height > length * (1 - 1e-9)])
    angles = []
    for ring in rings:
        n = best_rotation(pattern.points[ring], positions[ring])[:, 2]
        angles.append(np.arctan2(n[0], n[2]))
    return float(np.unwrap(np.array(angles))[-1])
