"""Flattening of discs: unrolled, with least angle distortion, or with least conformal energy."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array
from scipy.sparse.csgraph import breadth_first_order
from scipy.sparse.linalg import splu

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import SurfaceError
from toros_fem.meshes.triangles import edges_of, half_edges, lengths

ROUNDS = 500


def unrolled(points: Floats, triangles: Ints) -> Floats:
    """Unroll a developable disc triangle by triangle, breadth first, to points (n, 2) in m.

    Args:
        points: Vertices (n, 3) in m.
        triangles: Oriented triangles of a disc (t, 3) that use all of them.
    """
    edges = edges_of(triangles)
    size = len(triangles)
    one, two = edges.sides[edges.inner].T
    dual = csr_array((np.ones(len(one)), (one, two)), shape=(size, size))
    order, before = breadth_first_order(dual, 0, directed=False)
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    base = np.linalg.norm(b - a, axis=1)
    # Corners of each triangle as complex numbers, the first at 0 and the second on the real axis.
    local = np.stack([np.zeros(size), base, base * _third(a, b, c)], axis=1)
    # Triangles are turned as rigid pieces: scaled onto the edge before, rounding would grow
    # exponentially on fine meshes.
    turn = np.ones(size, dtype=complex)
    place = np.full(len(points), np.nan, dtype=complex)
    place[triangles[order[0]]] = local[order[0]]
    for level in _levels(order, before):
        parent = before[level]
        shared = edges.of_triangle[level][:, :, None] == edges.of_triangle[parent][:, None]
        side, other = np.argmax(shared.any(axis=2), axis=1), np.argmax(shared.any(axis=1), axis=1)
        i, j, k = ((side + shift) % 3 for shift in range(3))
        along = local[parent, other] - local[parent, (other + 1) % 3]
        angle = np.angle(turn[parent] * along / (local[level, j] - local[level, i]))
        turn[level] = np.exp(1j * angle)
        # The first triangle that reaches a vertex places it.
        vertex, new = np.unique(triangles[level, k], return_index=True)
        vertex, new = vertex[np.isnan(place[vertex])], new[np.isnan(place[vertex])]
        t, i, j, k = level[new], i[new], j[new], k[new]
        middle = (place[triangles[t, i]] + place[triangles[t, j]]) / 2
        place[vertex] = middle + turn[t] * (local[t, k] - (local[t, i] + local[t, j]) / 2)
    return np.column_stack([place.real, place.imag])


def _levels(order: Ints, before: Ints) -> list[Ints]:
    """Return the triangles of a breadth-first order by their distance from the first, from 1."""
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    # Ranks of the triangles before ascend, so each level ends where its own triangles are before.
    parent = rank[before[order[1:]]]
    levels, begin, end = [], 0, 1
    while end < len(order):
        begin, end = end, 1 + int(np.searchsorted(parent, end))
        levels.append(order[begin:end])
    return levels


def _third(a: Floats, b: Floats, c: Floats) -> np.ndarray:
    u, v = b - a, c - a
    square = np.einsum("ij,ij->i", u, u)
    along = np.einsum("ij,ij->i", u, v) / square
    return along + 1j * np.linalg.norm(np.cross(u, v), axis=1) / square


def closure_error(points: Floats, flat: Floats, triangles: Ints) -> float:
    """Return the largest relative difference of edge lengths between the plane and space."""
    ends = edges_of(triangles).ends
    return float(np.abs(lengths(flat, ends) / lengths(points, ends) - 1).max())


def conformal(triangles: Ints, angles: Floats) -> Floats:
    """Lay a disc flat with least conformal energy for given angles; return points (n, 2).

    Their scale is arbitrary. The energy is that of least squares conformal maps (Lévy et al. 2002,
    doi:10.1145/566654.566590). With two pinned vertices the result would depend on these.
    Therefore the spread of the border is fixed instead: the result is the smallest eigenvector of
    Mullen et al. (2008, spectral conformal parameterization, doi:10.1111/j.1467-8659.2008.01289.x,
    eq. 5), found by inverse iteration. In complex numbers its eigenvalue is simple.

    Args:
        triangles: Oriented triangles of a disc (t, 3) that use the vertices 0 … n − 1.
        angles: Angle at each corner, (t, 3), in rad: those of the surface, or of `abf_angles`.
    """
    size = int(triangles.max()) + 1
    weight = 1 / (4 * np.tan(angles.ravel()))
    a, b = np.roll(triangles, -1, axis=1).ravel(), np.roll(triangles, -2, axis=1).ravel()
    edges = edges_of(triangles)
    p, q = half_edges(triangles)[edges.twins[edges.border, 0]].T
    area = np.full(len(p), -0.25j)
    rows = np.concatenate([a, b, a, b, p, q])
    cols = np.concatenate([a, b, b, a, q, p])
    values = np.concatenate([weight, weight, -weight, -weight, -area, area])
    energy = csc_array(coo_array((values, (rows, cols)), shape=(size, size)))
    # The energy of a developable disc has a kernel. Elsewhere the shift is below rounding.
    shift = 1e-13 * np.abs(energy.diagonal()).mean()
    kept = np.delete(np.arange(size), p[0])
    factor = splu(
        csc_array(energy[kept][:, kept] + shift * _identity(size - 1)), permc_spec="MMD_AT_PLUS_A"
    )
    rim = np.unique(p)
    z = np.random.default_rng(0).standard_normal((size, 2)) @ [1, 1j]
    for _ in range(ROUNDS):
        load = np.zeros(size, dtype=complex)
        load[rim] = z[rim] - z[rim].mean()
        new = np.zeros(size, dtype=complex)
        new[kept] = factor.solve(load[kept])
        new -= new[rim].mean()
        new /= np.linalg.norm(new[rim])
        new *= np.exp(-1j * np.angle(np.vdot(z[rim], new[rim])))
        change, z = np.abs(new - z).max(), new
        if change < 1e-13:
            break
    return np.column_stack([z.real, z.imag])


def _identity(size: int) -> csc_array:
    return csc_array((np.ones(size), (np.arange(size),) * 2), shape=(size, size))


def abf_angles(triangles: Ints, angles: Floats) -> Floats:
    """Return the angles of a flat disc that differ least from a surface's, (t, 3), in rad.

    Angle-based flattening by Sheffer et al. 2005 (ABF++, doi:10.1145/1061347.1061354) minimises
    the relative change of angles (eq. 1) under these constraints: the angles of a triangle sum to π
    (eq. 2), those around an inner vertex to 2π (eq. 3), and the edges around it close (eq. 4, here
    as a sum of logarithms, which makes the Hessian of the Lagrangian diagonal). Angles and triangle
    constraints are eliminated from Newton's system (section 3): two unknowns remain for each inner
    vertex.

    Args:
        triangles: Oriented triangles of a disc (t, 3) that use the vertices 0 … n − 1.
        angles: Angle at each corner on the surface, (t, 3), in rad.

    Raises:
        SurfaceError: Newton's method does not converge.
    """
    size, count = triangles.size, len(triangles)
    edges = edges_of(triangles)
    inner = np.ones(int(triangles.max()) + 1, dtype=bool)
    inner[edges.ends[edges.border]] = False
    if not inner.any():
        return angles
    around = np.bincount(triangles.ravel(), angles.ravel())
    scale = np.where(inner, 2 * np.pi / around, 1.0)
    target = (angles * scale[triangles]).ravel()
    weight = 2 / target**2
    number = np.cumsum(inner) - 1
    corner = np.flatnonzero(inner[triangles.ravel()])
    row = number[triangles.ravel()[corner]]
    tri, place = np.divmod(corner, 3)
    ahead, behind = 3 * tri + (place + 1) % 3, 3 * tri + (place + 2) % 3
    wheels = int(inner.sum())  # a wheel: the triangles around an inner vertex
    alpha = angles.ravel().copy()
    of_triangle, of_wheel = np.zeros(count), np.zeros(2 * wheels)
    for _ in range(60):
        cot, square = 1 / np.tan(alpha), 1 / np.sin(alpha) ** 2
        log = np.log(np.sin(alpha))
        jacobian = coo_array(
            (
                np.concatenate([np.ones(len(corner)), cot[ahead], -cot[behind]]),
                (
                    np.concatenate([row, wheels + row, wheels + row]),
                    np.concatenate([corner, ahead, behind]),
                ),
            ),
            shape=(2 * wheels, size),
        ).tocsr()
        sums = alpha.reshape(-1, 3).sum(axis=1) - np.pi
        closing = np.concatenate(
            [
                np.bincount(row, alpha[corner], wheels) - 2 * np.pi,
                np.bincount(row, log[ahead] - log[behind], wheels),
            ]
        )
        force = -weight * (alpha - target) - np.repeat(of_triangle, 3) - jacobian.T @ of_wheel
        done = max(np.abs(sums).max(), np.abs(closing).max(), np.abs(force / weight).max())
        if done < 1e-12:
            break
        bend = np.bincount(behind, of_wheel[wheels + row], size) - np.bincount(
            ahead, of_wheel[wheels + row], size
        )
        diagonal = np.maximum(weight + bend * square, 0.25 * weight)
        # Eliminate the angles, then the multipliers of triangles: both blocks are diagonal.
        soft = 1 / diagonal
        pivot = soft.reshape(-1, 3).sum(axis=1)
        load = (soft * force).reshape(-1, 3).sum(axis=1) + sums
        scaled = jacobian.multiply(soft).tocsr()
        coupling = scaled @ _by_triangle(count)
        reduced = scaled @ jacobian.T - coupling.multiply(1 / pivot) @ coupling.T
        right = scaled @ force + closing - coupling @ (load / pivot)
        wheel_step = splu(csc_array(reduced)).solve(right)
        triangle_step = (load - coupling.T @ wheel_step) / pivot
        step = soft * (force - np.repeat(triangle_step, 3) - jacobian.T @ wheel_step)
        # No angle moves by more than nine tenths of its distance to 0 or π.
        room = np.where(step < 0, alpha, np.pi - alpha) / np.maximum(np.abs(step), 1e-300)
        fraction = min(1.0, 0.9 * float(room.min()))
        alpha += fraction * step
        of_triangle += fraction * triangle_step
        of_wheel += fraction * wheel_step
    else:
        raise SurfaceError(
            f"angle-based flattening did not converge on a chart of {count} triangles (residual "
            f"{done:.1g}). Cut the chart, or use method 'lscm'."
        )
    return alpha.reshape(-1, 3)


def _by_triangle(count: int) -> csr_array:
    corner = np.arange(3 * count)
    return csr_array((np.ones(3 * count), (corner, corner // 3)), shape=(3 * count, count))
