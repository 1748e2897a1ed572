"""Stiffness of crossed lines: simulated nets beside the relaxed material of a design.

    python benchmarks/crossed_lines.py --quick
    python benchmarks/crossed_lines.py --json crossed_lines.json --picture crossed_lines.png

The lines of a periodic net are at ± θ to the first axis and bonded where they cross. Two families
leave one soft mode: the lines turn against each other. Of each net the table lists the factor on
the fabric with which the relaxed material has the net's stiffness in this mode, its limit for fine
meshes, and the factor that the package takes (`forms.lines.fabric_factor`).

1. Nets: angles, shares and contrasts of the moduli of print and fabric, lines of equal width.
   `fits` lists the best constant and its errors for several powers of the sine.
2. Widths: wide lines cross thin ones. `width_fit` is the best reduction of the constant by their
   ratio.
3. Pulls: finite strain, as stress and lateral contraction.
4. One family, whose laminate is known exactly.

The borders of lines are edges of the mesh. An extrapolated value is the limit of a geometric series
through the three meshes.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.optimize import brentq, least_squares, minimize

sys.path.insert(0, str(Path(__file__).parent.parent))

from toros_fem.forms.lines import fabric_factor
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.periodicity import ALL_PRESCRIBED, Periodic
from toros_fem.mechanics.skin.relaxed_model import CROSSING, crossing_of_widths
from toros_fem.meshes import sew, tile
from toros_fem.meshes.tile import Tile
from toros_fem.products.tiles.solver import TileSolver
from toros_fem.products.tiles.stiffness_profile import ProfileSolver, effective_tensor

Floats = npt.NDArray[np.float64]

PRINT = Composite().reinforcement
CONTRAST = PRINT.membrane_stiffness / Composite().fabric.membrane_stiffness
ANGLES = (15.0, 22.5, 30.0, 37.5, 45.0)
SHARES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3)
EDGES = (40, 80, 160)
QUICK_EDGES = (10, 20, 40)
# Powers of the sine that are compared.
POWERS = (2, 3, 4, 5, 6)
# Between tensors of strain and vectors (xx, yy, √2 xy), in which rotations are orthogonal.
MANDEL = np.array([1.0, 1.0, np.sqrt(2)])


@dataclass(frozen=True)
class Net:
    """Two families of lines at ± an angle to the first axis, repeated in a rectangle.

    Attributes:
        angle_deg: θ.
        shares: Part of the area of each family.
        lines: Number of lines of each family in the rectangle; more lines are thinner ones.
        contrast: E h of the print over that of the fabric.
    """

    angle_deg: float
    shares: tuple[float, float]
    lines: tuple[int, int] = (1, 1)
    contrast: float = CONTRAST

    @property
    def angles(self) -> Floats:
        """Angles of both families in rad."""
        return np.radians([self.angle_deg, -self.angle_deg])

    @property
    def crossings(self) -> float:
        """s₁² s₂ + s₂² s₁."""
        return float(np.prod(self.shares) * np.sum(self.shares))

    @property
    def width_ratio(self) -> float:
        """Width of the wider lines over that of the others; 1 where there is one family."""
        if not all(self.shares):
            return 1.0
        one, other = np.array(self.shares) / self.lines
        return float(max(one / other, other / one))

    @property
    def composite(self) -> Composite:
        """Materials, in the plane."""
        return Composite(replace(PRINT, young=PRINT.young / self.contrast), PRINT, bending=None)

    @property
    def factor(self) -> float:
        """Factor on the fabric in the package."""
        twice = 2 * self.angles
        crossing = crossing_of_widths(self.width_ratio) * self.contrast
        return float(fabric_factor(self.shares, np.cos(twice), np.sin(twice), crossing))

    @property
    def soft(self) -> Floats:
        """Strain (xx, yy, √2 xy) that stretches neither family, of length 1."""
        strain = np.cross(*(_dyad(angle) for angle in self.angles))
        return np.asarray(strain / np.linalg.norm(strain))

    def printed(self, cell: Tile) -> npt.NDArray[np.bool_]:
        """Return whether each triangle of the rectangle is printed."""
        u, v = (cell.pattern.centroids / np.diagonal(cell.lattice)).T
        one = (self.lines[0] * (u - v)) % 1 < self.shares[0]
        other = (self.lines[1] * (u + v)) % 1 < self.shares[1]
        return np.asarray(one | other)


def _dyad(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * c, s * s, np.sqrt(2) * c * s])


def rectangle(angle_deg: float, edges: int) -> Tile:
    """Return a rectangle whose diagonals are at ± an angle to the first axis.

    Its mesh has lines in these directions: it is the mesh of a square, stretched.
    """
    square = tile(MPI.COMM_SELF, 1.0, 1 / edges)
    size = 0.01 / np.array([np.sin(np.radians(angle_deg)), np.cos(np.radians(angle_deg))])
    pattern = replace(
        square.pattern,
        flat_points=square.pattern.flat_points * size,
        points=square.pattern.points * [*size, 1.0],
    )
    return Tile(pattern, np.diag(size), square.wraps)


def tensors(nets: Sequence[Net], edges: int) -> list[Floats]:
    """Return the membrane stiffness in N/m over (xx, yy, √2 xy) of nets of one angle and contrast.

    Raises:
        ValueError: The border of a line is not on the mesh.
    """
    cell = rectangle(nets[0].angle_deg, edges)
    skin = sew(MPI.COMM_SELF, cell.pattern)
    solver = TileSolver(skin, nets[0].composite, Periodic(cell, ALL_PRESCRIBED))
    found = []
    for net in nets:
        columns = edges * np.array(net.shares) / net.lines
        if np.abs(columns - np.rint(columns)).max() > 1e-9:
            raise ValueError(f"{net} has lines of {columns} columns of a mesh of {edges} edges.")
        density = net.printed(cell)[skin.owned_cells].astype(np.float64)
        found.append(effective_tensor(solver, density) * np.outer(MANDEL, MANDEL))
    return found


def relaxed_tensor(net: Net, factor: float) -> Floats:
    """Return the same of the relaxed material, with a factor on its fabric."""
    fabric = net.composite.fabric
    mu, lam = fabric.mu * fabric.thickness, fabric.lam * fabric.thickness
    volume = np.array([1.0, 1.0, 0.0])
    lines = sum(
        share * PRINT.membrane_stiffness * np.outer(_dyad(angle), _dyad(angle))
        for share, angle in zip(net.shares, net.angles, strict=True)
    )
    return np.asarray(factor * (2 * mu * np.eye(3) + lam * np.outer(volume, volume)) + lines)


def soft_stiffness(net: Net, tensor: Floats) -> float:
    """Return the stiffness in N/m against the soft mode, all other strains free."""
    return float(1 / (net.soft @ np.linalg.solve(tensor, net.soft)))


def factor_of(net: Net, tensor: Floats) -> float:
    """Return the factor with which the relaxed material has a tensor's soft stiffness."""
    sought = soft_stiffness(net, tensor)
    found: float = brentq(
        lambda f: soft_stiffness(net, relaxed_tensor(net, f)) - sought, 0.1, 1e4, xtol=1e-12
    )
    return found


def moduli(tensor: Floats) -> Floats:
    """Return the moduli in N/m along and across the first axis, and that of shear."""
    return np.asarray([1.0, 1.0, 0.5] / np.diagonal(np.linalg.inv(tensor)))


def limit(values: Sequence[Any] | Floats) -> Any:
    """Return the limit of values from three meshes, each twice as fine as the one before.

    Where the differences do not shrink, the last value is taken.
    """
    first, second, last = np.array(values, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = (first - second) / (second - last)
        found = np.where(ratio > 1.2, last - (second - last) / (ratio - 1), last)
    return found if found.ndim else float(found)


def measured(nets: Sequence[Net], edges: Sequence[int]) -> Iterator[dict[str, Any]]:
    """Yield a row for each net, all of one angle and contrast."""
    by_mesh = [tensors(nets, count) for count in edges]
    for net, found in zip(nets, zip(*by_mesh, strict=True), strict=True):
        factors = [factor_of(net, tensor) for tensor in found]
        simulated = limit([moduli(tensor) for tensor in found])
        value = limit(factors)
        yield {
            **asdict(net),
            "width_ratio": net.width_ratio,
            "factors": factors,
            "factor": value,
            "relaxed_factor": net.factor,
            "error": net.factor / value - 1,
            "moduli_n_per_m": simulated.tolist(),
            "moduli_errors": (moduli(relaxed_tensor(net, net.factor)) / simulated - 1).tolist(),
        }


def fitted(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the best constant c of 1/(1 − S) + c (s₁² s₂ + s₂² s₁) sinⁿ 2θ, for each power n."""
    nets = [Net(**{key: row[key] for key in Net.__dataclass_fields__}) for row in rows]
    factors = np.array([row["factor"] for row in rows])
    gaps = np.array([1 / (1 - sum(net.shares)) for net in nets])
    added = np.array([net.contrast * net.crossings for net in nets])
    sine = np.array([np.sin(2 * net.angles[0]) for net in nets])

    def logarithms(c: Floats, power: int) -> Floats:
        return np.asarray(np.log((gaps + c[0] * added * sine**power) / factors))

    fits = []
    for power in POWERS:
        best = least_squares(logarithms, [1.0], args=(power,))
        errors = np.expm1(best.fun)
        fits.append(
            {
                "power": power,
                "crossing": float(best.x[0]),
                "rms": float(np.sqrt(np.mean(best.fun**2))),
                "least": float(errors.min()),
                "largest": float(errors.max()),
            }
        )
    return fits


def fitted_widths(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Return the exponent m of a factor 2/(rᵐ + r⁻ᵐ) on c for lines of the width ratio r.

    c is the package's factor for lines of equal width. The errors are those of the fit.
    """
    nets = [Net(**{key: row[key] for key in Net.__dataclass_fields__}) for row in rows]
    factors = np.array([row["factor"] for row in rows])
    gaps = np.array([1 / (1 - sum(net.shares)) for net in nets])
    sine = np.array([np.sin(2 * net.angles[0]) for net in nets])
    crossings = np.array([net.contrast * net.crossings for net in nets])
    added = CROSSING * crossings * sine**4
    ratios = np.array([net.width_ratio for net in nets])

    def logarithms(m: Floats) -> Floats:
        return np.asarray(np.log((gaps + added * 2 / (ratios**m + ratios**-m)) / factors))

    best = least_squares(logarithms, [2.0])
    errors = np.expm1(best.fun)
    return {
        "exponent": float(best.x[0]),
        "rms": float(np.sqrt(np.mean(best.fun**2))),
        "least": float(errors.min()),
        "largest": float(errors.max()),
    }


def relaxed_pull(net: Net, direction: float, strain: float, factor: float) -> tuple[float, float]:
    """Return stress in N/m and lateral contraction of the relaxed material pulled at an angle.

    The energy is eq. (1) times the factor, and that of the lines, derived by complex steps.
    """
    composite, fabric = net.composite, net.composite.fabric
    a, b = (composite.c1 - 1) ** 2, (composite.c2 - 1) ** 2
    flat = np.column_stack([np.cos(net.angles - direction), np.sin(net.angles - direction)])

    def energy(along: Any, shear: Any, across: Any) -> Any:
        C = np.array([[along**2, along * shear], [along * shear, shear**2 + across**2]])
        p = along * across
        s = np.sqrt(C[0, 0] + C[1, 1] + 2 * p)
        squares, product = s * s - 2 * p - 2 * s + 2, p - s + 1
        psi = -fabric.mu * a * np.log(1 - squares / a + product**2 / a**2)
        psi -= fabric.lam / 2 * b * np.log(1 - (s - 2) ** 2 / b)
        stretches = np.sqrt(np.einsum("ki,ij,kj->k", flat, C, flat))
        lines = (np.array(net.shares) * (stretches - 1) ** 2).sum() / 2
        return factor * fabric.thickness * psi + PRINT.membrane_stiffness * lines

    def slopes(values: Floats) -> Floats:
        steps = np.asarray(values) + 1e-30j * np.eye(3)
        return np.array([energy(*step).imag / 1e-30 for step in steps])

    pulled = 1 + strain
    start = np.array([0.0, 1.0])
    best = minimize(
        lambda v: energy(pulled, *v) / PRINT.membrane_stiffness,
        start,
        jac=lambda v: slopes(np.array([pulled, *v]))[1:] / PRINT.membrane_stiffness,
        options={"gtol": 1e-11},
    )
    stress = slopes(np.array([pulled, *best.x]))[0]
    return float(stress), float((1 - best.x[1]) / strain)


def pulled(net: Net, edges: Sequence[int], pulls: Sequence[tuple[int, float]]) -> list[Any]:
    """Return a row for each pull, given as direction in degrees and strain."""
    values = []
    for count in edges:
        cell = rectangle(net.angle_deg, count)
        skin = sew(MPI.COMM_SELF, cell.pattern)
        solver = TileSolver(skin, net.composite, Periodic(cell))
        density = net.printed(cell)[skin.owned_cells].astype(np.float64)
        part = []
        for degrees, strain in pulls:
            profile = ProfileSolver(solver, np.radians([degrees]), strain)
            found = profile.solve(density, gradients=False)
            part.append([found.stress[0], found.contraction[0]])
        values.append(part)
    simulated = limit(values)
    rows = []
    for (degrees, strain), (stress, contraction) in zip(pulls, simulated, strict=True):
        relaxed = relaxed_pull(net, np.radians(degrees), strain, net.factor)
        rows.append(
            {
                **asdict(net),
                "direction_deg": degrees,
                "strain": strain,
                "stress_n_per_m": float(stress),
                "contraction": float(contraction),
                "relaxed_stress_n_per_m": relaxed[0],
                "relaxed_contraction": relaxed[1],
                "stress_error": relaxed[0] / float(stress) - 1,
            }
        )
    return rows


def nets_of(*, quick: bool) -> list[list[Net]]:
    """Return nets with lines of equal width, in groups of one angle and contrast."""
    if quick:
        return [[Net(angle, (0.2, 0.2))] for angle in (30.0, 45.0)]
    groups = []
    unequal = [((0.05, 0.1), (1, 2)), ((0.1, 0.2), (1, 2)), ((0.15, 0.3), (1, 2)),
               ((0.1, 0.3), (1, 3)), ((0.05, 0.2), (1, 4))]  # fmt: skip
    for angle in ANGLES:
        equal = [Net(angle, (share, share)) for share in SHARES]
        groups.append(equal + [Net(angle, shares, lines) for shares, lines in unequal])
    for contrast in (50.0, 1000.0):
        for angle in (15.0, 30.0, 45.0):
            some = (0.05, 0.1, 0.2, 0.3)
            groups.append([Net(angle, (share, share), contrast=contrast) for share in some])
    return groups


def widths_of(*, quick: bool) -> list[list[Net]]:
    """Return nets with wide and thin lines, in groups of one angle."""
    if quick:
        return [[Net(45.0, (0.2, 0.2), (1, 2))]]
    cases = [((0.2, 0.2), (1, 2)), ((0.2, 0.2), (1, 4)), ((0.3, 0.3), (1, 2)),
             ((0.3, 0.3), (1, 3)), ((0.1, 0.1), (1, 2)), ((0.1, 0.2), (1, 1)),
             ((0.2, 0.1), (1, 2)), ((0.1, 0.15), (1, 3))]  # fmt: skip
    return [[Net(angle, *case) for case in cases] for angle in (15.0, 30.0, 45.0)]


def pulls_of(*, quick: bool) -> list[tuple[Net, list[tuple[int, float]]]]:
    """Return nets and their pulls; where θ is small, lines let the net stretch across alone."""
    if quick:
        return [(Net(30.0, (0.2, 0.2)), [(90, 0.1)])]
    both = [(0, 0.05), (0, 0.1), (90, 0.1), (90, 0.2)]
    return [
        (Net(angle, (share, share)), both if angle > 25 else both[2:])
        for angle in (15.0, 30.0, 45.0)
        for share in (0.1, 0.2)
    ]


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="few nets on coarse meshes")
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--picture", type=Path, help="file for a picture of study 1")
    options = parser.parse_args()
    edges = QUICK_EDGES if options.quick else EDGES
    found: dict[str, Any] = {}
    groups = {
        "nets": nets_of(quick=options.quick),
        "widths": widths_of(quick=options.quick),
        "one_family": [[Net(45.0, (0.2, 0.0))]],
    }
    for name, part in groups.items():
        print(f"\n{name}")
        print("    θ  shares      lines  contrast  factor by mesh, limit, of the package")
        found[name] = []
        for nets in part:
            for row in measured(nets, edges):
                found[name].append(row)
                cells = "".join(f"{value:9.4f}" for value in row["factors"])
                print(
                    f"{row['angle_deg']:5.1f}  {row['shares'][0]:4.2f} {row['shares'][1]:4.2f}"
                    f"   {row['lines'][0]:2d} {row['lines'][1]:2d}  {row['contrast']:8.0f} {cells}"
                    f" {row['factor']:9.4f} {row['relaxed_factor']:9.4f} {row['error']:+7.1%}",
                    flush=True,
                )
    found["fits"] = fitted(found["nets"])
    print("\n  n       c    rms   errors of the factor")
    for row in found["fits"]:
        print(
            f"{row['power']:3d} {row['crossing']:7.3f} {row['rms']:6.1%}"
            f"   {row['least']:+.0%} to {row['largest']:+.0%}"
        )
    found["width_fit"] = row = fitted_widths(found["widths"])
    print(
        f"\nc · 2/(rᵐ + r⁻ᵐ), r the ratio of the widths: m = {row['exponent']:.2f},"
        f" rms {row['rms']:.1%}, {row['least']:+.0%} to {row['largest']:+.0%}"
    )
    print("\npulls\n    θ  share  direction  strain  stress and contraction; of the package")
    found["pulls"] = []
    for net, pulls in pulls_of(quick=options.quick):
        for row in pulled(net, edges, pulls):
            found["pulls"].append(row)
            print(
                f"{row['angle_deg']:5.1f}  {row['shares'][0]:5.2f} {row['direction_deg']:10d}"
                f"  {row['strain']:6.2f} {row['stress_n_per_m']:8.3f} {row['contraction']:6.3f}"
                f" {row['relaxed_stress_n_per_m']:8.3f} {row['relaxed_contraction']:6.3f}"
                f" {row['stress_error']:+7.1%}",
                flush=True,
            )
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if options.picture:
        plot(found["nets"], options.picture)


def plot(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw simulated factors over the angle between the lines, beside those of the package."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
    drawn = [r for r in rows if r["contrast"] == CONTRAST and r["shares"][0] == r["shares"][1]]
    for share in sorted({row["shares"][0] for row in drawn}):
        part = [row for row in drawn if row["shares"][0] == share]
        angles = np.linspace(10, 45, 60)
        curve = [Net(angle, (share, share)).factor for angle in angles]
        (line,) = axes.semilogy(2 * angles, curve, label=f"{share:g}")
        at = [2 * row["angle_deg"] for row in part]
        axes.semilogy(at, [row["factor"] for row in part], "o", color=line.get_color())
    axes.set_xlabel("angle between the lines, degrees")
    axes.set_ylabel("factor on the fabric")
    axes.yaxis.set_major_locator(mpl.ticker.FixedLocator([1, 2, 3, 5, 10]))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    axes.legend(title="share of each family", ncols=2)
    figure.savefig(path, dpi=150)
    plt.close(figure)


if __name__ == "__main__":
    main()
