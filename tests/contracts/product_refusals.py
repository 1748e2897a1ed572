"""Wrong words and units, and wrong input of tiles, skins of your own and tensile tests."""

# The types are wrong on purpose.
# mypy: disable-error-code="arg-type,call-overload,dict-item,list-item,misc"

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from helpers import surfaces
from helpers.own_skins import FINGER, OWN
from helpers.tensile_tests import synthetic
from helpers.tiles import printed_tile, solver_of, tile_of
from mpi4py import MPI

import toros_fem as tf
from contracts.refusals import INF, NAN, Scene, Table, each
from toros_fem import meshes as m
from toros_fem.base.keys import read_quantity
from toros_fem.base.validation import require_between, require_count, require_positive
from toros_fem.measures.regions import bend_between, length_between, twist_between
from toros_fem.meshes.files import PATTERN_FILE
from toros_fem.meshes.seams import remeshed
from toros_fem.meshes.surface import oriented
from toros_fem.products.common.options import FitOptions
from toros_fem.products.fitting.reading import Given
from toros_fem.products.fitting.samples import TensileTest
from toros_fem.products.gripper import GripperScene
from toros_fem.products.own_mesh import Held, OwnSkin, Plain, Printed, read_skin
from toros_fem.products.own_metrics import Expression, MetricTable, Region
from toros_fem.products.tiles.stiffness_profile import ALONG, Profile, ProfileSolver
from toros_fem.products.tubes import BendScene, SectionTubeScene

ALONE = MPI.COMM_SELF

# ---------------------------------------------------------------------------------- words

WORDS: Table = {
    **each(require_positive, {"b": 0.0}, {"a": NAN}, {"at_most": 0.9}, a=1.0),
    **{f"{a} between {low} and {high}": lambda s, low=low, high=high, a=a: require_between(
        low, high, a=a) for low, high, a in ((0, 1, 1.1), (0, INF, -1.0), (0, INF, INF))},
    **{f"a count of {a}": lambda s, a=a: require_count(2, a=a) for a in (1, 2.0)},
    **{f"condition {text[:20]}": lambda s, text=text: Expression(text) for text in (
        "", "z", "z < ", "z < 5 kPa", "w < 5 mm", " 1 mm < 2 mm and x", "z + (x > 0) > 1",
        "1 < x * y + 5 mm", "sqrt(x) > 0", "hypot(x) > 0", "(z < 1 mm", "__import__('os')",
        "x < True", "-" * 400 + "1 < 2")},
    **{f"{text} in {unit}": lambda s, given=(text, unit): read_quantity(*given)
       for text, unit in (
           ("5 mm", "Pa"), ("5 kPa", None), ("5", "Pa"), ("5 furlong", "m"), ("five mm", "m"),
           ("nan mm", "m"), ("1e999 m", "m"), ("5 %", "m"))},
    **each(MetricTable.from_words, {"text": "bnd of z > 1"}, {"text": "bend z > 1"},
           {"text": "bend of z > 1 kPa"}, {"text": "twist of z > 1 against q < 1"},
           {"text": "length of z > 1"}),
}  # fmt: skip

# ------------------------------------------------------------------------------- regions


def _some(s: Scene, count: int = 0) -> np.ndarray:
    """A region of the first vertices of a triangle."""
    here = np.zeros(len(s.pattern.points), dtype=bool)
    here[s.pattern.triangles[0, :count]] = True
    return here


FIVE = "v 0 0 0\nv .1 0 0\nv .1 .1 0\nv 0 .1 0\nv -.1 .05 0\n"
REGIONS: Table = {
    **{f"meshed anew by {edge}": lambda s, edge=edge: remeshed(ALONE, surfaces.long_tube(), edge)
       for edge in (0.0, 1e-6)},
    "a strip of one side": lambda s: oriented((np.arange(5)[:, None] + np.arange(3)) % 5),
    "a face of five corners": lambda s: m.read_surface(
        ALONE, s.file("five.obj", FIVE + "f 1 2 3 4 5\n")
    ),
    "a face of a line": lambda s: m.read_surface(ALONE, s.file("line.obj", FIVE + "f 1 2 2\n")),
    "the bend of a line": lambda s: bend_between(s.pattern, s.pattern.points, _some(s, 2)),
    "the twist of nothing": lambda s: twist_between(s.pattern, s.pattern.points, _some(s)),
    "the twist of indices": lambda s: twist_between(s.pattern, s.pattern.points, np.zeros(1)),
    "a length to itself": lambda s: length_between(
        s.pattern, s.pattern.points, _some(s, 2), _some(s, 2)
    ),
    "a region of nothing": lambda s: Region(where="z < -5").vertices(s.pattern),
    "a region of an unknown panel": lambda s: Region(panels="side").cells(s.pattern),
}  # fmt: skip

# ---------------------------------------------------------------------- skins of your own


def _read(path: Path = FINGER, **changes: Any) -> OwnSkin:
    return read_skin(ALONE, OWN.updated(**changes), path)


@cache
def _finger() -> OwnSkin:
    return _read()


def _own(**changes: Any) -> object:
    scene = replace(OWN.updated(**changes), read=_finger())
    return scene.case(ALONE, scene.finest_level)


def _flat_panels(s: Scene) -> Path:
    folder = s.folder / "flat"
    folder.mkdir(exist_ok=True)
    m.write_pattern(folder / PATTERN_FILE, _finger().pattern)
    return folder


SKINS: Table = {
    **each(_own, {"held": ()}, {"held": (Held(where="z < 5"),)},
           {"held": (Held(where="z < -5 mm"),)}, {"bend": None},
           {"plain": (Plain(where="z < 5 mm"),)},
           {"printed": (Printed(where="z < 1"),), "plain": ()}, {"begin": 0.1}, {"toward": "z"},
           {"metrics": "angle, size"}),
    **each(_read, {"held": (Held(where="y < 1 mm"),)}, {"twist": 40.0}, {"symmetry": "z"},
           {"knit_ratio": 2.0, "grain_angle": 30.0}, symmetry="y"),
    "a part of flat panels": lambda s: _read(_flat_panels(s), symmetry="y"),
    "flat panels meshed anew": lambda s: _read(_flat_panels(s), remesh=3e-3),
}  # fmt: skip

# --------------------------------------------------------------- tubes, walkers, grippers


def _half(planes: tuple[int, ...] = (1,), twisted: float = 0.0, **knit: float) -> object:
    scene = SectionTubeScene.of(length=0.06, edge_length=5e-3, filter_radius=8e-3, **knit)
    target = m.twist(twisted, 0.06)
    return scene.tube_case(ALONE, scene.finest_level, target, [], planes)


def _simulated(s: Scene, files: dict[str, Path], **changes: Any) -> object:
    scene = BendScene.of(length=0.06, edge_length=5e-3, filter_radius=8e-3, **changes)
    return scene.run_simulation(ALONE, s.folder / "simulated", files)


ACTUATORS: Table = {
    **each(_half, {"knit_ratio": 3.0, "grain_angle": 30.0}, {"twisted": 1.0}),
    "an orientation of -1 m": lambda s: BendScene.of(orientation_length=-1.0),
    "a simulation without pressure": lambda s: _simulated(s, {}, pressure=0.0),
    "a simulation of no print": lambda s: _simulated(s, {"pattern": s.folder / "nothing.npz"}),
    "a gripper of a short stem": lambda s: GripperScene.of(stem_length=0.01),
    "a gripper of a speck": lambda s: _gripped(GripperScene.of(size=1e-3)),
}


def _gripped(scene: GripperScene) -> object:
    return scene.case(ALONE, scene.finest_level)


# ---------------------------------------------------------------------------------- tiles

ONES, SOME = np.ones(3), np.array([True, False])


def _folding(bending: tf.Bending | None) -> object:
    return solver_of(tile_of(3), tf.Composite(bending=bending), flat=False)


def _stretched(angle: float = 0.0, gradient: Any = ALONG, density: float = 0.0) -> object:
    solver = solver_of(tile_of(3))
    load = tf.Load(gradient=gradient, angle=angle)
    return solver.solve(np.full(len(solver.skin.owned_cells), density), load)


def _profiled(angles: Any = (0.0,), strain: float = 0.1) -> ProfileSolver:
    return ProfileSolver(solver_of(tile_of(3)), angles, strain)


def _profile() -> Profile:
    """A profile of two directions, without states."""
    two = np.ones(2)
    return Profile(0 * two, 0.1, two, two, two, two, (None,) * 2, (None,) * 2, 0, 0)


TILES: Table = {
    **each(_folding, {"bending": None}, {"bending": tf.Bending(seams="hinged")},
           {"bending": tf.Bending(rest="assembled")}),
    **each(_stretched, {"angle": INF}, {"density": -0.1}, {"gradient": 1.1}),
    **{f"a tile by {name}": lambda s, given=given: _stretched(gradient=given)
       for name, given in {"2 × 2": np.eye(2), "3 × 3": np.eye(3), "NaN": NAN * ALONG}.items()},
    **each(_profiled, {"strain": 0.0}, {"strain": -1.0}, {"strain": NAN}, {"strain": INF}),
    "a printed tile bends": lambda s: replace(printed_tile(), composite=tf.Composite()),
    "a printed tile has a bladder": lambda s: replace(printed_tile(), composite=tf.Composite(
        bending=None, bladder=tf.Bladder(1e6, 1e-4))),
}  # fmt: skip

# ----------------------------------------------------------------------------------- fits

PULL = np.linspace(0, 1, 6)


def _test(direction: str = "", **changes: Any) -> TensileTest:
    given = {"stretch": 1 + PULL / 2, "stress": PULL, "thickness": 1e-3, "direction": direction}
    return TensileTest(**{**given, **changes})


FITS: Table = {
    "three points of a test": lambda s: _test(stretch=np.ones(3)),
    "stresses of other points": lambda s: _test(stress=np.ones(4)),
    "a stretch below 0": lambda s: _test(stretch=np.linspace(-1, 1, 6)),
    "stresses that are NaN": lambda s: _test(stress=np.full(6, NAN)),
    "a second branch": lambda s: _test().branch("second"),
    **each(Given, {"units": {"force": "lb"}}, {"units": {"time": "s"}}),
    "a fit of no test": lambda s: tf.fit_material([]),
    "a fit of two points": lambda s: tf.fit_material([synthetic()], FitOptions(up_to=1.05)),
    "a fit of skew tests": lambda s: tf.fit_material([_test("0"), _test("45")]),
    "a fit of two directions without a common strain": lambda s: tf.fit_material(
        [_test("course"), _test("wale", stretch=np.linspace(1.6, 1.7, 6))]
    ),
    "a fit of a pushed strip": lambda s: tf.fit_material([_test(stress=-PULL)]),
}  # fmt: skip

PRODUCTS: Table = WORDS | REGIONS | SKINS | ACTUATORS | TILES | FITS
