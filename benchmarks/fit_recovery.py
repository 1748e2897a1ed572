"""How often the 95 % intervals of a fit hold the true constants.

    scripts/fenicsx python3 benchmarks/fit_recovery.py --quick
    scripts/fenicsx python3 benchmarks/fit_recovery.py --json benchmarks/fit_recovery.json

Tests of known constants (E = 100 kPa, ν = 0.3, c₁ = 1.9, c₂ = 2.2) get noise, 2 % of the largest
stress and 0.01 of lateral stretch, and are fitted; each case is drawn a hundred times. The table
counts in how many draws the interval of each constant holds the true value, in how many c₁ and c₂
are told apart from none ("identified"), and gives the median width of E's interval.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from toros_fem.materials.sheet import Material
from toros_fem.products.fitting import FitOptions, TensileTest, fit_material, uniaxial_curve

Floats = npt.NDArray[np.float64]
SHEET, C1, C2, RATIO = Material(0.1e6, 0.3, 0.5e-3), 1.9, 2.2, 2.5
NOISE, LATERAL_NOISE = 0.02, 0.01
POINTS, DRAWS, RESAMPLES = 40, 100, 100


def strip(
    rng: np.random.Generator,
    *,
    top: float = 1.8,
    lateral: bool = True,
    stiffer: float = 1.0,
    correlation: float = 0.0,
    direction: str = "",
    name: str = "1",
) -> TensileTest:
    """Return a test with noise.

    Args:
        rng: Source of the noise.
        top: Largest stretch.
        lateral: Whether the lateral stretch is measured.
        stiffer: Factor on the stress, of a specimen that differs.
        correlation: Of the noise of neighbouring points.
        direction: "course" or "wale" of a knit.
        name: Name of the specimen.
    """
    stretch = np.asarray(np.linspace(1 + 0.025 * (top - 1), top, POINTS), dtype=np.float64)
    stress, across = uniaxial_curve(
        SHEET, C1, C2, stretch,
        knit_ratio=RATIO if direction else 1.0, direction=direction or "wale",
    )  # fmt: skip

    def noise() -> Floats:
        white = rng.standard_normal(3 * POINTS)
        scale = np.sqrt(1 - correlation**2)
        return np.asarray(lfilter([scale], [1, -correlation], white)[-POINTS:])

    stress = stiffer * stress + NOISE * stress.max() * noise()
    seen = across + LATERAL_NOISE * noise() if lateral else None
    return TensileTest(stretch, stress, SHEET.thickness, seen, name, direction)


def specimens(rng: np.random.Generator) -> list[TensileTest]:
    """Return five specimens whose stiffness varies by 5 %."""
    return [strip(rng, stiffer=1 + 0.05 * rng.standard_normal(), name=str(k)) for k in range(5)]


def knit(rng: np.random.Generator) -> list[TensileTest]:
    """Return two tests along the courses and two along the wales."""
    return [
        strip(rng, direction=direction, name=f"{direction} {k}")
        for direction in ("course", "wale")
        for k in range(2)
    ]


Case = Callable[[np.random.Generator], list[TensileTest]]
CASES: dict[str, tuple[Case, tuple[str, ...]]] = {
    "one strip": (lambda rng: [strip(rng)], ("hessian", "bootstrap")),
    "without lateral stretch": (lambda rng: [strip(rng, lateral=False)], ("hessian",)),
    "to a stretch of 1.2": (lambda rng: [strip(rng, top=1.2)], ("hessian",)),
    "noise correlated by 0.7": (
        lambda rng: [strip(rng, correlation=0.7)], ("hessian", "bootstrap"),
    ),
    "five strips, 5 % apart": (specimens, ("hessian", "bootstrap")),
    "knit, both directions": (knit, ("hessian",)),
}  # fmt: skip


def truth(names: list[str]) -> dict[str, float]:
    """Return the true values of the constants of these names."""
    known = {
        "young": SHEET.young, "poisson": SHEET.poisson, "mu": SHEET.mu, "lam": SHEET.lam,
        "c1": C1, "c2": C2, "knit_ratio": RATIO,
    }  # fmt: skip
    return {name: known[name] for name in names}


def row(case: str, intervals: str, draws: int) -> dict[str, Any]:
    """Return the counts of a case."""
    options = FitOptions(intervals=intervals, draws=RESAMPLES)
    held: dict[str, int] = {}
    identified, widths = {"c1": 0, "c2": 0}, []
    for seed in range(draws):
        result = fit_material(CASES[case][0](np.random.default_rng([seed, 24])), options)
        for name, value in truth(list(result.estimates)).items():
            held[name] = held.get(name, 0) + (value in result.estimates[name])
        for name in identified:
            identified[name] += result.estimates[name].identified
        young = result.estimates["young"]
        widths.append((young.high - young.low) / young.value)
    return {
        "case": case,
        "intervals": intervals,
        "draws": draws,
        "held": held,
        "identified": identified,
        "width_of_young": round(float(np.median(widths)), 4),
    }


def main() -> None:
    """Print the table, and write it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="10 draws of each case")
    parser.add_argument("--json", type=Path, help="file to write the rows to")
    parser.add_argument("--case", choices=tuple(CASES), help="this case alone; default all")
    given = parser.parse_args()
    rows = []
    for case in [given.case] if given.case else list(CASES):
        for intervals in CASES[case][1]:
            rows.append(row(case, intervals, 10 if given.quick else DRAWS))
            print(json.dumps(rows[-1], ensure_ascii=False), flush=True)
            if given.json is not None:
                content = json.dumps(rows, indent=1, ensure_ascii=False)
                given.json.write_text(content + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
