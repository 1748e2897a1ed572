"""Wrong input of every public entry: a call each, whose error golden/refusals.csv has.

`ON_RANKS` are those in which ranks might go apart: several ranks try them too.
"""

# The types are wrong on purpose.
# mypy: disable-error-code="arg-type,call-arg,call-overload,dict-item,list-item"
# mypy: disable-error-code="operator,return-value"

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from helpers.designs import case_of, problem_of, shape_design
from helpers.scenes import square
from mpi4py import MPI

import toros_fem as tf
from toros_fem import meshes as m
from toros_fem.base.files import guarded
from toros_fem.design.density.filters import make_filter
from toros_fem.design.density.projection import Projection
from toros_fem.design.lines.field import LineField
from toros_fem.design.mma.optimizer import MMA, Functions
from toros_fem.making.as_printed import polished
from toros_fem.making.cleaning import require_island_area
from toros_fem.materials.library.files import named, read_library, write_material
from toros_fem.materials.library.material import LibraryMaterial
from toros_fem.measures.regions import Body, tip_frame
from toros_fem.measures.shape import ShapeObjective
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.paths.arc_length import ArcLengthOptions
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.mechanics.readings.wrinkles import wrinkle_field
from toros_fem.mechanics.skin.chambers import chambers_of_panels
from toros_fem.mechanics.skin.dead_loads import point_force, spread_force
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, build_in, displace
from toros_fem.products.gripper import GripperScene
from toros_fem.products.inflate import InflateScene
from toros_fem.products.tiles.report import PrintedTile, read_tile
from toros_fem.products.tubes import BendScene
from toros_fem.products.walker import WalkerScene
from toros_fem.results.writer import write_fields

Table = dict[str, Callable[["Scene"], object]]


NAN, INF = float("nan"), float("inf")


LONG = np.zeros(100_000)


SQUARE = [(0.0, 0.0), (0.04, 0.0), (0.04, 0.04), (0.0, 0.04)]


class Scene:
    """A short tube and what is made of it, each when it is first needed."""

    def __init__(self, comm: MPI.Comm, folder: Path) -> None:
        self.comm, self.folder = comm, folder

    @cached_property
    def pattern(self) -> tf.meshes.Pattern:
        return m.cylinder(self.comm, 0.04, 0.02, 7e-3, mesh="structured")

    @cached_property
    def skin(self) -> tf.meshes.Skin:
        return tf.sew(self.comm, self.pattern)

    @cached_property
    def held(self) -> Supports:
        return tf.clamp(self.pattern, ["base"])

    @cached_property
    def solver(self) -> tf.EquilibriumSolver:
        return tf.EquilibriumSolver(self.skin, tf.Composite(bending=None), self.held)

    @cached_property
    def plain(self) -> np.ndarray:
        return np.zeros(len(self.skin.owned_cells))

    @cached_property
    def result(self) -> Equilibrium:
        return self.solver.solve(self.plain, 500.0)

    @cached_property
    def design(self) -> tf.ShapeDesign:
        return self.designed()

    def designed(self, **changes: Any) -> tf.ShapeDesign:
        given: dict[str, Any] = {
            "target": self.pattern.points,
            "supports": self.held,
            "filter_radius": 0.012,
            "pressure": 500.0,
            "composite": tf.Composite(bending=None),
            "length_scale": None,
        }
        return shape_design(self.comm, self.pattern, **{**given, **changes})

    @cached_property
    def finger(self) -> m.Surface:
        return m.Surface(self.pattern.points, self.pattern.triangles)

    def file(self, name: str, content: str | bytes) -> Path:
        """A file with this content, written by the first rank."""
        path = self.folder / name
        if self.comm.rank == 0:
            path.write_bytes(content.encode() if isinstance(content, str) else content)
        self.comm.barrier()
        return path


def each(call: Callable[..., object], *wrong: dict[str, Any], **good: Any) -> Table:
    """A row for each wrong set of arguments beside those that are good."""

    def row(given: dict[str, Any]) -> Callable[[Scene], object]:
        return lambda scene: call(**{**good, **given})

    def named(given: dict[str, Any]) -> str:
        return ", ".join(f"{name} = {value!r}" for name, value in given.items())

    name = call.__name__.lstrip("_")
    return {f"{name}: {named(given)}": row(given) for given in wrong}


def obj(faces: str, vertices: int = 4, size: float = 0.01) -> str:
    """An OBJ file of a tetrahedron's vertices and given faces."""
    places = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)][:vertices]
    lines = [f"v {x * size} {y * size} {z * size}" for x, y, z in places]
    return "\n".join([*lines, *(f"f {face}" for face in faces.split(","))]) + "\n"


TETRAHEDRON = "1 3 2,1 2 4,1 4 3,2 3 4"


MESHES: Table = {
    "length is text": lambda s: m.cylinder(s.comm, "0.1", 0.02, 5e-3),
    "length is None": lambda s: m.cylinder(s.comm, None, 0.02, 5e-3),
    "length is a list": lambda s: m.cylinder(s.comm, [0.1], 0.02, 5e-3),
    "length is complex": lambda s: m.cylinder(s.comm, 0.1 + 0j, 0.02, 5e-3),
    "length is True": lambda s: m.cylinder(s.comm, True, 0.02, 5e-3),
    "diameter is NaN": lambda s: m.cylinder(s.comm, 0.1, NAN, 5e-3),
    "diameter is infinite": lambda s: m.cylinder(s.comm, 0.1, INF, 5e-3),
    "edges are an array": lambda s: m.cylinder(s.comm, 0.1, 0.02, LONG),
    "edges are 1 µm": lambda s: m.cylinder(s.comm, 0.15, 0.02, 1e-6),
    "a tube of 10 m": lambda s: m.cylinder(s.comm, 100.0, 10.0, 5e-3),
    "edges longer than the tube": lambda s: m.cylinder(s.comm, 0.01, 0.02, 0.05),
    "mesh unknown": lambda s: m.cylinder(s.comm, 0.1, 0.02, 5e-3, mesh="hex"),
    "mesh is a number": lambda s: m.cylinder(s.comm, 0.1, 0.02, 5e-3, mesh=3),
    "planes are text": lambda s: m.cylinder(s.comm, 0.1, 0.02, 5e-3, planes="y"),
    "planes are a number": lambda s: m.cylinder(s.comm, 0.1, 0.02, 5e-3, planes=1),
    "comm is None": lambda s: m.cylinder(None, 0.1, 0.02, 5e-3),
    "comm is text": lambda s: tf.sew("world", s.pattern),
    "a skin in the wrong unit": lambda s: tf.sew(
        s.comm, tf.meshes.rectangle(s.comm, 150.0, 20.0, 5.0)
    ),
    "rectangle's place is text": lambda s: m.rectangle(s.comm, 0.1, 0.1, 0.02, place="up"),
    "disc of negative radius": lambda s: m.disc(s.comm, -1.0, 0.1),
    "outline is text": lambda s: m.two_panels(s.comm, "square", 4e-3),
    "outline is None": lambda s: m.two_panels(s.comm, None, 4e-3),
    "outline is ragged": lambda s: m.two_panels(s.comm, [(0, 0), (1,)], 4e-3),
    "outline is complex": lambda s: m.two_panels(s.comm, np.ones((4, 2)) * 1j, 4e-3),
    "outline is empty": lambda s: m.two_panels(s.comm, np.zeros((0, 2)), 4e-3),
    "outline is a line": lambda s: m.two_panels(s.comm, [(0, 0), (1, 0), (2, 0)], 0.1),
    "outline crosses itself": lambda s: m.two_panels(s.comm, [(0, 0), (1, 1), (1, 0), (0, 1)], 0.1),
    "outline's edges are text": lambda s: m.two_panels(s.comm, SQUARE, "fine"),
    "outline's edges are negative": lambda s: m.two_panels(s.comm, SQUARE, -1e-3),
    "outline's lines are numbers": lambda s: m.two_panels(s.comm, SQUARE, 4e-3, lines=[3.0]),
    "outline's planes are axis 2": lambda s: m.two_panels(s.comm, SQUARE, 4e-3, planes=(2,)),
    "radius of arcs is text": lambda s: m.rounded(SQUARE, "3 mm"),
    "tile's size is text": lambda s: m.tile(s.comm, "1 cm", 1e-3),
    "tile's size has three": lambda s: m.tile(s.comm, (1, 2, 3), 1e-3),
    "tile repeated without end": lambda s: m.tile(s.comm, 0.01, 2e-3).repeated(10**6, 10**6),
    "star of 2.5 arms": lambda s: m.Star(2.5, 0.06, 0.02, 0.02, 5e-3),
    "star's angle is text": lambda s: m.Star(3, 0.06, 0.02, 0.02, 5e-3, "45"),
    "walker's star is text": lambda s: m.walker(s.comm, 4e-3, "star"),
    "mirrored pattern is a mesh": lambda s: m.mirrored(s.skin, (1,)),
    "mirrored axes are a number": lambda s: m.mirrored(s.pattern, 1),
    "moulded points are text": lambda s: m.moulded("sphere", [[0, 1, 2]]),
    "moulded points are NaN": lambda s: m.moulded(np.full((3, 3), NAN), [[0, 1, 2]]),
    "moulded corners are halves": lambda s: m.moulded(np.eye(3), [[0, 1, 1.5]]),
    "a single triangle under pressure": lambda s: _one_triangle().solve(np.zeros(1), 10.0),
    "an open tube under pressure": lambda s: _open_tube(s).solve(s.plain[:0], 10.0),
}


def _one_triangle() -> tf.EquilibriumSolver:
    alone = MPI.COMM_SELF
    corners = np.array([[0.0, 0, 0], [0.01, 0, 0], [0, 0.01, 0]])
    pattern = m.moulded(corners, [[0, 1, 2]])
    return tf.EquilibriumSolver(tf.sew(alone, pattern), tf.Composite(bending=None), tf.pin(pattern))


def _open_tube(s: Scene) -> tf.EquilibriumSolver:
    pattern = m.cylinder(s.comm, 0.04, 0.02, 7e-3, caps="base")
    held = tf.clamp(pattern, ["base"])
    return tf.EquilibriumSolver(tf.sew(s.comm, pattern), tf.Composite(bending=None), held)


def _pattern(s: Scene, **changes: Any) -> tf.meshes.Pattern:
    good = square()
    fields = ("flat_points", "flat_triangles", "panel", "sewn", "points", "panel_names")
    return m.Pattern(**{**{name: getattr(good, name) for name in fields}, **changes})


PATTERNS: Table = {
    "a panel's name breaks a line": lambda s: _pattern(s, panel_names=["a\nb"]),
    "a panel's name is no text": lambda s: _pattern(s, panel_names=["\ud800"]),
    "a panel's name is long": lambda s: _pattern(s, panel_names=[300 * "a"]),
    "pattern's points are text": lambda s: _pattern(s, points="far"),
    "pattern's points are complex": lambda s: _pattern(s, points=np.ones((25, 3)) * 1j),
    "pattern's triangles are halves": lambda s: _pattern(s, flat_triangles=np.full((32, 3), 0.5)),
    "pattern's triangles are NaN": lambda s: _pattern(s, flat_triangles=np.full((32, 3), NAN)),
    "pattern's panel is short": lambda s: _pattern(s, panel=[0, 0]),
    "pattern's names are text": lambda s: _pattern(s, panel_names="sheet"),
    "pattern's names are numbers": lambda s: _pattern(s, panel_names=(3,)),
    "pattern's tolerance is text": lambda s: _pattern(s, seam_tolerance="1e-3"),
    "pattern uses a vertex twice": lambda s: _pattern(s, flat_triangles=[[0, 0, 1]] * 32),
    "pattern has no triangle": lambda s: _pattern(
        s, flat_triangles=np.zeros((0, 3), int), panel=[]
    ),
    "panel is unknown": lambda s: s.pattern.cells_of("wal"),
    "panel is a list": lambda s: s.pattern.cells_of(["wall"]),
    "sewn pattern is text": lambda s: tf.sew(s.comm, "tube"),
    "sewn pattern is a surface": lambda s: tf.sew(s.comm, s.finger),
    "surface's points are text": lambda s: m.Surface("ball", [[0, 1, 2]]),
    "surface's triangles are text": lambda s: m.Surface(np.eye(3), "abc"),
    "surface is NaN": lambda s: m.Surface(np.full((3, 3), NAN), [[0, 1, 2]]),
    "surface's triangles leave the points": lambda s: m.Surface(np.eye(3), [[0, 1, 7]]),
    "surface's triangles are None": lambda s: m.Surface(np.eye(3), None),
    "unwrapped surface is a path": lambda s: m.unwrap(s.comm, "finger.stl"),
    "seams are words": lambda s: m.unwrap(s.comm, s.finger, "none"),
    "seams are halves": lambda s: m.unwrap(s.comm, s.finger, [[0.5, 1.0]]),
    "seams name no vertices": lambda s: m.unwrap(s.comm, s.finger, [[0, 10**6]]),
    "crease angle is negative": lambda s: m.unwrap(s.comm, s.finger, crease_angle=-5.0),
    "stretch is text": lambda s: m.unwrap(s.comm, s.finger, max_stretch="10 %"),
}


FILES: Table = {
    "no file": lambda s: m.read_surface(s.comm, s.folder / "none.stl"),
    "path is a number": lambda s: m.read_surface(s.comm, 3),
    "file is empty": lambda s: m.read_surface(s.comm, s.file("empty.stl", "")),
    "file is a folder": lambda s: m.read_surface(s.comm, s.folder),
    "file is noise": lambda s: m.read_surface(s.comm, s.file("noise.obj", bytes(range(256)))),
    "format is unknown": lambda s: m.read_surface(s.comm, s.file("part.step", "ISO-10303")),
    "mesh in millimetres": lambda s: m.read_surface(
        s.comm, s.file("mm.obj", obj(TETRAHEDRON, size=80.0))
    ),
    "mesh scaled away": lambda s: m.read_surface(
        s.comm, s.file("t.obj", obj(TETRAHEDRON)), scale=1e50
    ),
    "mesh scaled to nothing": lambda s: m.read_surface(
        s.comm, s.file("t.obj", obj(TETRAHEDRON)), scale=1e-9
    ),
    "scale is text": lambda s: m.read_surface(
        s.comm, s.file("t.obj", obj(TETRAHEDRON)), scale="mm"
    ),
    "scale is negative": lambda s: m.read_surface(
        s.comm, s.file("t.obj", obj(TETRAHEDRON)), scale=-1
    ),
    "component is a half": lambda s: m.read_surface(
        s.comm, s.file("t.obj", obj(TETRAHEDRON)), component=0.5
    ),
    "face of a missing vertex": lambda s: m.read_surface(s.comm, s.file("f.obj", obj("1 2 9"))),
    "coordinates are NaN": lambda s: m.read_surface(
        s.comm, s.file("n.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    ),
    "points only": lambda s: m.read_surface(s.comm, s.file("p.obj", "v 0 0 0\nv 1 0 0\n")),
    "target file is missing": lambda s: m.from_mesh(s.comm, s.folder / "none.ply", s.pattern),
    "target file is another mesh": lambda s: m.from_mesh(
        s.comm, s.file("t.obj", obj(TETRAHEDRON)), s.pattern
    ),
    "target file without a pattern": lambda s: m.from_mesh(s.comm, s.folder / "none.ply", None),
    "pattern file is noise": lambda s: m.read_pattern(s.comm, s.file("p.npz", "noise")),
    "tile's folder is missing": lambda s: read_tile(s.comm, s.folder / "none"),
    "tile is noise": lambda s: read_tile(s.comm, s.file("tile.npz", "PK\x03\x04 noise").parent),
}


TARGETS: Table = {
    "bend of 180 in degrees": lambda s: m.bend(180.0, 0.15),
    "bend is text": lambda s: m.bend("90", 0.1),
    "bend is NaN": lambda s: m.bend(NAN, 0.1),
    "bend of no length": lambda s: m.bend(1.0, 0.0),
    "twist in degrees": lambda s: m.twist(300.0, 0.1),
    "twist is a list": lambda s: m.twist([1.0], 0.1),
    "contract to nothing": lambda s: m.contract(0.0),
    "contract is text": lambda s: m.contract("0.9"),
    "curl's direction is text": lambda s: m.curl(
        1.0, 0.1, origin=(0, 0, 0), along="z", toward=(1, 0, 0)
    ),
    "stand's directions are text": lambda s: m.stand(1.0, 0.1, directions="out", root=0.01),
    "composed of a number": lambda s: m.compose(3.0),
    "target is text": lambda s: s.designed(target="bend"),
    "target is None": lambda s: s.designed(target=None),
    "target is short": lambda s: s.designed(target=s.pattern.points[:-1]),
    "target is NaN": lambda s: s.designed(target=s.pattern.points * NAN),
    "target is complex": lambda s: s.designed(target=s.pattern.points * 1j),
    "target in millimetres": lambda s: s.designed(target=1e3 * s.pattern.points),
    "target is far away": lambda s: s.designed(target=s.pattern.points + 5.0),
    "target map returns text": lambda s: s.designed(target=lambda x: "bent"),
}


MATERIALS: Table = {
    **each(tf.Material, {"young": "1e5"}, {"young": 0.0}, {"young": [1e5]}, {"thickness": None},
           {"poisson": 0.9}, young=1e5, poisson=0.3, thickness=5e-4),
    **each(tf.Composite, {"fabric": "cotton"}, {"reinforcement": 26e6}, {"c1": "2"}, {"c1": 1.0},
           {"membrane": "thin"}),
    **each(tf.Bending, {"curvature": "cubic"}, {"curvature": None}),
    **each(tf.Bladder, {"young": "soft"}, thickness=1e-4),
    **each(tf.Knit, {"grain": "45"}, ratio=2.0),
    **each(tf.Weight, {"fabric": "light"}, {"gravity": 9.81}, {"gravity": "down"},
           fabric=0.1, reinforcement=0.2),
}  # fmt: skip


SUPPORTS: Table = {
    "clamped panels are text": lambda s: tf.clamp(s.pattern, "base"),
    "clamped panels are numbers": lambda s: tf.clamp(s.pattern, [0]),
    "clamped panels are None": lambda s: tf.clamp(s.pattern, None),
    "clamped pattern is a skin": lambda s: tf.clamp(s.skin, ["base"]),
    "region is text": lambda s: tf.clamp_where(s.pattern, "z < 5 mm"),
    "region is empty": lambda s: tf.clamp_where(s.pattern, lambda x: x[:, 2] > 9),
    "region returns numbers": lambda s: tf.clamp_where(s.pattern, lambda x: x[:, 2]),
    "supports from a list": lambda s: Supports([1, 2, 3]),
    "supports from integers": lambda s: Supports(np.zeros((9, 3), int)),
    "supports of another pattern": lambda s: tf.EquilibriumSolver(
        s.skin, tf.Composite(bending=None), Supports(np.ones((3, 3), bool))
    ),
    "guides are text": lambda s: Supports(s.held.fixed, "edge"),
    "displaced by a word": lambda s: displace(s.pattern, ["tip"], "up"),
    "displaced by NaN": lambda s: displace(s.pattern, ["tip"], [0, 0, NAN]),
    "displaced by a number": lambda s: displace(s.pattern, ["tip"], 0.01),
    "pinned panel is unknown": lambda s: tf.pin(s.pattern, "top"),
    "symmetry across axis 7": lambda s: tf.symmetry_plane(s.pattern, 7),
    "symmetry across a letter": lambda s: tf.symmetry_plane(s.pattern, "x"),
    "built-in vertices are numbers": lambda s: build_in(s.pattern, [1, 2]),
    "nothing is fixed": lambda s: tf.EquilibriumSolver(
        s.skin, tf.Composite(bending=None), Supports(np.zeros_like(s.held.fixed))
    ),
    "quadratic triangles are numbers": lambda s: _solver(s, quadratic=[0, 1]),
    "chambers are short": lambda s: tf.EquilibriumSolver(
        s.skin, tf.Composite(bending=None), s.held, chambers=tf.Chambers(("a", "b"), [0, 1])
    ),
    "chambers leave a number out": lambda s: tf.Chambers(("a", "b"), [0, 2]),
    "chambers hold 100 000 numbers": lambda s: tf.Chambers(("a",), np.arange(100_000)),
    "chambers are words": lambda s: tf.Chambers(("a",), ["a", "a"]),
    "chambers' name is text": lambda s: tf.Chambers("ab", [0, 1]),
    "chambers of panels are a list": lambda s: chambers_of_panels(s.pattern, ["base"]),
    "force is a word": lambda s: spread_force(s.pattern, "tip", "down"),
    "force at no place": lambda s: point_force(s.pattern, (9, 9, 9), (0, 0, 1)),
}


def _solver(s: Scene, **changes: Any) -> tf.EquilibriumSolver:
    given = {"skin": s.skin, "composite": tf.Composite(bending=None), "supports": s.held}
    return tf.EquilibriumSolver(**{**given, **changes})


SOLVES: Table = {
    "skin is a pattern": lambda s: _solver(s, skin=s.pattern),
    "composite is a material": lambda s: _solver(s, composite=tf.Material(1e5, 0.3, 5e-4)),
    "supports are None": lambda s: _solver(s, supports=None),
    "options are a dict": lambda s: _solver(s, options={"max_steps": 3}),
    "log is text": lambda s: _solver(s, log="verbose"),
    "pressure is None": lambda s: s.solver.solve(s.plain, None),
    "pressure is text": lambda s: s.solver.solve(s.plain, "5 kPa"),
    "pressure is negative": lambda s: s.solver.solve(s.plain, -1.0),
    "pressure is NaN": lambda s: s.solver.solve(s.plain, NAN),
    "pressure is complex": lambda s: s.solver.solve(s.plain, 1j),
    "pressure is 100 000 numbers": lambda s: s.solver.solve(s.plain, LONG),
    "density is text": lambda s: s.solver.solve("plain", 10.0),
    "density is None": lambda s: s.solver.solve(None, 10.0),
    "density is complex": lambda s: s.solver.solve(s.plain + 0.5j, 10.0),
    "density is objects": lambda s: s.solver.solve(s.plain.astype(object), 10.0),
    "density is a number": lambda s: s.solver.solve(0.5, 10.0),
    "density is long": lambda s: s.solver.solve(LONG, 10.0),
    "density leaves its bounds": lambda s: s.solver.solve(s.plain + 1.5, 10.0),
    "density is NaN": lambda s: s.solver.solve(s.plain * NAN, 10.0),
    "force is flat": lambda s: s.solver.solve(s.plain, Load(10.0, force=np.zeros(3))),
    "displacement is text": lambda s: s.solver.solve(s.plain, Load(10.0, displacement="up")),
    "start is text": lambda s: s.solver.solve(s.plain, 10.0, start="flat"),
    "start is short": lambda s: s.solver.solve(s.plain, 10.0, start=np.zeros(2)),
    "start is collapsed": lambda s: s.solver.solve(s.plain, 10.0, start=0 * s.result.state),
    "trial is a word": lambda s: s.solver.solve(s.plain, 10.0, trial="yes"),
    "path of one pressure": lambda s: tf.trace(s.solver, s.plain, 1e3),
    "path of text": lambda s: tf.trace(s.solver, s.plain, ["low", "high"]),
    "path into vacuum": lambda s: tf.trace(s.solver, s.plain, [1e3, -1e3]),
    "path by time": lambda s: tf.trace(s.solver, s.plain, [1e3], by="time"),
    "path of a skin": lambda s: tf.trace(s.skin, s.plain, [1e3]),
    "first increment is zero": lambda s: ArcLengthOptions(first_increment=0),
    "limit points of numbers": lambda s: tf.limit_points([1.0, 2.0]),
    "wrinkles of a membrane": lambda s: wrinkle_field(s.solver, s.plain, s.result),
    "wrinkles of nothing": lambda s: wrinkle_field(s.solver, s.plain, None),
}


def _metric(value: Any, name: str = "height", unit: str = "mm") -> tf.Metric:
    return tf.Metric(name, unit, None, lambda pattern, positions: value)


def _measured(s: Scene, *metrics: tf.Metric) -> list[TracePoint]:
    return list(tf.trace(s.solver, s.plain, [500.0], list(metrics)))


METRICS: Table = {
    "metric's name is a sentence": lambda s: _metric(1.0, "bend angle"),
    "metric's name is a number": lambda s: _metric(1.0, 3),
    "metric's target is text": lambda s: tf.Metric("a", "deg", "90", tf.bend_angle),
    "metric's target is NaN": lambda s: tf.Metric("a", "deg", NAN, tf.bend_angle),
    "metric's function is a name": lambda s: tf.Metric("a", "deg", 90.0, "bend_angle"),
    "metric returns NaN": lambda s: _measured(s, _metric(NAN)),
    "metric returns None": lambda s: _measured(s, _metric(None)),
    "metric returns an array": lambda s: _measured(s, _metric(LONG)),
    "two metrics of a name": lambda s: tf.trace(
        s.solver, s.plain, [1.0], [_metric(1.0), _metric(2.0)]
    ),
    "metrics of a design have one name": lambda s: s.designed(metrics=[_metric(1.0)] * 2),
    "metric hides the pressure": lambda s: s.designed(metrics=[_metric(1.0, "pressure", "pa")]),
    "metrics are one metric": lambda s: s.designed(metrics=_metric(1.0)),
    "metrics are functions": lambda s: s.designed(metrics=[tf.bend_angle]),
    "body's centre is a number": lambda s: Body("sphere", 0.01, 0.0),
    "body is a cone": lambda s: Body("cone", 0.01, (0, 0, 0)),
    "weights are negative": lambda s: ShapeObjective(
        s.skin, s.pattern.points, -np.ones(len(s.pattern.points))
    ),
    "weights are text": lambda s: ShapeObjective(s.skin, s.pattern.points, "area"),
    "labels are text": lambda s: tf.CrossSections("rings", np.ones((1, 3)), np.ones(1)),
}


DESIGNS: Table = {
    "filter radius is zero": lambda s: s.designed(filter_radius=0),
    "filter radius is text": lambda s: s.designed(filter_radius="5 mm"),
    "filter radius over the skin": lambda s: s.designed(filter_radius=3.0),
    "filter radius of Helmholtz over the skin": lambda s: make_filter("helmholtz", s.skin, 3.0),
    "filter is unknown": lambda s: s.designed(filter="gauss"),
    "filter of a pattern": lambda s: make_filter("cone", s.pattern, 0.01),
    "threshold is 0": lambda s: Projection(eta=0),
    "threshold is 1": lambda s: Projection(eta=1.0),
    "steepness is text": lambda s: Projection(beta="steep"),
    "projection is a number": lambda s: s.designed(projection=20.0),
    "widths are text": lambda s: tf.LengthScale(line_width="1 kg"),
    "passive is short": lambda s: s.designed(passive=np.zeros(3)),
    "passive is text": lambda s: s.designed(passive="base"),
    "passive everywhere": lambda s: tf.optimize(s.designed(passive=np.ones(len(s.pattern.panel)))),
    "passive is 2": lambda s: s.designed(passive=np.full(len(s.pattern.panel), 2.0)),
    "start of a design is short": lambda s: s.designed(start=np.full(3, 0.5)),
    "start of a design is text": lambda s: s.designed(start="grey"),
    "start of a design is 0": lambda s: s.designed(start=np.zeros(len(s.pattern.panel))),
    "printed panels are text": lambda s: s.designed(printed_panels="base"),
    "printed panel is unknown": lambda s: s.designed(printed_panels=["cap"]),
    "design's pressure is text": lambda s: s.designed(pressure="5 kPa"),
    "design's pressure is None": lambda s: s.designed(pressure=None),
    "pressure bounds are one number": lambda s: s.designed(pressure_bounds=1e4),
    "pressure bounds begin at 0": lambda s: s.designed(pressure_bounds=(0.0, 2e4)),
    "pressure bounds are exchanged": lambda s: s.designed(pressure_bounds=(2e3, 1e2)),
    "pressure bounds are three": lambda s: s.designed(pressure_bounds=(1.0, 2.0, 3.0)),
    "perimeter's weight is negative": lambda s: s.designed(perimeter_weight=-1.0),
    "perimeter's sharpness is 0": lambda s: s.designed(perimeter_weight=1.0, perimeter_sharpness=0),
    "objective is text": lambda s: s.designed(parts="shape"),
    "symmetry is text": lambda s: s.designed(symmetry="y"),
    "force of a design is short": lambda s: tf.optimize(
        s.designed(force=np.zeros(3)), [tf.Stage(1)]
    ),
    "no stage": lambda s: tf.DesignOptions(stages=()),
    "stages are numbers": lambda s: tf.optimize(s.design, [60, 40]),
    "stages are a number": lambda s: tf.optimize(s.design, 60),
    "one stage": lambda s: tf.optimize(s.design, tf.Stage(2)),
    "stage without widths": lambda s: tf.optimize(s.design, [tf.Stage(1, constrained=True)]),
    "seed is negative": lambda s: tf.optimize(s.design, [tf.Stage(1)], seed=-1),
    "seed is a half": lambda s: tf.optimize(s.design, [tf.Stage(1)], seed=0.5),
    "optimised skin": lambda s: tf.optimize(s.skin, [tf.Stage(1)]),
    "callback is text": lambda s: tf.optimize(s.design, [tf.Stage(1)], callback="print"),
    "optimisation starts at text": lambda s: tf.optimize(s.design, [tf.Stage(1)], start="grey"),
    "twist about text": lambda s: tf.twist_between(
        s.pattern, s.pattern.points, s.held.fixed[:, 0], along="x"
    ),
    "bend along a huge number": lambda s: tf.bend_between(
        s.pattern, s.pattern.points, s.held.fixed[:, 0], along=10**400, toward=(1, 0, 0)
    ),
    "frame along NaN": lambda s: tip_frame(
        s.pattern, s.pattern.points, s.held.fixed[:, 0], along=(0, 0, NAN)
    ),
    "summary of nothing": lambda s: tf.read_summary(None),
    "tests of nothing": lambda s: tf.read_tensile_tests(None),
    "tests of numbers": lambda s: tf.read_tensile_tests([1.5]),
    "tests with a table": lambda s: tf.read_tensile_tests(["a.csv"], {"width": 1.0}),
    "levels of nothing": lambda s: tf.optimize_levels(None, None),
    "levels without options": lambda s: tf.optimize_levels([s.design], []),
    "refined 0 times": lambda s: next(tf.refinements(s.design, 0)),
    "lines of a word": lambda s: LineField(s.pattern, "some", "0"),
    "lines of negative shares": lambda s: LineField(
        s.pattern, -np.ones((len(s.pattern.panel), 1)), np.zeros((len(s.pattern.panel), 1))
    ),
    "lines laid on a pattern": lambda s: tf.lay_lines(s.pattern),
    "lines of no width": lambda s: tf.LineOptions(widths=()),
    "lines' width is a number": lambda s: tf.LineOptions(widths=1e-3),
    "lines nearer than 0": lambda s: tf.LineOptions(spacings=(-1.0,)),
    "lines found for a skin": lambda s: tf.find_lines(s.skin),
    "lines' steps are a number": lambda s: tf.RelaxedOptions(iterations=40),
    "print's width is text": lambda s: tf.PrintLimits(width="thin"),
    "print of nothing": lambda s: tf.as_printed(s.design, None),
    "trim of nothing": lambda s: tf.trimmed(None),
    "polish of nothing": lambda s: polished(s.design, None, tf.DesignOptions()),
    "islands larger than the skin": lambda s: require_island_area(s.pattern, 20.0),
}


HALF, ONES = np.full(2, 0.5), np.ones(2)


def _mma() -> MMA:
    return MMA(MPI.COMM_SELF, np.zeros(2), ONES)


def _bounds(lower: object, upper: object) -> MMA:
    return MMA(MPI.COMM_SELF, lower, upper)


OPTIMIZER: Table = {
    "MMA's bounds are text": lambda s: _bounds("low", "high"),
    "MMA's bounds are exchanged": lambda s: _bounds([1.0], [0.0]),
    "MMA's bounds are infinite": lambda s: _bounds([0.0], [INF]),
    "MMA's bounds have other sizes": lambda s: _bounds([0.0], [1.0, 1.0]),
    "MMA's constraints are a half": lambda s: MMA(MPI.COMM_SELF, np.zeros(2), ONES, 0.5),
    "MMA's value is NaN": lambda s: _mma().step(HALF, Functions(NAN, ONES)),
    "MMA's gradient is NaN": lambda s: _mma().step(HALF, Functions(1.0, np.array([NAN, 1.0]))),
    "MMA's values are too many": lambda s: _mma().step(HALF, Functions(1.0, ONES, [1.0])),
}


def _tile(region: Any, **changes: Any) -> PrintedTile:
    return PrintedTile(**{"region": region, "size": (0.01, 0.01), "edge_length": 2e-3, **changes})


OUTPUTS: Table = {
    "fields into a missing folder": lambda s: write_fields(
        s.folder / "no" / "a.vtu", s.pattern, s.pattern.points, {}
    ),
    "output is a file": lambda s: guarded(s.comm, s.file("file", "") / "x", lambda: None),
    "reporter in a file": lambda s: tf.DesignReporter(s.comm, s.file("file", "")),
    "results of nothing": lambda s: tf.write_results(s.folder, None, None),
    "tile printed as a list": lambda s: _tile([True]),
    "tile printed in numbers": lambda s: _tile(np.zeros(4)),
    "tile's size is a word": lambda s: _tile(shapely.Point(0, 0).buffer(1e-3), size="cm"),
}


def _island(s: Scene) -> object:
    config = BendScene.of(edge_length=5e-3, filter_radius=0.01, island_area=1.0, levels=1)
    return problem_of(s.comm, config)


SCENES: Table = {
    "curve ends below the pressure": lambda s: InflateScene.of(pressure=50e3),
    "walker of an oblique knit": lambda s: case_of(
        s.comm, WalkerScene.of(knit_ratio=2.0, grain_angle=30.0)
    ),
    "gripper of an oblique knit": lambda s: case_of(
        s.comm, GripperScene.of(knit_ratio=2.0, grain_angle=30.0)
    ),
    "bend of an unknown number": lambda s: BendScene.of(angel=90.0),
    "islands of a scene larger than its skin": _island,
}  # fmt: skip


MINE: dict[str, Any] = {
    "name": "mine", "kind": "fabric", "title": "mine", "young": 1e5, "poisson": 0.3,
    "thickness": 5e-4, "stretch_range": (1.0, 1.5), "source": "a test", "trust": "measured",
}  # fmt: skip


def _material(**changes: Any) -> LibraryMaterial:
    return LibraryMaterial(**{**MINE, **changes})


LIBRARY: Table = {
    **each(_material, {"young": "1 mm"}, {"name": "../mine"}, {"name": "none"}, {"trust": "high"},
           {"thickness": 0.5}, {"stretch_range": (1.0, NAN)}, {"title": 100 * "x"},
           {"source": None}),
    "range is an array": lambda s: _material(stretch_range=LONG),
    "library is a number": lambda s: read_library(3),
    "library is missing": lambda s: read_library(s.folder / "no.toml", comm=s.comm),
    "library is a folder": lambda s: read_library(s.folder, comm=s.comm),
    "material is unknown": lambda s: named(read_library(), "tpu-95"),
    "entry is a dict": lambda s: write_material(s.folder / "m.toml", MINE),
}  # fmt: skip


ON_RANKS = (
    "length is text",
    "edges are 1 µm",
    "outline is text",
    "panel is unknown",
    "sewn pattern is text",
    "no file",
    "mesh in millimetres",
    "tile's folder is missing",
    "bend of 180 in degrees",
    "target is text",
    "target in millimetres",
    "supports from a list",
    "displaced by a word",
    "chambers are short",
    "pressure is None",
    "pressure is negative",
    "density is text",
    "path into vacuum",
    "metric returns NaN",
    "two metrics of a name",
    "filter radius over the skin",
    "passive is short",
    "seed is negative",
    "output is a file",
    "islands of a scene larger than its skin",
    "library is missing",
    "library is a folder",
)
REFUSALS: Table = (
    MESHES
    | PATTERNS
    | FILES
    | TARGETS
    | MATERIALS
    | SUPPORTS
    | SOLVES
    | METRICS
    | DESIGNS
    | OPTIMIZER
    | OUTPUTS
    | SCENES
    | LIBRARY
)
