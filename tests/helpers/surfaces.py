"""Surfaces, most of them with known flat shapes."""

import numpy as np

from toros_fem.meshes.surface import Surface

Arrays = tuple[np.ndarray, np.ndarray]


def rings(count: int, around: int, closed: bool = False) -> np.ndarray:
    """Triangles of rings of vertices, joined one to the next, with one diagonal direction."""
    node = np.arange(count * around).reshape(count, around)
    upper = np.roll(node, -1, axis=0) if closed else node[1:]
    lower = node if closed else node[:-1]
    a, b, c, d = lower, np.roll(lower, -1, 1), upper, np.roll(upper, -1, 1)
    return np.stack([np.stack([a, b, c], 2), np.stack([b, d, c], 2)], 2).reshape(-1, 3)


def turned(radius: np.ndarray, height: np.ndarray, around: int) -> np.ndarray:
    """Points of rings about z."""
    angle = 2 * np.pi * np.arange(around) / around
    return np.concatenate(
        [
            np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(around, z)])
            for r, z in zip(radius, height, strict=True)
        ]
    )


def prism(around: int = 12, rows: int = 5, radius: float = 0.01, length: float = 0.03) -> Surface:
    """An open tube, a prism."""
    points = turned(np.full(rows + 1, radius), np.linspace(0, length, rows + 1), around)
    return Surface(points, rings(rows + 1, around))


def long_tube(around: int = 64, radius: float = 0.01, length: float = 0.08) -> Surface:
    """A closed tube as of a CAD program: triangles as long as it is, and fans of them as caps."""
    points = turned(np.full(2, radius), np.array([0, length]), around)
    k, after = np.arange(around), np.roll(np.arange(around), -1)
    caps = np.column_stack([after, k, np.full(around, 2 * around)])
    caps = np.vstack([caps, np.column_stack([k, after, caps[:, 2] + 1]) + [around, around, 0]])
    ends = np.array([[0, 0, 0], [0, 0, length]])
    return Surface(np.vstack([points, ends]), np.vstack([rings(2, around), caps]))


def ellipsoid(axes: tuple[float, ...], rows: int = 9, around: int = 16) -> Surface:
    """A coarse ellipsoid of rings and two tips; 256 triangles."""
    polar = np.pi * np.arange(1, rows) / rows
    points = turned(np.sin(polar), -np.cos(polar), around)
    first, last = np.arange(around), np.arange(around) + (rows - 2) * around
    low = np.column_stack([np.roll(first, -1), first, np.full(around, len(points))])
    high = np.column_stack([last, np.roll(last, -1), np.full(around, len(points) + 1)])
    points = np.vstack([points, [[0, 0, -1], [0, 0, 1]]]) * axes
    return Surface(points, np.vstack([rings(rows - 1, around), low, high]))


def cone(around: int = 12, rows: int = 5, radius: float = 0.01, height: float = 0.02) -> Surface:
    """An open cone with its tip, a pyramid."""
    fraction = np.arange(rows, 0, -1) / rows
    points = turned(radius * fraction, height * (1 - fraction), around)
    tip, last = len(points), np.arange((rows - 1) * around, rows * around)
    fan = np.stack([last, np.roll(last, -1), np.full(around, tip)], axis=1)
    return Surface(np.vstack([points, [0, 0, height]]), np.vstack([rings(rows, around), fan]))


def cap(rows: int, angle: float, radius: float = 0.01) -> tuple[Surface, np.ndarray]:
    """A spherical cap around +z up to a polar angle, and its stereographic image (n, 2).

    Ring k has 6 k vertices, so that the mesh has the symmetry of a hexagon.
    """
    start = np.concatenate([[0], 1 + 3 * np.arange(rows) * np.arange(1, rows + 1)])
    at = lambda ring, j: 0 if ring == 0 else start[ring] + j % (6 * ring)  # noqa: E731
    triangles = []
    for k in range(1, rows + 1):
        for sector in range(6):
            for j in range(k):
                i, o = sector * (k - 1) + j, sector * k + j
                triangles.append([at(k, o), at(k, o + 1), at(k - 1, i)])
                if j < k - 1:
                    triangles.append([at(k, o + 1), at(k - 1, i + 1), at(k - 1, i)])
    ring = np.repeat(np.arange(1, rows + 1), 6 * np.arange(1, rows + 1))
    turn = np.concatenate([2 * np.pi * np.arange(6 * k) / (6 * k) for k in range(1, rows + 1)])
    polar = np.concatenate([[0], angle * ring / rows])
    along = np.column_stack([np.cos(turn), np.sin(turn)])
    along = np.vstack([[0, 0], along])
    points = radius * np.column_stack([np.sin(polar)[:, None] * along, np.cos(polar)])
    return Surface(points, np.array(triangles)), 2 * radius * np.tan(polar / 2)[:, None] * along


def sphere(steps: int = 2, radius: float = 0.01) -> Surface:
    """A closed sphere, an icosahedron refined `steps` times."""
    t = (1 + np.sqrt(5)) / 2
    points = np.array(
        [[-1, t, 0], [1, t, 0], [-1, -t, 0], [1, -t, 0], [0, -1, t], [0, 1, t],
         [0, -1, -t], [0, 1, -t], [t, 0, -1], [t, 0, 1], [-t, 0, -1], [-t, 0, 1]]
    )  # fmt: skip
    triangles = np.array(
        [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4],
         [11, 10, 2], [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8],
         [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]]
    )  # fmt: skip
    for _ in range(steps):
        a, b, c = triangles.T
        ends = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]],
                                       triangles[:, [2, 0]]]), axis=1)  # fmt: skip
        edge, number = np.unique(ends, axis=0, return_inverse=True)
        ab, bc, ca = len(points) + number.reshape(3, -1)
        points = np.vstack([points, points[edge].mean(axis=1)])
        triangles = np.concatenate(
            [
                np.stack(corner, 1)
                for corner in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
            ]
        )
    return Surface(radius * points / np.linalg.norm(points, axis=1)[:, None], triangles)


def torus(around: int = 24, across: int = 12, radius: float = 0.02, tube: float = 0.007) -> Surface:
    """A closed torus about z."""
    angle = 2 * np.pi * np.arange(across) / across
    points = turned(radius + tube * np.cos(angle), tube * np.sin(angle), around)
    return Surface(points, rings(across, around, closed=True))


def box(n: int = 4, sizes: tuple[float, float, float] = (0.03, 0.02, 0.01)) -> Arrays:
    """Points and triangles of a box of six separate sides, as an STL has them."""
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, n + 1), np.linspace(-0.5, 0.5, n + 1))
    top = np.column_stack([u.ravel(), v.ravel(), np.full(u.size, 0.5)])
    node = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
    side = np.stack([np.stack([a, b, c], 2), np.stack([b, d, c], 2)], 2).reshape(-1, 3)
    turn = [np.roll(np.eye(3), k, axis=0) for k in range(3)]
    faces = [sign * top @ np.diag([sign, 1, 1]) @ r for sign in (1, -1) for r in turn]
    count = len(top)
    return np.concatenate(faces) * sizes, np.concatenate([side + count * k for k in range(6)])


def ramp(turns: int = 2, steps: int = 24) -> Surface:
    """A helicoidal ramp about z, developable to the mesh's own shape."""
    count = turns * steps
    turn = np.linspace(0, 2 * np.pi * turns, count + 1)
    ring = np.column_stack([np.cos(turn), np.sin(turn), 0.02 * turn])
    k = np.arange(count)
    triangles = [(k, k + count + 1, k + 1), (k + 1, k + count + 1, k + count + 2)]
    return Surface(
        np.concatenate([ring, ring * [2, 2, 1]]) * 0.01,
        np.concatenate([np.stack(corners, axis=1) for corners in triangles]),
    )


def welded_box(n: int) -> Surface:
    """A closed box with common vertices at its creases."""
    points, triangles = box(n)
    place, number = np.unique(points.round(12), axis=0, return_inverse=True)
    return Surface(place, number.ravel()[triangles])


def misfit(flat: np.ndarray, wanted: np.ndarray) -> float:
    """Largest distance after the best similarity, over the size."""
    z, w = flat @ [1, 1j], wanted @ [1, 1j]
    z, w = z - z.mean(), w - w.mean()
    return float(np.abs(np.vdot(z, w) / np.vdot(z, z) * z - w).max() / np.abs(w).max())
