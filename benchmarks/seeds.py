"""Whole designs again, from several random starts and on several machines.

`products` designs all kinds of products on coarse meshes, with targets of the demos and with
others: whether the print is within all tolerances by value, and whether it certainly is. A run that
changes its seed by itself counts as a miss.

`poses` designs one print for two poses, and beside it one for the first pose alone, with its
figures in the other.

`bends` designs eight bends with more pressure than they want, and one seed of each with the
projection of the paper, whose power is 1.

`kernels` designs coarse demos with each seed and each kernel type of OpenBLAS, and shows how far
rounds, figure and time spread.

Seconds are CPU seconds of a design with its files, without the curve.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar

import gmsh
import numpy as np
from mpi4py import MPI

from benchmarks.bench import ROOT, Case, Command, Row, Rows, Table, markdown
from benchmarks.figures import figure_of, figure_rows, state_in
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.validation import Floats
from toros_fem.cli.scene_files import read_scene
from toros_fem.design.loop.case import Case as ShapeCase
from toros_fem.measures.cross_sections import Rod
from toros_fem.measures.figures import NONE, Figure, State, formatted, largest_part, overall
from toros_fem.meshes.targets import Deformer
from toros_fem.products.actuators.estimates import SimulatedPrint, simulated_again
from toros_fem.products.actuators.scene import Level
from toros_fem.products.kinds import KINDS
from toros_fem.products.tubes import BendScene, BendTwistScene, ContractScene, TwistScene

# Places along a rod at which its frame is known.
PLACES = 1000


def rod(length: float, curvature: Callable[[Floats], Floats]) -> Deformer:
    """Return a deformer of a tube along z to a centre line; cross-sections do not turn about it.

    Args:
        length: In m.
        curvature: Angle of the whole length in rad by which the tube bends towards x and y at
            places in [0, 1], (n,): (2, n).
    """
    along = np.arange(PLACES) / PLACES
    rest = length * (along + 0.5 / PLACES)[:, None] * [0.0, 0.0, 1.0]
    toward_x, toward_y = curvature(along) / length
    none = np.zeros(PLACES)
    strains = np.stack([-toward_y, toward_x, none, none, none, none + 1], axis=1)
    straight = Rod(rest, rest, np.tile(np.eye(3), (PLACES, 1, 1)))
    bent = straight.strained(strains)

    def deform(points: Floats) -> Floats:
        nearest = np.clip(points[:, 2] / length * PLACES, 0, PLACES - 1).astype(int)
        return straight.carried(nearest, points, bent)

    return deform


class RodScene(BendTwistScene):
    """A tube whose centre line is the target; no number is."""

    def curvature(self, at: Floats) -> Floats:
        """Return the curvature of its centre line, as of `rod`."""
        raise NotImplementedError

    def case(self, comm: MPI.Comm, level: Level) -> ShapeCase:
        """Return the tube and its target."""
        return self.tube_case(comm, level, rod(self.skin.length, self.curvature), [])


class EqualS(RodScene):
    """An S whose halves bend to opposite sides."""

    ANGLES: ClassVar = (60.0, -60.0)  # of the halves, the one at the base first, in degrees

    def curvature(self, at: Floats) -> Floats:
        """Return the curvature of two arcs."""
        first, second = 2 * np.radians(self.ANGLES)
        return np.stack([np.where(at < 0.5, first, second), 0 * at])


class HalfHelix(RodScene):
    """Half a turn of a helix that leans by 45 degrees: as much curvature as torsion."""

    def curvature(self, at: Floats) -> Floats:
        """Return the curvature of a helix in a frame that does not turn about it."""
        whole = np.pi * np.sqrt(0.5)
        return whole * np.stack([np.cos(whole * at), np.sin(whole * at)])


@cache
def own_finger() -> Any:
    """Return the scene of a demo with its files."""
    return read_scene(ROOT / "demos" / "scenes" / "own_design.toml", comm=MPI.COMM_SELF)


# Scenes by their titles; their coarse variants are designed.
PRODUCTS: dict[str, Callable[[], Any]] = {
    "bend by 180°": BendScene,
    "shorten by 8 %": ContractScene,
    "twist by 300°, length free": TwistScene,
    "twist by 300°, length kept": lambda: TwistScene.of(keep_length=True),
    "bend by 90° and twist by 60°": BendTwistScene,
    "bend by 60° and twist by −90°": lambda: BendTwistScene.of(angle=60, twist=-90),
    "S of 60° and −60°": EqualS,
    "half a helix": HalfHelix,
    "walker stands": lambda: KINDS["walker"](),
    "walker crawls": lambda: KINDS["walker"].of(motion="crawl"),
    "gripper of a sphere": lambda: KINDS["gripper"](),
    "gripper of a box": lambda: KINDS["gripper"].of(shape="box"),
    "own finger": lambda: own_finger().config,
    "tile, orthotropic": lambda: KINDS["tile"].of(target="orthotropic"),
    "tile, tetragonal": lambda: KINDS["tile"].of(target="tetragonal"),
    "tile, isotropic": lambda: KINDS["tile"].of(target="isotropic"),
    "tile, auxetic": lambda: KINDS["tile"].of(target="auxetic"),
}


def posed(other: Mapping[str, Any], **values: Any) -> BendScene:
    """Return a bend with a further pose, of values by key."""
    return replace(BendScene.of(**values), poses=(other,))


POSES: dict[str, Callable[[], BendScene]] = {
    "90° at 8 kPa, 45° at 4 kPa": lambda: posed(
        {"angle": 45.0, "pressure": 4e3}, angle=90.0, pressure=8e3
    ),
    "90° at 8 kPa, 65° at 4 kPa": lambda: posed(
        {"angle": 65.0, "pressure": 4e3}, angle=90.0, pressure=8e3
    ),
    "90° at 8 kPa, free and with 20 g": lambda: posed(
        {"hung_mass": 0.02}, angle=90.0, pressure=8e3
    ),
    "60° at 15 kPa, blocked at 30° with 0.93 N": lambda: posed(
        {"blocked_angle": 30.0, "blocked_force": 0.93, "importance": 0.25},
        angle=60.0,
        pressure=15e3,
        length=0.09,
        shape_tolerance=0.08,  # the angle and the force count; the tube may lengthen
    ),
}
POSE_SEEDS = range(1, 5)
# What runs do besides, which tells nothing of the design.
BESIDES = ("curve_pressure", "gait_steps", "lift_distance")
SEEDS = range(1, 7)
# Bends: angle in degrees, length and diameter in mm.
BENDS = (
    (45, 150, 20), (60, 150, 20), (90, 150, 20), (120, 150, 20), (180, 150, 20), (60, 90, 16),
    (180, 300, 20), (90, 100, 30),
)  # fmt: skip
# Pressures in kPa that the pump gives: to all bends, and to two of them.
GIVEN, OTHERS, OF_OTHERS = 15, (8, 30), ((60, 150, 20), (180, 150, 20))
BEND_SEEDS, PAPER = range(1, 4), 1.0
# An angle is reached within so many degrees, if that is more than its tolerance.
DEGREES = 3.0
# The figure that a scene is known by.
FIGURES = {"bend": "angle_deg", "contract": "shortening_percent", "gripper": "held_mass_kg"}
TYPES = ("Haswell", "SkylakeX")
# A run of a few steps.
QUICK = {
    "edge_length": 5.5e-3,
    "filter_radius": 8.5e-3,
    "iterations": 2,
    "constrained_iterations": 1,
    "polish_iterations": 0,
    "relaxed_edge_length": 6e-3,
    "relaxed_iterations": 2,
    "laid_width": 3e-3,
    "second_laid_width": 3e-3,
    "print_edge_length": 3e-3,
    "corrections": 0,
}


def designed(scene: Any) -> tuple[Any, float]:
    """Design a skin without a curve and a trial; return the result, and the CPU time in s."""
    known = scene.described()
    scene = scene.updated(**{key: None for key in BESIDES if key in known})
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        files = own_finger().files if scene.KIND == "own-mesh" else {}
        found = scene.run_design(MPI.COMM_SELF, Path(folder), files)
    return found, time.process_time() - begin


def product_rows(title: str, seed: int, changes: Mapping[str, Any]) -> Iterator[Row]:
    """Design a product from a seed; its figures that have a target, and the worst of them."""
    yield from scene_rows(
        ("products", f"{title}, seed {seed}", ""), PRODUCTS[title](), seed, changes
    )


def pose_rows(title: str, seed: int, changes: Mapping[str, Any]) -> Iterator[Row]:
    """Design a print for two poses, and one for the first pose alone, seen in the other."""
    place, scene = ("poses", f"{title}, seed {seed}", ""), POSES[title]()
    yield from scene_rows(place, scene, seed, changes)
    quick = scene.coarse().updated(**changes, seed=seed, estimate_error=False, hold_pressure=True)
    found, _ = designed(replace(quick, poses=()))
    if found.printed.evaluation is None:
        return
    level, comm = quick.level_of_print, MPI.COMM_SELF
    simulated = SimulatedPrint.of(found.printed)
    case = quick.case_of_poses(comm, level)
    try:
        made = simulated_again(comm, case, level.regularisation, simulated, 1.0)
    except NoEquilibriumError as caught:
        yield Row(*place, "alone", None, note=str(caught))
        return
    for metric in made.poses[0].problem.metrics:
        if metric.target is not None:
            figure = metric.figure(made.metrics[metric.key])
            part = largest_part([figure])
            yield Row(*place, f"alone_{metric.key}", figure.value, metric.unit, note=f"{part:.3g}")


def scene_rows(
    place: tuple[str, str, str], scene: Any, seed: int, changes: Mapping[str, Any]
) -> Iterator[Row]:
    """Design a scene from a seed; its figures that have a target, and the worst of them."""
    scene = scene.coarse()
    known = {key: value for key, value in changes.items() if key in scene.described()}
    try:
        found, seconds = designed(scene.updated(**known, seed=seed))
    except NoEquilibriumError as caught:
        yield Row(*place, "worst", None, note=f"{State.MISSED}: {caught}")
        return
    told = [figure for figure in found.figures if figure.state is not None]
    yield from figure_rows(place, told, round(seconds, 1))
    other = hasattr(found, "search") and found.search.seed != seed
    state = State.MISSED if other or largest_part(told) > 1 else overall(told)
    yield Row(*place, "worst", largest_part(told), seconds=round(seconds, 1), note=str(state))


def bend_rows(
    bend: tuple[int, int, int], given: int, seed: int, changes: Mapping[str, Any]
) -> Iterator[Row]:
    """Design a bend; its worst figure over its tolerance, its pressure and its print."""
    angle, length, diameter = bend
    scene = BendScene.of(
        angle=angle, length=1e-3 * length, diameter=1e-3 * diameter, neutral=5e-4 * diameter,
        pressure=1e3 * given, estimate_error=False, seed=seed,
    )  # fmt: skip
    found, seconds = designed(scene.coarse().updated(**changes))
    size = f"power {changes['power']:g}" if "power" in changes else ""
    variant = f"{angle}° on {length} × {diameter} mm, {given} kPa, seed {seed}"
    place = ("bends", f"{variant}, {size}" if size else variant, size)
    off = [
        abs(one.miss) / max(one.tolerance, DEGREES if one.key == "angle_deg" else 0.0)
        for one in found.figures
        if one.miss is not None and one.tolerance is not None
    ]
    yield Row(*place, "worst", max(off, default=np.inf), seconds=round(seconds, 1))
    yield Row(*place, "pressure", found.pressure, "Pa")
    printed = sum(region.area for region in found.printed.regions)
    yield Row(*place, "printed_fraction", printed / float(found.printed.pattern.areas.sum()))


def kernel_rows(scene: str, seed: int, kernel: str, changes: Mapping[str, Any]) -> Iterator[Row]:
    """Design a coarse demo on one kernel type, which the environment sets."""
    place = ("kernels", f"{scene}, seed {seed}, {kernel}", "ranks 1")
    found, spent = designed(KINDS[scene]().coarse().updated(**changes, seed=seed))
    note = f"gmsh {gmsh.__version__}"
    yield Row(*place, "rounds", float(found.entries()["rounds"]))
    figure = found.value(FIGURES[scene])
    yield Row(*place, FIGURES[scene], figure, seconds=round(spent, 1), note=note)


def cases(quick: bool) -> list[Case]:
    """Return all designs; a quick selection takes few steps, and few of them."""
    found = [
        Case("products", partial(product_rows, title, seed, QUICK if quick else {}),
             f"{title}, seed {seed}", alone=True)
        for seed in (range(1, 2) if quick else SEEDS)
        for title in (["S of 60° and −60°"] if quick else PRODUCTS)
    ]  # fmt: skip
    found += [
        Case("poses", partial(pose_rows, title, seed, QUICK if quick else {}),
             f"{title}, seed {seed}", alone=True)
        for seed in (range(1, 2) if quick else POSE_SEEDS)
        for title in ([*POSES][:1] if quick else POSES)
    ]  # fmt: skip
    runs = [(bend, GIVEN, seed, {}) for seed in BEND_SEEDS for bend in BENDS]
    runs += [(one, p, seed, {}) for seed in BEND_SEEDS for p in OTHERS for one in OF_OTHERS]
    runs += [(bend, GIVEN, BEND_SEEDS[0], {"power": PAPER}) for bend in BENDS]
    if quick:
        runs = [(BENDS[5], GIVEN, 1, QUICK)]
    for bend, given, seed, changes in runs:
        of = f", power {PAPER:g}" if "power" in changes else ""
        variant = f"{bend[0]}° on {bend[1]} × {bend[2]} mm, {given} kPa, seed {seed}{of}"
        run = partial(bend_rows, bend, given, seed, changes)
        found.append(Case("bends", run, variant, alone=True))
    found += [
        Case("kernels", partial(kernel_rows, scene, seed, kernel, QUICK if quick else {}),
             f"{scene}, seed {seed}, {kernel}", alone=True,
             environment={"OPENBLAS_CORETYPE": kernel})
        for seed in (range(1, 2) if quick else BEND_SEEDS)
        for scene in (["contract"] if quick else FIGURES)
        for kernel in TYPES
    ]  # fmt: skip
    return found


def products_table(rows: Rows) -> str:
    """Return a line for each product: how often it reaches, by value and certainly; the worst."""
    return _reached([row for row in rows if row.case == "products"], "product", PRODUCTS)


def poses_table(rows: Rows) -> str:
    """Return a line for each pair of poses, as of products, and what one pose alone gives."""
    own = [row for row in rows if row.case == "poses"]
    both = [row for row in own if not row.figure.startswith("alone_")]
    table = _reached(both, "poses", POSES)
    alone: dict[str, list[Row]] = {}
    for row in own:
        if row.figure.startswith("alone_"):
            alone.setdefault(row.variant.rpartition(", seed ")[0], []).append(row)
    lines = []
    for title, of in alone.items():
        unit = of[0].unit
        values = [row.value for row in of if row.value is not None]
        ends = dict.fromkeys(formatted(end, unit, 3) for end in (min(values), max(values)))
        off = [float(row.note) for row in of]
        lines.append((title, " to ".join(ends), f"{min(off):.2g} to {max(off):.2g}"))
    head = ("poses", "figure of the second pose", "miss over its tolerance")
    beside = "Prints that were designed for the first pose alone, in the second:"
    return f"{table}\n\n{beside}\n\n{markdown(head, lines)}"


def _reached(of_case: Rows, name: str, titles: Iterable[str]) -> str:
    lines = []
    for title in titles:
        own = [row for row in of_case if row.variant.startswith(f"{title}, s")]
        own = [row for row in own if row.figure == "worst" or state_in(row)]
        ends = [row for row in own if row.figure == "worst"]
        if not ends:
            continue
        count = len(ends)
        values = [np.inf if row.value is None else row.value for row in ends]
        by_value = sum(map(_by_value, ends))
        certain = sum(row.note == State.REACHED for row in ends)
        shown = [
            _spread([figure_of(r) for r in own if r.figure == key])
            for key in dict.fromkeys(row.figure for row in own)
            if key != "worst"
        ]
        seconds = float(np.median([row.seconds or np.nan for row in ends]))
        worst = f"{max(values):.2g}" if np.isfinite(max(values)) else NONE
        counts = f"{by_value} of {count}", f"{certain} of {count}"
        lines.append((title, *counts, worst, "; ".join(shown), f"{seconds:.0f} s"))
    head = (name, "by value", "certain", "worst figure over its tolerance",
            "figures: least to largest, largest half-width", "median CPU time")  # fmt: skip
    return markdown(head, lines)


def products_in_short(rows: Rows) -> str:
    """Return in a sentence how many designs reach, and the products that do so least often."""
    ends = [row for row in rows if row.case == "products" and row.figure == "worst"]
    by_title: dict[str, list[Row]] = {}
    for row in ends:
        by_title.setdefault(row.variant.rpartition(", seed ")[0], []).append(row)
    reached = {title: sum(map(_by_value, own)) for title, own in by_title.items()}
    certain = sum(row.note == State.REACHED for row in ends)
    worst = sorted(by_title, key=lambda title: reached[title] / len(by_title[title]))
    often = "; ".join(
        f"{title}, {reached[title]} of {len(by_title[title])}"
        for title in worst
        if reached[title] < len(by_title[title])
    )
    return (
        f"From other seeds: of {len(ends)} coarse designs of {len(by_title)} products "
        f"{sum(reached.values())} reach all their targets by value, and {certain} certainly. Not "
        f"all of: {often}. [Table](demos/README.md#how-often-each-product-reaches-its-target)."
    )


def _by_value(row: Row) -> bool:
    return row.value is not None and row.value <= 1 and row.note != State.MISSED


def bends_table(rows: Rows) -> str:
    """Return a line for each bend and pressure that is given, and one for the power of 1."""
    ours = [row for row in rows if row.case == "bends" and not row.size]
    paper = [row for row in rows if row.case == "bends" and row.size]
    bends = dict.fromkeys(row.variant.rpartition(", ")[0] for row in ours)
    parts = {bend: [row for row in ours if row.variant.startswith(f"{bend},")] for bend in bends}
    if paper:
        parts["all eight, 15 kPa, power 1"] = paper
    lines = [_bend_line(title, part) for title, part in parts.items()]
    head = ("bend, pressure given", "reached", "worst figure over its tolerance", "takes",
            "printed", "median CPU time")  # fmt: skip
    return markdown(head, lines)


def _bend_line(title: str, own: Rows) -> tuple[str, ...]:
    values = {
        key: [row.value for row in own if row.figure == key and row.value is not None]
        for key in ("worst", "pressure", "printed_fraction")
    }
    worst, pressure, printed = values.values()
    seconds = [row.seconds for row in own if row.seconds is not None]
    ends = sorted({f"{1e-3 * end:.3g}" for end in (min(pressure), max(pressure))}, key=float)
    return (
        title, f"{sum(one <= 1 for one in worst)} of {len(worst)}",
        ", ".join(f"{one:.2f}" for one in worst), f"{' to '.join(ends)} kPa",
        f"{np.median(printed):.0%}", f"{np.median(seconds):.0f} s",
    )  # fmt: skip


def _spread(figures: list[Figure]) -> str:
    widths = [one.interval for one in figures if one.interval is not None]
    width = f", ± {formatted(max(widths), figures[0].unit, 2)}" if widths else ""
    return f"{figures[0].label} {_ends(figures)}{width}"


def _ends(figures: list[Figure]) -> str:
    values = [one.value for one in figures if one.value is not None]
    ends = sorted({min(values), max(values)}) if values else []
    told = dict.fromkeys(formatted(end, figures[0].unit, 3) for end in ends)
    return " to ".join(told) or NONE


def kernels_table(rows: Rows) -> str:
    """Return the spread of each scene's runs."""
    own = [row for row in rows if row.case == "kernels"]
    head = ("scene", "seeds, runs", "rounds", "least, median, largest figure",
            "kernels differ by at most", "CPU s: median, longest over it")  # fmt: skip
    lines = []
    for scene, key in FIGURES.items():
        runs = [row for row in own if row.figure == key and row.variant.startswith(f"{scene},")]
        if not runs:
            continue
        variants = {row.variant for row in runs}
        rounds = [r.value or 0 for r in own if r.figure == "rounds" and r.variant in variants]
        figure = np.array([row.value or np.nan for row in runs])
        spent = np.array([row.seconds or np.nan for row in runs])
        seeds = np.array([row.variant.split(", ")[1] for row in runs])
        apart = max(np.ptp(figure[seeds == seed]) for seed in seeds) / np.median(figure)
        three = (figure.min(), np.median(figure), figure.max())
        lines.append((
            scene, f"{len(set(seeds))}, {len(runs)}", f"{min(rounds):.0f} to {max(rounds):.0f}",
            f"{', '.join(f'{value:.4g}' for value in three)} (`{key}`)", f"{apart:.1g} of it",
            f"{np.median(spent):.0f}, {spent.max() / np.median(spent):.2f}",
        ))  # fmt: skip
    kernels = sorted({row.variant.rpartition(" ")[2] for row in own})
    about = f"OpenBLAS with the kernel types {' and '.join(kernels)}, "
    about += f"{next(row.note for row in own if row.note)}, {own[0].size}, one thread each."
    return f"{about}\n\n{markdown(head, lines)}"


COMMAND = Command(
    about=__doc__,
    cases=cases,
    serial=True,
    tables=(
        Table("../demos/README.md", "products from several seeds", products_table),
        Table("how_to/poses.md", "poses from several seeds", poses_table),
        Table("../README.md", "products in short", products_in_short),
        Table("optimisation.md", "bends and pressures", bends_table),
        Table("optimisation.md", "reproducible runs", kernels_table),
    ),
)
