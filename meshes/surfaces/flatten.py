"""Flattening of discs: unrolled, with least angle distortion, with least conformal energy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, eye_array
from scipy.sparse.csgraph import breadth_first_order
from scipy.sparse.linalg import splu

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import SurfaceError
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import corner_angles, edges_of, half_edges, lengths

# Inverse iterations, and Newton steps of ABF++, at most.
ROUNDS, STEPS = 500, 60
# Shift of a conformal energy that is singular to the last bit, over its mean diagonal.
SHIFT = 1e-16


def unrolled(points: Floats, triangles: Ints) -> Floats:
    """Unroll a developable disc triangle by triangle, breadth first, to points (n, 2) in m.

    Triangles are turned as rigid pieces: scaled onto the edge before, rounding would grow
    exponentially on fine meshes. The first triangle that reaches a vertex places it.
    """
    edges, size = edges_of(triangles), len(triangles)
    one, two = edges.sides[edges.inner].T
    dual = csr_array((np.ones(len(one)), (one, two)), shape=(size, size))
    order, before = breadth_first_order(dual, 0, directed=False)
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    u, v = b - a, c - a
    base = np.linalg.norm(u, axis=1)
    # Corners of each triangle as complex numbers, the first at 0 and the second on the real axis.
    third = np.einsum("ij,ij->i", u, v) + 1j * np.linalg.norm(np.cross(u, v), axis=1)
    local: Any = np.stack([np.zeros(size), base, third / base], axis=1).tolist()
    corners: Any = triangles.tolist()
    numbers: Any = edges.of_triangle.tolist()
    turn = [1 + 0j] * size
    place = dict(zip(corners[order[0]], local[order[0]], strict=True))
    for t in order[1:].tolist():
        parent = int(before[t])
        i = next(k for k in range(3) if numbers[t][k] in numbers[parent])
        other = numbers[parent].index(numbers[t][i])
        j, k = (i + 1) % 3, (i + 2) % 3
        along = local[parent][other] - local[parent][(other + 1) % 3]
        way = turn[parent] * along / (local[t][j] - local[t][i])
        turn[t] = way / abs(way)
        if corners[t][k] not in place:
            middle = (place[corners[t][i]] + place[corners[t][j]]) / 2
            offset = local[t][k] - (local[t][i] + local[t][j]) / 2
            place[corners[t][k]] = middle + turn[t] * offset
    found = np.array([place[vertex] for vertex in range(len(points))])
    return np.column_stack([found.real, found.imag])


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
    eq. 5), found by inverse iteration. In complex numbers its eigenvalue is simple. Angles at the
    corners, (t, 3), are those of the surface, or of `abf_angles`.
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
    kept = np.delete(np.arange(size), p[0])
    inner = csc_array(energy[kept][:, kept])
    try:
        factor = splu(inner, permc_spec="MMD_AT_PLUS_A")
    except RuntimeError:  # the energy of a developable disc has a kernel
        shift = SHIFT * np.abs(energy.diagonal()).mean()
        factor = splu(csc_array(inner + shift * eye_array(size - 1)), permc_spec="MMD_AT_PLUS_A")
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


def abf_angles(triangles: Ints, angles: Floats) -> Floats:
    """Return the angles of a flat disc that differ least from a surface's, (t, 3), in rad.

    Angle-based flattening by Sheffer et al. 2005 (ABF++, doi:10.1145/1061347.1061354) minimises
    the relative change of angles (eq. 1) under these constraints: the angles of a triangle sum to π
    (eq. 2), those around an inner vertex to 2π (eq. 3), and the edges around it close (eq. 4, here
    as a sum of logarithms, which makes the Hessian of the Lagrangian diagonal). Angles and triangle
    constraints are eliminated from Newton's system (section 3): two unknowns remain for each inner
    vertex.

    Raises:
        SurfaceError: Newton's method does not converge.
    """
    size, count, vertex = triangles.size, len(triangles), triangles.ravel()
    edges = edges_of(triangles)
    inner = np.ones(int(triangles.max()) + 1, dtype=bool)
    inner[edges.ends[edges.border]] = False
    if not inner.any():
        return angles
    around = np.bincount(vertex, angles.ravel())
    target = angles.ravel() * np.where(inner, 2 * np.pi / around, 1.0)[vertex]
    weight = 2 / target**2
    corner = np.flatnonzero(inner[vertex])
    wheels = int(inner.sum())  # a wheel: the triangles around an inner vertex
    row = (np.cumsum(inner) - 1)[vertex[corner]]
    first = corner - corner % 3
    ahead, behind = first + (corner + 1) % 3, first + (corner + 2) % 3
    rows = np.concatenate([row, wheels + row, wheels + row])
    columns = np.concatenate([corner, ahead, behind])
    of_triangle = csr_array((np.ones(size), (np.arange(size), np.arange(size) // 3)))

    def sums(values: Floats) -> Floats:
        return np.asarray(values.reshape(-1, 3).sum(axis=1))

    alpha, by_triangle, by_wheel = angles.ravel().copy(), np.zeros(count), np.zeros(2 * wheels)
    for _ in range(STEPS):
        cot, log = 1 / np.tan(alpha), np.log(np.sin(alpha))
        values = np.concatenate([np.ones(len(corner)), cot[ahead], -cot[behind]])
        jacobian = coo_array((values, (rows, columns)), shape=(2 * wheels, size)).tocsr()
        opening = sums(alpha) - np.pi
        closing = np.concatenate(
            [
                np.bincount(row, alpha[corner], wheels) - 2 * np.pi,
                np.bincount(row, log[ahead] - log[behind], wheels),
            ]
        )
        force = -weight * (alpha - target) - np.repeat(by_triangle, 3) - jacobian.T @ by_wheel
        done = max(np.abs(opening).max(), np.abs(closing).max(), np.abs(force / weight).max())
        if done < 1e-12:
            return alpha.reshape(-1, 3)
        pull = by_wheel[wheels + row]
        bend = np.bincount(behind, pull, size) - np.bincount(ahead, pull, size)
        diagonal = np.maximum(weight + bend / np.sin(alpha) ** 2, 0.25 * weight)
        # Eliminate the angles, then the multipliers of triangles: both blocks are diagonal.
        soft = 1 / diagonal
        pivot, load = sums(soft), sums(soft * force) + opening
        scaled = jacobian.multiply(soft).tocsr()
        coupling = scaled @ of_triangle
        reduced = scaled @ jacobian.T - coupling.multiply(1 / pivot) @ coupling.T
        right = scaled @ force + closing - coupling @ (load / pivot)
        wheel_step = splu(csc_array(reduced)).solve(right)
        triangle_step = (load - coupling.T @ wheel_step) / pivot
        step = soft * (force - np.repeat(triangle_step, 3) - jacobian.T @ wheel_step)
        # No angle moves by more than nine tenths of its distance to 0 or π.
        room = np.where(step < 0, alpha, np.pi - alpha) / np.maximum(np.abs(step), 1e-300)
        fraction = min(1.0, 0.9 * float(room.min()))
        alpha += fraction * step
        by_triangle += fraction * triangle_step
        by_wheel += fraction * wheel_step
    raise SurfaceError(
        f"angle-based flattening did not converge on a chart of {count} triangles (residual "
        f"{done:.1g}). Cut the chart, or use method 'lscm'."
    )


# ---------------------------------------------------------------------------------- distortion


@dataclass(frozen=True, eq=False)
class Distortion:
    """Deformation from the unstressed flat panels of a pattern to its assembled shape."""

    pattern: Pattern

    @cached_property
    def stretches(self) -> Floats:
        """Principal stretches of each triangle, the larger first, shape (t, 2)."""
        return triangle_stretches(self.pattern.corners, self.pattern.points[self.pattern.triangles])

    @cached_property
    def area_ratio(self) -> Floats:
        """Assembled over flat area of each triangle, shape (t,)."""
        return np.asarray(self.stretches.prod(axis=1))

    @cached_property
    def angle_error(self) -> Floats:
        """Largest change of each triangle's angles, shape (t,), in rad."""
        of = self.pattern
        assembled = corner_angles(of.points, of.triangles)
        flat = corner_angles(of.flat_points, of.flat_triangles)
        return np.asarray(np.abs(assembled - flat).max(axis=1))

    @property
    def strain(self) -> Floats:
        """Stretch or compression of each triangle, (t,): largest of λ − 1 and 1/λ − 1."""
        return strains(self.stretches)

    @property
    def worst_stretch(self) -> float:
        """Largest stretch or compression, 0 for an isometric map."""
        return float(self.strain.max())

    @property
    def mean_stretch(self) -> float:
        """Mean stretch or compression of the assembled area."""
        return float(np.average(self.strain, weights=self.area_ratio * self.pattern.areas))

    @property
    def worst_seam(self) -> float:
        """Largest relative difference of length at a seam, 0 if there is none."""
        return float(self.pattern.seam_gaps.max(initial=0.0))

    def table(self) -> str:
        """Return the worst and mean values of each panel and of all, as lines of text."""
        lines = [
            "panel             triangles  area/cm²   stretch        area ratio     angle error",
            "                                       worst   mean    min    max     worst   mean",
        ]
        pattern = self.pattern
        groups = [(name, pattern.panel == k) for k, name in enumerate(pattern.panel_names)]
        for name, cells in [*groups, ("all", np.ones(len(pattern.panel), dtype=bool))]:
            ratio = self.area_ratio[cells]
            weight, strain = ratio * pattern.areas[cells], self.strain[cells]
            angle = np.degrees(self.angle_error[cells])
            lines.append(
                f"{name[:16]:16s}  {cells.sum():9d}  {1e4 * weight.sum():8.2f}"
                f"  {strain.max():6.2%} {np.average(strain, weights=weight):6.2%}"
                f"  {ratio.min():5.3f}  {ratio.max():5.3f}"
                f"  {angle.max():6.2f}°  {np.average(angle, weights=weight):5.2f}°"
            )
        return "\n".join([*lines, f"longest difference at a seam: {self.worst_seam:.2%}"])


def triangle_stretches(flat: Floats, corners: Floats) -> Floats:
    """Return the singular values of F = ∂x/∂x̄, the larger first, (t, 2).

    Flat corners are (t, 3, 2), those in space (t, 3, 3).
    """
    before, after = (np.swapaxes(x[:, 1:] - x[:, :1], 1, 2) for x in (flat, corners))
    return np.linalg.svd(after @ np.linalg.inv(before), compute_uv=False)


def strains(stretches: Floats) -> Floats:
    """Return the largest of λ − 1 and 1/λ − 1, (t,), of stretches with the larger first, (t, 2)."""
    return np.maximum(stretches[:, 0], 1 / stretches[:, 1]) - 1
