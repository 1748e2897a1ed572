"""Contact with a known answer: a plate, a flattened tube, a fold, a belt on a drum, a slope.

The size of a mesh is the number of edges along the scene. Where the distance is refined, from
which on contact acts, the size is the thickness over that distance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.accuracy.known import Known, Measured
from benchmarks.accuracy.membrane import DISC, THICKNESS
from benchmarks.accuracy.scenes import entry, membrane_case, table_a
from benchmarks.accuracy.touching import (
    BALL_FORCE,
    BELT_FRICTION,
    DRUM,
    DRUM_SIDES,
    FOLD_THICKNESS,
    PAD_FRICTION,
    PLATE_HEIGHT,
    PLATE_PRESSURE,
    TUBE_HEIGHT,
    TUBE_RADIUS,
    against_plate,
    ball_depth,
    belt,
    closed_fold,
    contact_radius,
    flat_width,
    flattened,
    gap,
    plate_volume,
    pole_height,
    pole_stretch,
    pressed_tube,
    pull_ratio,
    sliding_slope,
    steepest,
    under_ball,
)


def plate(column: str) -> float:
    """The reference of the membrane against a plate."""
    match = {"c1": "1.8", "p_Pa": f"{PLATE_PRESSURE:g}", "height_m": f"{PLATE_HEIGHT:g}"}
    return entry("membrane_on_plate", column, **match)


def refined(found: Measured, length: float) -> Measured:
    """Name what is refined, a length in m: a distance, or edges along the scene."""
    return replace(found, length=length)


PLATE = (
    f"A clamped disc of material A, a = 2 cm, blown by {PLATE_PRESSURE:g} Pa against a plate at a "
    f"height of {PLATE_HEIGHT / DISC:g} a, without friction"
)
SHOOTING = "the equations of Feng & Yang 1973 with eq. (1), by `accuracy/references.py`"
TOGETHER = (
    "The distance from which on contact acts is refined with the mesh, with the square of its "
    "edges: {} to {} of the thickness."
)
DISTANCE_NOTE = (
    "Refined is the distance from which on contact acts, from left to right; on one mesh. The "
    "sheets keep away from each other by nearly that distance: order 1."
)
EXPONENTIAL = "Eytelwein: the pulls on both sides differ by the factor exp(μ θ)"

PLATES = tuple(
    membrane_case(
        "contact",
        f"plate-{name}",
        f"{PLATE}: {about}.",
        quantity,
        reference,
        SHOOTING,
        lambda mesh, size, value=value: value(against_plate(mesh, size, size**2 // 4)),
        meshes=("structured", "unstructured"),
        sizes=(8, 12, 16, 24),
        default=16,
        within=1e-2,
        note=TOGETHER.format("1/16", "1/144"),
    )
    for name, about, quantity, reference, value in (
        ("radius", "radius of the part on the plate, by the plate's force", "radius/a",
         plate("contact_radius_m") / DISC, contact_radius),
        ("volume", "enclosed volume", "V/a³", plate("volume_m3") / DISC**3, plate_volume),
        ("stretch", "stretch of the part on the plate", "λ", plate("pole_stretch"), pole_stretch),
    )
)  # fmt: skip
BALLS = (
    membrane_case(
        "contact",
        "ball-depth",
        f"The same disc under a ball of 8 mm radius that presses by {BALL_FORCE:g} N, without "
        "friction and pressure: depth of the ball.",
        "depth/a",
        entry("membrane_under_ball", "depth_m", weight_N=f"{BALL_FORCE:g}") / DISC,
        "the equations of Yang & Hsu 1971 with eq. (1), by `accuracy/references.py`",
        lambda mesh, size: ball_depth(under_ball(mesh, size, size**2 // 4)),
        meshes=("structured", "unstructured"),
        sizes=(6, 8, 12, 16),
        default=16,
        within=1e-2,
        note=f"{TOGETHER.format('1/9', '1/64')} So is the ball: its facets are half as long.",
    ),
)
CROSS_SECTION = (
    "A section of a long tube of material A, R = 1 cm, at 2 kPa between two plates, middle "
    f"surfaces {TUBE_HEIGHT / TUBE_RADIUS:g} R apart, without friction and change of length; half "
    "of it"
)
TUBES = (
    membrane_case(
        "contact",
        "tube-flattened",
        f"{CROSS_SECTION}: the plate's force over pressure and length.",
        "width of the flat part in m",
        flattened(table_a())[1],
        "closed form: the pull around the tube is p H/2, and 2π R λ = π H + 2 b",
        lambda mesh, size: refined(
            flat_width(pressed_tube(mesh, size, size**2 // 36)), np.pi * TUBE_RADIUS / size
        ),
        meshes=("right", "unstructured"),
        sizes=(12, 24, 48, 96),
        default=24,
        within=1e-2,
        note=TOGETHER.format("1/4", "1/256"),
    ),
)
DISTANCES = (
    membrane_case(
        "contact",
        "fold-gap",
        "A sheet of 0.5 mm folded over, one half held flat, the other pressed onto it by 200 Pa: "
        "distance of the middle surfaces over the thickness.",
        "distance over thickness",
        1.0,
        "two sheets that lie on each other are one thickness apart",
        lambda _, size: refined(gap(closed_fold(4, size)), FOLD_THICKNESS / size),
        meshes=("right",),
        sizes=(4, 16, 64, 256),
        within=1e-2,
        note=DISTANCE_NOTE,
    ),
    membrane_case(
        "contact",
        "plate-height",
        f"{PLATE}: height of the part on the plate.",
        "height over that of the plate",
        1.0,
        "the height of the plate, less half the thickness",
        lambda mesh, size: refined(pole_height(against_plate(mesh, 12, size)), THICKNESS / size),
        meshes=("structured", "unstructured"),
        sizes=(4, 16, 64, 256),
        within=1e-2,
        note=DISTANCE_NOTE,
    ),
)
FRICTION = (
    membrane_case(
        "contact",
        "belt",
        f"A belt over half a drum that turns under it, μ = {BELT_FRICTION:g}: pull of the held end "
        "over that of the other.",
        "ratio of the pulls",
        float(np.exp(np.pi * BELT_FRICTION)),
        EXPONENTIAL,
        lambda _, size: refined(
            pull_ratio(belt(size, DRUM_SIDES, 4, BELT_FRICTION)), np.pi * DRUM / size
        ),
        meshes=("right",),
        sizes=(12, 16, 24, 32),
        within=1e-2,
        note="The size is the number of edges along half the drum. The drum has 360 sides: facets "
        "as long as those of the belt would mesh with them like gears, by up to 4 %.",
    ),
    membrane_case(
        "contact",
        "slope-hold",
        "The steepest slope on which a pad keeps its place, by bisection.",
        "tan α",
        PAD_FRICTION,
        "Coulomb: tan α = μ",
        lambda _, size: steepest(size),
        meshes=("crossed",),
        sizes=(3, 5, 7, 9),
        within=1e-2,
        note="Refined is the interval of the bisection, from left to right. Its middle is "
        "compared.",
    ),
    membrane_case(
        "contact",
        "slope-slide",
        "A pad on a slope that slides: tangent of the angle at which it does so by itself, from "
        "the pull on a pad that is dragged.",
        "tan α",
        PAD_FRICTION,
        "Coulomb: tan α = μ",
        lambda _, size: sliding_slope(size, 4, 1.2 * PAD_FRICTION),
        meshes=("crossed",),
        sizes=(2, 4, 8, 16),
        within=1e-6,
        note="The pad does not narrow as it is pulled (ν = 0), so that all of its friction is "
        "along the pull.",
    ),
)
CONTACT: tuple[Known, ...] = (*PLATES, *BALLS, *TUBES, *DISTANCES, *FRICTION)
