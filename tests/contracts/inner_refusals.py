"""Wrong input of what lies below the public entries; golden/refusals.csv has these errors too."""

# The types are wrong on purpose.
# mypy: disable-error-code="arg-type,call-arg,call-overload,dict-item,list-item"
# mypy: disable-error-code="misc,operator,return-value,union-attr"

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import shapely
from helpers import surfaces
from helpers.lines import even_field
from helpers.models import line_design
from helpers.objectives import tube_sections
from helpers.panels import pattern_of
from helpers.scenes import square
from mpi4py import MPI

import toros_fem as tf
from contracts.product_refusals import PRODUCTS
from contracts.refusals import (
    INF,
    NAN,
    SQUARE,
    Scene,
    Table,
    _material,
    _metric,
    _pattern,
    _solver,
    each,
)  # fmt: skip
from toros_fem import meshes as m
from toros_fem.design.density.filters import cone_filter, make_filter
from toros_fem.design.density.length_scale import (
    LengthScale,
    LengthScaleConstraints,
    threshold_for_width,
)
from toros_fem.design.density.projection import Projection
from toros_fem.design.lines import laid_lines
from toros_fem.design.lines.field import LineField, LineOptions
from toros_fem.design.lines.laid_lines import LaidLines, LineChange
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.design.mma.optimizer import MMA, Functions
from toros_fem.making.layout import nest
from toros_fem.making.marks import sewn_seams
from toros_fem.making.panel_drawing import panel_drawings
from toros_fem.making.printability import PrintLimits, regions_on
from toros_fem.measures.cross_sections import (
    CrossSectionObjective,
    CrossSections,
    label_cross_sections,
)
from toros_fem.measures.miss import AlignedObjective
from toros_fem.measures.regions import Body, body_axis
from toros_fem.measures.shape import ShapeObjective
from toros_fem.mechanics.contact.bodies import Ground, RigidBody
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.sliding import Pads
from toros_fem.mechanics.contact.solids import rigid_box, rigid_cylinder, rigid_sphere
from toros_fem.mechanics.paths.arc_length import ArcLengthOptions
from toros_fem.mechanics.readings.holding import HoldingObjective
from toros_fem.mechanics.readings.wrinkles import wrinkles
from toros_fem.mechanics.skin.chambers import Chambers, chambers_of_panels, find_walls
from toros_fem.mechanics.skin.dead_loads import point_force, spread_force
from toros_fem.mechanics.skin.designs import LineDesign
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Planes, Supports, build_in, clamp, symmetry_plane
from toros_fem.mechanics.terms.model import SkinModel, make_model
from toros_fem.meshes import Pattern, cylinder, mirrored, moulded, tile
from toros_fem.meshes.border_mesh import bordered
from toros_fem.meshes.transfer import make_transfer

ALONE = MPI.COMM_SELF


# ------------------------------------------------------------------------------ materials

SOFT = tf.Material(1e5, 0.3, 5e-4)
ENTRIES = each(
    _material, {"name": "my jersey"}, {"name": 3}, {"kind": "cloth"}, {"title": ""},
    {"source": "a\nb"}, {"young": 0}, {"poisson": 0.6}, {"stretch_range": (1.1, 1.5)},
    {"stretch_range": 1.5}, {"c1": 1.4}, {"c2": 1.0}, {"with_fabric": True}, {"with_fabric": 1},
    {"kind": "rubber", "poisson": 0.5, "knit_ratio": 2.0}, {"kind": "rubber", "poisson": 0.4},
    {"kind": "rubber", "poisson": 0.5, "c1": 3.0},
)  # fmt: skip
MATERIALS: Table = {
    **each(tf.Material, {"thickness": 0.0}, {"c1": 1.0}, {"c2": "2"}, {"poisson": 0.6},
           young=1e5, poisson=0.3, thickness=5e-4),
    **each(tf.Composite, {"c2": 0.5}, {"c1": INF}, {"bending": False}, {"bladder": 1e5},
           {"knit": 3.0}, {"print_side": "left"}, {"print_side": "inside", "bending": None},
           {"print_side": "inside", "membrane": tf.Membrane("tension-field")},
           {"print_offset": 0.0}),
    "a tension field of crossed bounds": lambda s: tf.Composite(
        SOFT, replace(SOFT, c1=1.2, c2=1.1), membrane=tf.Membrane("tension-field")
    ),
    **each(tf.Material.from_lame, {"mu": 0.0}, {"lam": 2.1}, mu=1.0, lam=1.0, thickness=1e-3),
    **each(tf.Bending, {"seams": "glued"}, {"rest": "round"}),
    **each(tf.Bladder, {"thickness": 0.0}, young=1e5),
    **each(tf.Knit, {"ratio": 0.5}, {"grain": INF}, {"grain": {"base": 0.0, "wall": NAN}},
           ratio=3.0),
    "grain of some panels": lambda s: _knitted(s, {"wall": 0.0}),
    "grain of an unknown panel": lambda s: _knitted(s, {"wal": 0.0}),
}  # fmt: skip


def _knitted(s: Scene, grain: dict[str, float]) -> SkinModel:
    return make_model(s.skin, tf.Composite(bending=None, knit=tf.Knit(3.0, grain)), s.held)


# --------------------------------------------------------------------------------- meshes

TWO = np.array([[0, 0], [1, 0], [0, 1], [3, 0], [4, 0], [3, 1]], dtype=float)
ELL = np.array([[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.05], [0, 0.05]])
SHEET = square()


@cache
def half() -> Pattern:
    return cylinder(ALONE, 0.03, 0.02, 5e-3, mesh="structured", planes=(1,))


@cache
def tube(caps: str | None = None) -> Pattern:
    return cylinder(ALONE, 0.03, 0.02, 6e-3, mesh="structured", caps=caps)


@cache
def ball() -> Pattern:
    """A moulded skin."""
    made = surfaces.sphere(1)
    return moulded(made.points, made.triangles)


def changed(array: np.ndarray, at: Any, value: Any) -> np.ndarray:
    """A copy with other values in a place."""
    out = array.copy()
    out[at] = value
    return out


def _sewn(flat: np.ndarray, sewn: list[int]) -> Pattern:
    """Triangles of their own panels, sewn at vertices."""
    count = len(flat) // 3
    return Pattern(flat, np.arange(3 * count).reshape(-1, 3), np.arange(count), np.array(sewn),
                   np.eye(max(sewn) + 1, 3), tuple("abc"[:count]))  # fmt: skip


def _collapsed() -> np.ndarray:
    return changed(SHEET.flat_points, 0, (SHEET.flat_points[1] + SHEET.flat_points[5]) / 2)


def _large_cap() -> Pattern:
    whole = tube("both")
    cap = np.unique(whole.flat_triangles[whole.cells_of("tip")])
    return replace(
        whole, flat_points=changed(whole.flat_points, cap, 1.01 * whole.flat_points[cap])
    )


PATTERNS: Table = {
    "a flat point is NaN": lambda s: _pattern(
        s, flat_points=changed(SHEET.flat_points, (7, 1), NAN)
    ),
    "a flat triangle has no area": lambda s: _pattern(s, flat_points=_collapsed()),
    "a vertex is sewn to a neighbour": lambda s: _pattern(s, sewn=changed(SHEET.sewn, 1, 0)),
    "a triangle has a vertex twice": lambda s: _pattern(
        s, sewn=np.maximum(SHEET.sewn - 1, 0), points=SHEET.points[1:]
    ),
    "a triangle runs clockwise": lambda s: _pattern(
        s, flat_triangles=changed(SHEET.flat_triangles, 3, SHEET.flat_triangles[3, ::-1])
    ),
    "a seam is sewn the wrong way": lambda s: _sewn(TWO, [0, 1, 2, 0, 1, 3]),
    "three triangles meet at an edge": lambda s: _sewn(
        np.vstack([TWO, TWO[:3] + [6, 0]]), [0, 1, 2, 1, 0, 3, 0, 1, 4]
    ),
    "a vertex pinches": lambda s: _sewn(TWO, [0, 1, 2, 0, 3, 4]),
    "sides of a seam differ": lambda s: _large_cap(),
    "panels share a point": lambda s: _pattern(s, panel=np.arange(32) > 4, panel_names=("a", "b")),
    "a panel has no triangle": lambda s: _pattern(s, panel_names=("a", "b")),
    "a sheet is no closed skin": lambda s: SHEET.require_closed(),
}

BALL = surfaces.sphere(1)
SURFACES: Table = {
    "three triangles of a surface at an edge": lambda s: m.Surface(
        np.vstack([np.eye(3), [[0, 0, 0], [1, 1, 1]]]), [[0, 1, 2], [1, 0, 3], [0, 1, 4]]
    ),
    "a surface faces inwards": lambda s: replace(BALL, triangles=BALL.triangles[:, ::-1]),
    "a seam of a surface is elsewhere": lambda s: replace(BALL, seams=np.array([[0, 99]])),
    "a thin triangle": lambda s: m.Surface([[0, 0, 0], [1, 0, 0], [0.5, 1e-7, 0]], [[0, 1, 2]]),
    "a strip that pinches": lambda s: m.Surface(
        surfaces.sphere(0).points[:6], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4], [4, 5, 0]]
    ),
    "two surfaces in one": lambda s: m.Surface(
        np.vstack([np.eye(3), 3 + np.eye(3)]), np.arange(6).reshape(2, 3)
    ),
    "a seam that is no edge": lambda s: m.unwrap(ALONE, surfaces.prism(), [[0, 1], [0, 30]]),
    "seams are no pairs": lambda s: m.unwrap(ALONE, surfaces.prism(), [0, 1]),
    "a cap is not developable": lambda s: m.unwrap(ALONE, surfaces.cap(4, 1.0)[0], method="exact"),
    "unwrapped by the best": lambda s: m.unwrap(ALONE, surfaces.prism(), method="best"),
    "unwrapped without stretch": lambda s: m.unwrap(ALONE, surfaces.prism(), max_stretch=0),
}
MAKERS: Table = {
    **each(cylinder, {"planes": (0,)}, {"planes": (2,)}, {"planes": (1, 1)}, {"planes": (1, 2)},
           comm=ALONE, length=0.06, diameter=0.02, edge_length=5e-3),
    **each(m.disc, {"edge_length": 0.02}, comm=ALONE, radius=0.01),
    **each(tile, {"mesh": "right", "symmetry": "orthotropic"}, {"symmetry": "chiral"},
           {"symmetry": "tetragonal"}, {"mesh": "equilateral"}, {"symmetry": "cubic"},
           {"edge_length": 0.0081}, {"size": (0.03, -0.02)},
           comm=ALONE, size=(0.03, 0.02), edge_length=3e-3),
    "maps of an unknown symmetry": lambda s: _tile().symmetry_maps("cubic"),
    "tetragonal maps of an oblong tile": lambda s: _tile().symmetry_maps("tetragonal"),
    "chiral maps of a tile of right triangles": lambda s: tile(
        ALONE, 0.02, 3e-3, "right"
    ).symmetry_maps("chiral"),
    "a tile repeated 0 times": lambda s: _tile().repeated(2, 0),
    "a sheet of 1.5 tiles": lambda s: _tile().sheet(1.5, 1),
}  # fmt: skip


def _tile() -> m.Tile:
    return tile(ALONE, (0.03, 0.02), 3e-3)


def _star(**changes: Any) -> m.Star:
    return replace(m.WALKER, **changes)


OUTLINES: Table = {
    **each(_star, {"arm_length": 0.01}, {"arm_width": 0.05}, {"arms": 1}),
    "an outline that its plane does not mirror": lambda s: m.two_panels(
        ALONE, ELL, 4e-3, planes=(1,)
    ),
    "a line ends inside": lambda s: _lined((0, 0), (0.01, 0.01)),
    "a line misses the outline": lambda s: _lined((1, 0), (1, 1)),
    "a line leaves a thin face": lambda s: _lined((-1, 0.03995), (1, 0.03995)),
    "edges are longer than the outline is wide": lambda s: m.two_panels(ALONE, SQUARE, 0.05),
    "arcs do not fit a side": lambda s: m.rounded(ELL, 0.011),
    "2 radii for 6 corners": lambda s: m.rounded(ELL, [1e-3, 1e-3]),
    **each(m.curl, {"toward": (1, 1, 0)}, {"along": (0, 0, 0)},
           angle=1.0, length=0.1, origin=(0, 0, 0), along=(1, 0, 0), toward=(0, 1, 0)),
    **each(m.stand, {"directions": "3 of them"}, {"root": 0.0},
           angle=1.0, length=0.1, directions=np.eye(2), root=0.02),
    "directions in space": lambda s: m.stand(1.0, 0.1, directions=np.eye(2, 3), root=0.02),
    "nothing to mirror": lambda s: mirrored(half(), (0,)),
    "mirrored across axis 3": lambda s: mirrored(half(), (3,)),
    "edges along borders of length 0": lambda s: bordered(
        ALONE, s.pattern, s.pattern.outlines, 0.0
    ),
    "borders of a moulded skin": lambda s: bordered(
        ALONE, moulded(s.pattern.points, s.pattern.triangles), []
    ),
    "2 regions on 3 panels": lambda s: bordered(ALONE, s.pattern, [shapely.Polygon()] * 2),
    "transfer between other panels": lambda s: make_transfer(s.pattern, SHEET),
    "transfer to a wider wall": lambda s: make_transfer(
        s.pattern, cylinder(ALONE, 0.06, 0.02, 7e-3, mesh="structured")
    ),
    "transfer from a square to a disc": lambda s: make_transfer(
        m.rectangle(ALONE, 0.02, 0.02, 3e-3, "right"), m.disc(ALONE, 0.01, 3e-3)
    ),
    "transfer between moulded skins": lambda s: make_transfer(ball(), ball()),
    "cone filter of a moulded skin": lambda s: make_filter("cone", m.sew(ALONE, ball()), 0.01),
    "grain of a moulded skin": lambda s: make_model(
        m.sew(ALONE, ball()), tf.Composite(knit=tf.Knit(2.0)), tf.pin(ball())
    ),
    "lines on a moulded skin": lambda s: lay_lines(even_field(ball(), [0.3], [0.0])),
    "seams of a moulded skin": lambda s: sewn_seams(ball()),
}  # fmt: skip


def _lined(*line: tuple[float, float]) -> Pattern:
    return m.two_panels(ALONE, SQUARE, 4e-3, lines=[((-1, 0.02), (1, 0.02)), line])


# ------------------------------------------------------------------------------ mechanics

CRATE = rigid_box("crate", (1.0, 1.0, 1.0), edge_length=1.0)
CARD = rigid_box("card", (0.05, 0.05, 3e-4), edge_length=0.01)
SOME = np.array([True, False])


def _dish() -> RigidBody:
    """A ring with a thick rim and a thin web: no triangle turns over, but the web's sides cross."""
    turn = 2 * np.pi * np.arange(24) / 24
    height = np.sin(turn) * (1.5e-4 + 6e-3 * np.cos(turn) ** 2)
    points = surfaces.turned(0.03 + 0.01 * np.cos(turn), height, 16)
    return RigidBody("dish", points, surfaces.rings(24, 16, closed=True))


BODIES: Table = {
    **each(rigid_sphere, {"radius": -1}, {"centre": (0, 0)}, {"edge_length": 1e-6},
           name="ball", radius=1),
    **each(rigid_box, {"size": (1, 0, 1)}, name="box"),
    **each(rigid_cylinder, {"axis": (0, 0, 0)}, {"length": 0}, name="rod", radius=1, length=1),
    "a body that is half free": lambda s: replace(CRATE, free=0.5),
    "a body with a border": lambda s: replace(CRATE, triangles=CRATE.triangles[1:]),
    "a body's point is NaN": lambda s: replace(CRATE, points=changed(CRATE.points, 0, NAN)),
    "a flat body": lambda s: replace(CRATE, points=CRATE.points * [1, 1, 1e-7]),
    "a body of quads": lambda s: replace(CRATE, triangles=np.zeros((2, 4), dtype=np.int64)),
    "a body's triangle is elsewhere": lambda s: replace(CRATE, triangles=np.array([[0, 1, 99]])),
    "a body's triangle is turned": lambda s: replace(
        CRATE, triangles=changed(CRATE.triangles, 3, CRATE.triangles[3, ::-1])
    ),
    "a pose of three numbers": lambda s: CRATE.moved(np.zeros(3)),
    "a card thinner than its inset": lambda s: CARD.inset(2e-4),
    "a dish thinner than its inset": lambda s: _dish().inset(2e-4),
    "pads slide worse forward": lambda s: Pads(SOME, forward=0.9),
    "pads without direction": lambda s: Pads(SOME, (0.0, 0.0, 0.0)),
    "pads without ground": lambda s: Contact(friction=0.5, pads=Pads(SOME)),
    "pads without friction": lambda s: Contact(ground=Ground(), pads=Pads(SOME)),
}  # fmt: skip
SIDE = build_in(SHEET, SHEET.points[:, 0] < 1e-9)
FIXED = np.zeros(SHEET.points.shape, dtype=bool)


def _on_sheet(supports: Supports, composite: tf.Composite | None = None) -> object:
    return tf.EquilibriumSolver(m.sew(ALONE, SHEET), composite or tf.Composite(), supports)


def _between(planes: tuple[float, ...]) -> Supports:
    """Fix an open tube between planes across it."""
    supports = Supports(changed(np.abs(tube().points) < 1e-9, (0, 0), True))
    for height in planes:
        supports |= symmetry_plane(tube(), 2, height)
    return supports


def _parted(pattern: Pattern, axis: int, at: float = 0.0) -> Chambers:
    middle = pattern.points[pattern.triangles].mean(axis=1)
    return Chambers(("a", "b"), (middle[:, axis] > at).astype(int))


SUPPORTS: Table = {
    "built in where no border is": lambda s: build_in(SHEET, np.zeros(25, dtype=bool)),
    "guides of other normals": lambda s: Supports(FIXED, np.zeros((2, 2), int), np.ones((1, 3))),
    "guides along their edge": lambda s: _on_sheet(
        Supports(SIDE.fixed, SIDE.guided, np.ones(SIDE.normals.shape))
    ),
    "a sheet turns about its hinge": lambda s: _on_sheet(SIDE, tf.Composite(bending=None)),
    "a guide inside": lambda s: _on_sheet(
        SIDE | Supports(SIDE.fixed, np.array([[6, 7]]), np.ones((1, 3)))
    ),
    "displacements of another pattern": lambda s: Supports(FIXED, displacement=np.zeros((2, 3))),
    "a line cannot be pinned": lambda s: tf.pin(square(SHEET.points * [1, 0, 0])),
    "no border in a plane": lambda s: symmetry_plane(half(), 0),
    "no border at a height": lambda s: symmetry_plane(tube(), 2, 0.01),
    "a plane at NaN": lambda s: symmetry_plane(tube(), 2, NAN),
    "half a tube without its plane": lambda s: tf.EquilibriumSolver(
        m.sew(ALONE, half()), tf.Composite(bending=None), clamp(half(), ["base"])
    ).solve(np.zeros(len(half().panel)), 1e3),
    "a border leaves its plane": lambda s: tf.EquilibriumSolver(
        m.sew(ALONE, tube()), tf.Composite(bending=None), _between((0, 0.03))
    ).solve(np.zeros(len(tube().panel)), Load(1e3, displacement=np.where(
        symmetry_plane(tube(), 2).fixed, 1e-3, 0.0))),
    "chambers along a tube between planes": lambda s: make_model(
        m.sew(ALONE, tube()), tf.Composite(), _between((0, 0.03)), chambers=_parted(tube(), 0)
    ),
    "a panel in no chamber": lambda s: chambers_of_panels(s.pattern, {"a": ["base", "wall"]}),
    "a panel in two chambers": lambda s: chambers_of_panels(
        s.pattern, {"a": ["base", "tip"], "b": ["wall", "tip"]}
    ),
    "two chambers of a name": lambda s: Chambers(("a", "a"), np.array([0, 1])),
    "walls of another pattern": lambda s: find_walls(
        s.pattern, Chambers(("a", "b"), np.array([0, 1])), Planes(s.pattern, s.held)
    ),
    "four chambers at a vertex": lambda s: find_walls(
        s.pattern, _four(s.pattern), Planes(s.pattern, s.held)
    ),
    "chambers of an open tube": lambda s: find_walls(
        tube(), _parted(tube(), 0), Planes(tube(), clamp(tube(), ["wall"]))
    ),
    "3 pressures for 2 chambers": lambda s: _solver(s, chambers=_parted(s.pattern, 2, 0.02)).solve(
        s.plain, (1e3, 1e3, 1e3)
    ),
    "a pressure of two is negative": lambda s: _solver(
        s, chambers=_parted(s.pattern, 2, 0.02)
    ).solve(s.plain, (1.0, -2.0)),
    "the displacement of a load is flat": lambda s: s.solver.solve(
        s.plain, Load(1.0, displacement=np.zeros((3, 3)))
    ),
    "poses without bodies": lambda s: s.solver.solve(s.plain, Load(1.0, poses=np.zeros((1, 6)))),
    "a fabric of negative weight": lambda s: tf.Weight(-1.0, 1.0),
    "a force is infinite": lambda s: spread_force(s.pattern, "tip", [1.0, INF, 0.0]),
    "a force on an unknown panel": lambda s: spread_force(s.pattern, "top", [1.0, 0.0, 0.0]),
    **{f"a force at {name}": lambda s, given=given: point_force(s.pattern, *given)
       for name, given in {
           "another place of the panel": ([0.1, 0.0], [0, 0, 1], "tip"),
           "a flat place": ([0.0, 0.0], [0, 0, 1]),
           "the tip is NaN": ([0.0, 0.0], [0, NAN, 1], "tip"),
           "a place of an unknown panel": ([0.0, 0.0], [0, 0, 1], "top"),
       }.items()},
}  # fmt: skip


def _four(pattern: Pattern) -> Chambers:
    """Sectors that meet at the middle of the base, under a tip of its own."""
    x, y, _ = pattern.points[pattern.triangles].mean(axis=1).T
    of_cell = ((np.arctan2(y, x) + np.pi) / (2 * np.pi) * 3).astype(int)
    return Chambers(tuple("abcd"), changed(of_cell, pattern.cells_of("tip"), 3))


def _lines(s: Scene, at: tuple[int, int] | None = None, value: float = 0.0) -> None:
    """Check a design of two families, one of whose numbers is another."""
    model = LineDesign(s.skin, tf.Composite(bending=None), 2)
    design = line_design(s.skin, 2, 1)
    model.check(design)
    model.check(design[:, :-1] if at is None else changed(design, at, value))


def _with_lines(s: Scene, **given: Any) -> tf.EquilibriumSolver:
    return _solver(s, design=partial(LineDesign, families=2), **given)


SOLVES: Table = {
    "line families of a tension field": lambda s: _with_lines(
        s, composite=tf.Composite(bending=None, membrane=tf.Membrane("tension-field"))
    ),
    "lines at a density of 1.2": lambda s: _lines(s, (7, 0), 1.2),
    "a start beyond the bounds": lambda s: s.solver.solve(
        s.plain, 1e3, start=3 * s.solver.model.assembled
    ),
    "a path by volume": lambda s: tf.trace(s.solver, s.plain, 1e3, by="volume"),
    "an arc length by pressures": lambda s: tf.trace(
        s.solver, s.plain, [1e3], options=ArcLengthOptions()
    ),
    "an arc length without load": lambda s: tf.trace(s.solver, s.plain, 0.0, by="arc-length"),
    "an arc length into vacuum": lambda s: tf.trace(s.solver, s.plain, -1.0, by="arc-length"),
    "an arc length of no density": lambda s: tf.trace(
        s.solver, s.plain - 1, 1e3, by="arc-length"
    ),
    "wrinkles of a plain sheet": lambda s: wrinkles(
        SHEET, tf.Composite(), np.zeros(32), SHEET.points
    ),
    "nothing to hold": lambda s: HoldingObjective(
        s.skin, Contact(), Contact().sizes(tf.Composite()), s.held.fixed, [0.0, 0.0, 1.0], 1.0
    ),
}  # fmt: skip


# ------------------------------------------------------------------------------- measures


def _goal(s: Scene, **changes: Any) -> CrossSections:
    return replace(tube_sections(s.skin), **changes)


def _shape(s: Scene, target: Any = None, **more: Any) -> ShapeObjective:
    return ShapeObjective(s.skin, s.pattern.points if target is None else target, **more)


MEASURES: Table = {
    "sections of two vertices": lambda s: CrossSections(
        np.array([0, 0, 1]), np.ones((2, 3)), np.ones(2)
    ),
    "places of other sections": lambda s: _goal(s, position_weights=np.ones((2, 3))),
    "sections of negative weight": lambda s: _goal(s, position_weights=-np.ones((6, 3))),
    "sections of another skin": lambda s: CrossSectionObjective(
        s.skin, s.pattern.points, _goal(s, labels=tube_sections(s.skin).labels[:-1])
    ),
    "a short target of sections": lambda s: CrossSectionObjective(
        s.skin, s.pattern.points[1:], _goal(s)
    ),
    "no section": lambda s: label_cross_sections(
        s.pattern, s.pattern.vertices_of("wall"), (0, 0, 1), 0
    ),
    "a target vertex is NaN": lambda s: _shape(s, changed(s.pattern.points, 3, NAN)),
    "weights of two components": lambda s: _shape(s, weights=np.ones((len(s.pattern.points), 2))),
    "relative weights are negative": lambda s: _shape(
        s, relative=-np.ones(len(s.pattern.points))
    ),
    "all weights are 0": lambda s: _shape(s, weights=np.zeros(len(s.pattern.points))),
    "a line has no orientation": lambda s: AlignedObjective(
        s.skin, s.pattern.points * [0, 0, 1], _shape(s)
    ).forward(s.pattern.points * [0, 0, 1]),
    "a body like an egg": lambda s: Body("egg", 0.04, (0.0, 0.0, 0.0)),
    "a metric of two words": lambda s: _metric(1.0, "two words"),
    **{f"an axis {name}": lambda s, given=given: body_axis(s.pattern, *given)
       for name, given in {
           "along itself": ("z", "-z", 0.0, None), "that ends first": ("z", "x", 0.03, 0.02),
           "beyond the body": ("z", "x", 0.0, 0.2),
       }.items()},
}  # fmt: skip

# --------------------------------------------------------------------------------- design


def _changed(lines: LaidLines, widths: tuple[int, int], warp: int, by: float = 0.0) -> LaidLines:
    return laid_lines.changed(lines, LineChange(np.full(widths, by), np.zeros(warp, complex)))


def _field() -> LineField:
    return even_field(SHEET, [0.2, 0.2], [0.0, 90.0])


def _mma(**more: Any) -> MMA:
    return MMA(ALONE, np.zeros(2), np.ones(2), **more)


def _stepped() -> MMA:
    """Two residuals, one step in."""
    mma, x = _mma(residuals=2), np.ones(2)
    mma.step(x, Functions(0.0, x, residuals=[1.0, 2.0], residual_jacobian=[x, x]))
    return mma


ONES = np.ones(2)
DESIGNS: Table = {
    **each(Projection, {"beta": 0.0}, {"eta": 1.5}),
    "a cone around a tile": lambda s: cone_filter(s.skin, 0.012, beyond=0.02 * np.eye(2)),
    "a cone of radius -1": lambda s: cone_filter(s.skin, -1.0),
    **{f"{name} lines of 3 radii": lambda s, name=name: threshold_for_width(name, 3.0)
       for name in ("cone", "helmholtz")},
    "lines of 10 cm": lambda s: _widths(s, True, line_width=0.1),
    "2 widths for 3 families": lambda s: LineOptions(widths=(4e-3, 1e-3)).width_of(0, 3),
    "1 spacing for 2 families": lambda s: LineOptions(spacings=(0.02,)).width_of(0, 2),
    "3 widths for 2 families": lambda s: lay_lines(_field(), LineOptions(widths=(1, 1, 2))),
    "print on other triangles": lambda s: lay_lines(_field(), printed=np.zeros(3, dtype=bool)),
    "a change of no line": lambda s: _changed(
        lay_lines(even_field(SHEET, [0.2], [90.0]), printed=np.ones(32, bool)), (1, 1), 1
    ),
    "2 levels with 3 sets of options": lambda s: tf.optimize_levels(
        [s.design] * 2, [tf.DesignOptions((tf.Stage(1),))] * 3, seed=1
    ),
    "a move of 0": lambda s: _mma(move=np.array([0.5, 0.0])),
    "a move of 1.5": lambda s: _mma(move=np.array([0.5, 1.5])),
    "a move of NaN": lambda s: _mma(move=np.array([0.5, NAN])),
    "a step without residuals": lambda s: _mma(residuals=2).step(ONES, Functions(0.0, ONES)),
    "a retry with one residual": lambda s: _stepped().retry(ONES, Functions(0.0, residuals=[1.0])),
    "a retry with three residuals": lambda s: _stepped().retry(
        ONES, Functions(0.0, residuals=[1.0, 2.0, 3.0])
    ),
    "a check without residuals": lambda s: _stepped().conservative(ONES, Functions(0.0)),
    "a retry with values": lambda s: _stepped().retry(ONES, Functions(0.0, values=[0.0] * 4)),
    "a residual without constraints": lambda s: _mma(constraints=1).kkt_residual(
        ONES, Functions(0.0, ONES)
    ),
}  # fmt: skip


def _widths(s: Scene, designed: bool, **more: Any) -> LengthScaleConstraints:
    made = make_filter("cone", s.skin, 0.012)
    everywhere = np.full(len(s.skin.owned_cells), designed)
    return LengthScaleConstraints(s.skin, made, LengthScale(**more), everywhere)


# --------------------------------------------------------------------------------- making

CAP = shapely.box(0, 0, 0.02, 0.02)
STRIP = shapely.affinity.rotate(shapely.box(0, 0, 0.22, 0.02), 37)
MAKING: Table = {
    **{
        f"a pattern into {name}": lambda s, name=name: m.write_pattern(s.folder / name, SHEET)
        for name in ("abc", "pattern.json")
    },
    **each(PrintLimits, {"gap": 0}),
    "1 region for 2 panels": lambda s: panel_drawings(pattern_of("finger"), [shapely.Polygon()]),
    "2 regions for 3 panels": lambda s: regions_on(s.pattern, [CAP] * 2, s.pattern),
    "regions on other panels": lambda s: regions_on(s.pattern, [CAP] * 3, tube()),
    "a wall wider than the bed": lambda s: nest(
        {"cap": CAP, "wall": shapely.box(0, 0, 0.3, 0.2)}, (0.25, 0.21), gap=2e-3, margin=0.01
    ),
    "a strip across its grain": lambda s: nest(
        {"strip": STRIP}, (0.25, 0.08), gap=2e-3, margin=0.01, grain=np.pi / 2
    ),
}

INNER: Table = (
    MATERIALS | ENTRIES | PATTERNS | SURFACES | MAKERS | OUTLINES | BODIES | SUPPORTS | SOLVES
    | MEASURES | DESIGNS | MAKING | PRODUCTS
)  # fmt: skip
