"""References for contact: a clamped round membrane that is blown against a plate, or under a ball.

The equations are those of Feng & Yang, Journal of Applied Mechanics 40 (1973) 209-214, who press
balloons of Mooney's material between plates; here with the law of eq. (1). A flat disc of radius a
is held along its border in the plane z = 0. The pressure p blows it against a flat plate at the
height H, without friction. A point at the radius R of the flat disc moves to (r(R), z(R)). The
stretches are λ₁ = √(r'² + z'²) and λ₂ = r/R, the forces per flat length are T₁ and T₂, by eq. (1).
The angle of the meridian with the plate is φ. Then

    (R T₁ sin φ)' = p r r',    (R T₁ cos φ)' = T₂ − p r λ₁ sin φ,

and on the plate, where φ = 0, the plate carries the pressure. There the second equation alone
remains, (R T₁)' = T₂. Its regular solution is r = λ₀ R: the part on the plate is stretched alike
everywhere, up to R = b. The first equation has the integral R T₁ sin φ = p (r² − λ₀² b²)/2. So with
X = R T₁ cos φ, Y = R T₁ sin φ

    r' = λ₁ X/√(X² + Y²),   z' = −λ₁ Y/√(X² + Y²),   X' = T₂ − p r λ₁ sin φ

is an initial value problem from R = b on: r = λ₀ b, z = H, X = b T₁(λ₀, λ₀). λ₀ and b are found
such that r(a) = a and z(a) = 0. A disc that does not reach the plate has b = 0; then λ₀ follows
from r(a) = a alone.

After Yang & Hsu, Journal of Applied Mechanics 38 (1971) 227-230, who press a ball into a sheet of
Mooney's material. The
ball lies in the middle without friction; its radius and half the thickness add up to ρ. Where the
middle surface lies on the ball, sin φ = r/ρ, and what is along the meridian is in balance:

    r' = λ₁ cos φ,    (R T₁)' = T₂ cos φ.

This holds up to the flat radius b, where the pull along the axis carries the weight W of the ball,
2π R T₁ sin φ = W. From there on it does so everywhere: with X = R T₁ cos φ and Y = W/(2π)

    r' = λ₁ X/√(X² + Y²),   z' = λ₁ Y/√(X² + Y²),   X' = T₂.

The stretch at the pole is found such that r(a) = a.

Units are SI throughout. It uses numpy and scipy only, nothing of the package.

    python -m benchmarks.accuracy.references plate > tests/data/membrane_on_plate.csv
    python -m benchmarks.accuracy.references ball > tests/data/membrane_under_ball.csv
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

Floats = npt.NDArray[np.float64]
RADIUS, THICKNESS = 0.02, 0.3e-3  # m, of the tables' disc
MU = LAM = 50e3  # Pa, of material A
TOLERANCE = 1e-11
# Flat radius, over that of the disc, from which the free disc is integrated.
POLE = 1e-4
# By which the plate is lowered at once, over the height of the free disc.
STEP = 0.02
BALL = 8e-3  # m, radius of the ball


@dataclass(frozen=True)
class Law:
    """Eq. (1): stress by the stretches.

    Attributes:
        mu, lam: Plane-stress Lamé parameters in Pa.
        c1, c2: Stretch bounds; None for none, where eq. (1) is quadratic in the Biot strain.
    """

    mu: float = MU
    lam: float = LAM
    c1: float | None = None
    c2: float | None = None

    def stress(self, along: float, across: float) -> float:
        """Return the nominal stress in Pa in the direction of the first stretch."""
        single, both = along - 1, along + across - 2
        one = 0.0 if self.c1 is None else (single / (self.c1 - 1)) ** 2
        two = 0.0 if self.c2 is None else (both / (self.c2 - 1)) ** 2
        return 2 * self.mu * single / (1 - one) + self.lam * both / (1 - two)

    def stretch(self, stress: float, across: float) -> float:
        """Return the first stretch that gives a nominal stress."""
        highest = 50.0
        if self.c1 is not None:
            highest = self.c1
        if self.c2 is not None:
            highest = min(highest, 1 + self.c2 - across)
        lowest = 1.0 if self.c1 is None else 2 - self.c1
        if self.c2 is not None:
            lowest = max(lowest, 3 - self.c2 - across)
        margin = 1e-13 * (highest - lowest)
        return float(
            brentq(
                lambda along: self.stress(along, across) - stress,
                min(lowest, 0.5) + margin,
                highest - margin,
                xtol=1e-15,
                rtol=1e-14,
            )
        )


@dataclass(frozen=True, eq=False)
class Profile:
    """A membrane in equilibrium; lengths in m.

    Attributes:
        flat_contact: Radius b of the part on the plate, on the flat disc; 0 without contact.
        pole: Stretch of that part, or at the pole.
        height: Of the pole above the border.
        flat, radius, up: R, r and z along a meridian.
        volume: Enclosed with the plane of the border, in m³.
        rim_force: Of the support along the axis, in N.
    """

    flat_contact: float
    pole: float
    height: float
    flat: Floats
    radius: Floats
    up: Floats
    volume: float
    rim_force: float

    @property
    def contact_radius(self) -> float:
        """Radius of the part on the plate."""
        return self.pole * self.flat_contact


def meridian(
    law: Law, pressure: float, begin: float, pole: float, height: float, contact: float
) -> tuple[Floats, Floats, Floats, float, float]:
    """Integrate from a flat radius to the border.

    Args:
        law: The material.
        pressure: In Pa.
        begin: Flat radius in m.
        pole: Stretch there.
        height: Of the point there, in m.
        contact: Radius in m of the part that a plate holds.

    Returns:
        R, r and z at many points in m, the volume in m³, and the force along the axis in N.
    """

    def state(flat: float, values: Floats) -> tuple[float, float, float, float]:
        r, _, inward = values[:3]
        down = pressure * (r**2 - contact**2) / 2
        pull = float(np.hypot(inward, down))
        across = r / flat
        along = law.stretch(pull / (flat * THICKNESS), across)
        return along, across, inward / pull, down / pull

    def rate(flat: float, values: Floats) -> list[float]:
        along, across, cosine, sine = state(flat, values)
        r = values[0]
        hoop = THICKNESS * law.stress(across, along)
        turn = along * cosine
        return [
            turn,
            -along * sine,
            hoop - pressure * r * along * sine,
            2 * np.pi * r * values[1] * turn,
        ]

    r = pole * begin
    inward = begin * THICKNESS * law.stress(pole, pole)
    found = solve_ivp(
        rate,
        (begin, RADIUS),
        [r, height, inward, np.pi * r**2 * height],
        method="DOP853",
        rtol=TOLERANCE,
        atol=TOLERANCE * np.array([RADIUS, RADIUS, inward + 1e-3, RADIUS**3]),
        dense_output=True,
    )
    if not found.success:
        raise ArithmeticError(found.message)
    flat = np.linspace(begin, RADIUS, 401)
    values = found.sol(flat)
    rim = np.pi * pressure * (values[0, -1] ** 2 - contact**2)
    return flat, values[0], values[1], float(found.y[3, -1]), float(rim)


def free_disc(law: Law, pressure: float, above: float = 1.49) -> Profile:
    """Return the inflated disc that meets no plate.

    Args:
        law: The material.
        pressure: In Pa.
        above: A stretch larger than that at the pole, which is sought from there downwards.
    """
    begin = POLE * RADIUS

    def border(pole: float) -> float:
        return float(meridian(law, pressure, begin, pole, 0.0, 0.0)[1][-1]) - RADIUS

    below = above
    while border(below) > 0:
        above, below = below, 1 + 0.9 * (below - 1)
    pole = float(brentq(border, below, above, xtol=1e-13))
    flat, r, z, volume, rim = meridian(law, pressure, begin, pole, 0.0, 0.0)
    height = -float(z[-1])
    return Profile(0.0, pole, height, flat, r, z + height, volume + np.pi * RADIUS**2 * height, rim)


def pressed_disc(law: Law, pressure: float, height: float, start: Profile) -> Profile:
    """Return the disc that is blown against a plate, which is lowered from the free pole.

    Args:
        law: The material.
        pressure: In Pa.
        height: Of the plate in m, below the pole of the free disc.
        start: The free disc at this pressure.
    """
    count = 1 + int(np.ceil((start.height - height) / (STEP * start.height)))
    unknown = before = np.array([start.pole, 0.0])
    for at in np.linspace(start.height, height, count)[1:]:

        def ends(trial: Floats, at: float = at) -> list[float]:
            begin = trial[1] * RADIUS
            _, r, z, *_ = meridian(law, pressure, begin, trial[0], at, trial[0] * begin)
            return [r[-1] / RADIUS - 1, z[-1] / RADIUS]

        # Close to the free disc, the part on the plate is that of a cap of equal volume.
        guess = 2 * unknown - before if before[1] else [start.pole, np.sqrt(STEP)]
        found = root(ends, guess, tol=1e-12)
        if np.abs(found.fun).max() > 1e-9:
            raise ArithmeticError(found.message)
        before, unknown = unknown, found.x
    pole, begin = float(unknown[0]), float(unknown[1]) * RADIUS
    return Profile(begin, pole, height, *meridian(law, pressure, begin, pole, height, pole * begin))


@dataclass(frozen=True)
class Dimple:
    """A sheet under a ball; lengths in m.

    Attributes:
        border: Radius of the border, a in equilibrium.
        depth: Of the pole below the border.
        contact: Radius of the part on the ball.
        pole: Stretch at the pole.
    """

    border: float
    depth: float
    contact: float
    pole: float


def integrated(law: Law, weight: float, pole: float) -> Dimple:
    """Integrate from the pole to the border.

    Args:
        law: The material.
        weight: Of the ball in N.
        pole: Stretch at the pole.
    """
    rho, share = BALL + THICKNESS / 2, weight / (2 * np.pi)

    def on_ball(flat: float, values: Floats) -> list[float]:
        r, pull = values[:2]
        across, cosine = r / flat, np.sqrt(1 - (r / rho) ** 2)
        along = law.stretch(pull / (flat * THICKNESS), across)
        hoop = THICKNESS * law.stress(across, along)
        return [along * cosine, hoop * cosine]

    def carried(_: float, values: Floats) -> float:
        return float(values[1] * values[0] / rho - share)

    carried.terminal = True  # type: ignore[attr-defined]

    def free(flat: float, values: Floats) -> list[float]:
        r, _, outward = values[:3]
        pull, across = np.hypot(outward, share), r / flat
        along = law.stretch(pull / (flat * THICKNESS), across)
        turn = along / pull
        hoop = THICKNESS * law.stress(across, along)
        return [turn * outward, turn * share, hoop]

    exact = {"method": "DOP853", "rtol": TOLERANCE, "atol": TOLERANCE * RADIUS}
    begin = POLE * RADIUS
    start = [pole * begin, begin * THICKNESS * law.stress(pole, pole)]
    inner = solve_ivp(on_ball, (begin, RADIUS), start, events=carried, **exact)
    flat, (r, pull) = inner.t[-1], inner.y[:, -1]
    cosine = np.sqrt(1 - (r / rho) ** 2)
    start = [r, rho * (1 - cosine), pull * cosine]
    outer = solve_ivp(free, (flat, RADIUS), start, **exact)
    border, depth, _ = (float(value) for value in outer.y[:, -1])
    return Dimple(border, depth, float(r), pole)


def dimple(law: Law, weight: float) -> Dimple:
    """Return the sheet in equilibrium under a ball of a weight in N."""

    def border(pole: float) -> float:
        return integrated(law, weight, pole).border - RADIUS

    below = above = 1.4
    while border(below) > 0:
        above, below = below, 1 + 0.9 * (below - 1)
    return integrated(law, weight, float(brentq(border, below, above, xtol=1e-13)))


def plate_table() -> None:
    """Write the table of the plate to the standard output."""
    print("c1,c2,a_m,h_m,p_Pa,height_m,contact_radius_m,pole_stretch,volume_m3,rim_force_N")
    for law in (Law(c1=1.8, c2=2.0), Law()):
        for pressure in (200.0, 500.0, 1000.0):
            free = free_disc(law, pressure)
            for height in (4e-3, 6e-3, 8e-3):
                if height < 0.95 * free.height:
                    found = pressed_disc(law, pressure, height, free)
                    bounds = ["inf" if c is None else f"{c:g}" for c in (law.c1, law.c2)]
                    numbers = (found.contact_radius, found.pole, found.volume, found.rim_force)
                    head = f"{RADIUS:g},{THICKNESS:g},{pressure:g},{height:g}"
                    cells = ",".join(f"{value:.9e}" for value in numbers)
                    sys.stdout.write(f"{','.join(bounds)},{head},{cells}\n")


def ball_table() -> None:
    """Write the table of the ball to the standard output."""
    print("c1,c2,a_m,h_m,ball_radius_m,weight_N,depth_m,contact_radius_m,pole_stretch")
    for weight in (0.05, 0.1, 0.2):
        found = dimple(Law(c1=1.8, c2=2.0), weight)
        cells = f"{found.depth:.9e},{found.contact:.9e},{found.pole:.9e}"
        sys.stdout.write(f"1.8,2,{RADIUS:g},{THICKNESS:g},{BALL:g},{weight:g},{cells}\n")


if __name__ == "__main__":
    {"plate": plate_table, "ball": ball_table}[sys.argv[1]]()
