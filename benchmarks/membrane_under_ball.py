"""Reference for contact: a clamped round membrane under a heavy ball.

    python benchmarks/membrane_under_ball.py > tests/data/membrane_under_ball.csv

After Yang & Hsu, Journal of Applied Mechanics 38 (1971) 227-230, who press a ball into a sheet of
Mooney's material; here with the law of eq. (1). The notation is that of `membrane_on_plate.py`. The
ball lies in the middle without friction; its radius and half the thickness add up to ρ. Where the
middle surface lies on the ball, sin φ = r/ρ, and what is along the meridian is in balance:

    r' = λ₁ cos φ,    (R T₁)' = T₂ cos φ.

This holds up to the flat radius b, where the pull along the axis carries the weight W of the ball,
2π R T₁ sin φ = W. From there on it does so everywhere: with X = R T₁ cos φ and Y = W/(2π)

    r' = λ₁ X/√(X² + Y²),   z' = λ₁ Y/√(X² + Y²),   X' = T₂.

The stretch at the pole is found such that r(a) = a.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from membrane_on_plate import POLE, RADIUS, THICKNESS, TOLERANCE, Floats, Law
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

BALL = 8e-3  # m, radius of the ball


@dataclass(frozen=True)
class Dimple:
    """A sheet under a ball; lengths in m.

    Attributes:
        border: Radius of the border, a in equilibrium.
        depth: Of the pole below the border.
        contact: Radius of the part on the ball.
        pole: Stretch at the pole.
        energy: Elastic, in J.
    """

    border: float
    depth: float
    contact: float
    pole: float
    energy: float


def integrated(law: Law, weight: float, pole: float) -> Dimple:
    """Integrate from the pole to the border.

    Args:
        law: The material.
        weight: Of the ball in N.
        pole: Stretch at the pole.
    """
    rho, share = BALL + THICKNESS / 2, weight / (2 * np.pi)

    def stored(flat: float, along: float, across: float) -> float:
        ring = 2 * np.pi * flat * THICKNESS
        return float(ring * law.energy(np.array(along), np.array(across)))

    def on_ball(flat: float, values: Floats) -> list[float]:
        r, pull = values[:2]
        across, cosine = r / flat, np.sqrt(1 - (r / rho) ** 2)
        along = law.stretch(pull / (flat * THICKNESS), across)
        hoop = THICKNESS * law.stress(across, along)
        return [along * cosine, hoop * cosine, stored(flat, along, across)]

    def carried(_: float, values: Floats) -> float:
        return float(values[1] * values[0] / rho - share)

    carried.terminal = True  # type: ignore[attr-defined]

    def free(flat: float, values: Floats) -> list[float]:
        r, _, outward = values[:3]
        pull, across = np.hypot(outward, share), r / flat
        along = law.stretch(pull / (flat * THICKNESS), across)
        turn = along / pull
        hoop = THICKNESS * law.stress(across, along)
        return [turn * outward, turn * share, hoop, stored(flat, along, across)]

    exact = {"method": "DOP853", "rtol": TOLERANCE, "atol": TOLERANCE * RADIUS}
    begin = POLE * RADIUS
    start = [pole * begin, begin * THICKNESS * law.stress(pole, pole), 0.0]
    inner = solve_ivp(on_ball, (begin, RADIUS), start, events=carried, **exact)
    flat, (r, pull, energy) = inner.t[-1], inner.y[:, -1]
    cosine = np.sqrt(1 - (r / rho) ** 2)
    start = [r, rho * (1 - cosine), pull * cosine, energy]
    outer = solve_ivp(free, (flat, RADIUS), start, **exact)
    border, depth, _, energy = (float(value) for value in outer.y[:, -1])
    return Dimple(border, depth, float(r), pole, energy)


def dimple(law: Law, weight: float) -> Dimple:
    """Return the sheet in equilibrium under a ball of a weight in N."""

    def border(pole: float) -> float:
        return integrated(law, weight, pole).border - RADIUS

    below = above = 1.4
    while border(below) > 0:
        above, below = below, 1 + 0.9 * (below - 1)
    return integrated(law, weight, float(brentq(border, below, above, xtol=1e-13)))


def main() -> None:
    """Write the table to the standard output."""
    print("c1,c2,a_m,h_m,ball_radius_m,weight_N,depth_m,contact_radius_m,pole_stretch")
    for weight in (0.05, 0.1, 0.2):
        found = dimple(Law(c1=1.8, c2=2.0), weight)
        cells = f"{found.depth:.9e},{found.contact:.9e},{found.pole:.9e}"
        sys.stdout.write(f"1.8,2,{RADIUS:g},{THICKNESS:g},{BALL:g},{weight:g},{cells}\n")


if __name__ == "__main__":
    main()
