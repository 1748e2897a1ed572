"""Bad input ends in a typed error that is short and names the remedy, on all ranks alike.

Each case is a call, the type of its error, and words of the message: the value, the bound or the
remedy. Those marked `risky` are tried on several ranks too; all ranks must raise the same.
"""

# The types are wrong on purpose.
# mypy: disable-error-code="arg-type,call-arg,call-overload,dict-item,list-item"
# mypy: disable-error-code="operator,return-value"

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import shared, square
from mpi4py import MPI
from petsc4py import PETSc

import toros_fem as tf
from toros_fem import errors as e
from toros_fem import meshes as m
from toros_fem.design.mma import MMA, MMAOptions
from toros_fem.making.print.cleaning import require_island_area
from toros_fem.materials.library import LibraryMaterial, named, read_library, write_material
from toros_fem.mechanics.equilibrium.solver import EquilibriumResult
from toros_fem.mechanics.skin.chambers import chambers_of_panels
from toros_fem.products.actuators.problem import actuator_problem
from toros_fem.products.gripper.gripper import GripperConfig
from toros_fem.products.tiles import PrintedTile, read_tile
from toros_fem.products.tubes.bend import BendConfig
from toros_fem.products.tubes.bend import case as bend_case
from toros_fem.products.tubes.inflate import InflateConfig
from toros_fem.products.tubes.twist import TwistConfig
from toros_fem.products.walker.walker import WalkerConfig
from toros_fem.results.files import write_fields
from toros_fem.results.writer import write_pictures

# Characters of the longest message: about three lines of a terminal.
LONGEST = 320
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
    def held(self) -> tf.Supports:
        return tf.clamp(self.pattern, ["base"])

    @cached_property
    def solver(self) -> tf.EquilibriumSolver:
        return tf.EquilibriumSolver(self.skin, tf.Composite(bending=None), self.held)

    @cached_property
    def plain(self) -> np.ndarray:
        return np.zeros(len(self.skin.owned_cells))

    @cached_property
    def result(self) -> EquilibriumResult:
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
        return tf.ShapeDesign(self.comm, self.pattern, **{**given, **changes})

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

    def by_rank(self, one: Any, other: Any) -> Any:
        """A value that is another one on all ranks but the first."""
        return one if self.comm.rank == 0 else other


@dataclass(frozen=True)
class Case:
    name: str
    call: Callable[[Scene], object]
    error: type[Exception]
    words: Sequence[str]
    risky: bool = False

    def __str__(self) -> str:
        return self.name.replace(" ", "-")


P = e.ParameterError


def case(
    name: str, call: Callable[[Scene], object], error: type[Exception], *words: str,
    risky: bool = False,
) -> Case:  # fmt: skip
    return Case(name, call, error, words, risky)


def obj(faces: str, vertices: int = 4, size: float = 0.01) -> str:
    """An OBJ file of a tetrahedron's vertices and given faces."""
    places = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)][:vertices]
    lines = [f"v {x * size} {y * size} {z * size}" for x, y, z in places]
    return "\n".join([*lines, *(f"f {face}" for face in faces.split(","))]) + "\n"


TETRAHEDRON = "1 3 2,1 2 4,1 4 3,2 3 4"

MESHES = [
    case(
        "length is text",
        lambda s: m.cylinder(s.comm, "0.1", 0.02, 5e-3),
        P,
        "length = '0.1'",
        "finite number",
        risky=True,
    ),
    case(
        "length is None",
        lambda s: m.cylinder(s.comm, None, 0.02, 5e-3),
        P,
        "length = None",
        "greater than 0",
    ),
    case("length is a list", lambda s: m.cylinder(s.comm, [0.1], 0.02, 5e-3), P, r"length = [0.1]"),
    case("length is complex", lambda s: m.cylinder(s.comm, 0.1 + 0j, 0.02, 5e-3), P, "length ="),
    case("length is True", lambda s: m.cylinder(s.comm, True, 0.02, 5e-3), P, "length = True"),
    case("diameter is NaN", lambda s: m.cylinder(s.comm, 0.1, NAN, 5e-3), P, "diameter = nan"),
    case("diameter is infinite", lambda s: m.cylinder(s.comm, 0.1, INF, 5e-3), P, "diameter = inf"),
    case(
        "edges are an array",
        lambda s: m.cylinder(s.comm, 0.1, 0.02, LONG),
        P,
        "an array of shape (100000,)",
    ),
    case(
        "edges are 1 µm",
        lambda s: m.cylinder(s.comm, 0.15, 0.02, 1e-6),
        e.MeshSizeError,
        "triangles on",
        "Give at least",
        risky=True,
    ),
    case(
        "a tube of 10 m",
        lambda s: m.cylinder(s.comm, 100.0, 10.0, 5e-3),
        e.MeshSizeError,
        "more than 2000000",
    ),
    case(
        "edges longer than the tube",
        lambda s: m.cylinder(s.comm, 0.01, 0.02, 0.05),
        P,
        "edge_length = 0.05",
        "at most",
    ),
    case(
        "mesh unknown",
        lambda s: m.cylinder(s.comm, 0.1, 0.02, 5e-3, mesh="hex"),
        P,
        "mesh = 'hex'",
        "'structured'",
    ),
    case("mesh is a number", lambda s: m.cylinder(s.comm, 0.1, 0.02, 5e-3, mesh=3), P, "mesh = 3"),
    case(
        "planes are text",
        lambda s: m.cylinder(s.comm, 0.1, 0.02, 5e-3, planes="y"),
        P,
        "planes = 'y'",
        "(1,) for the half",
    ),
    case(
        "planes are a number",
        lambda s: m.cylinder(s.comm, 0.1, 0.02, 5e-3, planes=1),
        P,
        "planes = 1",
    ),
    case(
        "comm is None",
        lambda s: m.cylinder(None, 0.1, 0.02, 5e-3),
        P,
        "comm = None",
        "MPI communicator",
    ),
    case("comm is text", lambda s: tf.sew("world", s.pattern), P, "comm = 'world'"),
    case(
        "rectangle's place is text",
        lambda s: m.rectangle(s.comm, 0.1, 0.1, 0.02, place="up"),
        P,
        "place = 'up'",
    ),
    case("disc of negative radius", lambda s: m.disc(s.comm, -1.0, 0.1), P, "radius = -1.0"),
    case(
        "outline is text",
        lambda s: m.two_panels(s.comm, "square", 4e-3),
        e.OutlineError,
        "outline = 'square'",
        "real numbers",
        risky=True,
    ),
    case(
        "outline is None",
        lambda s: m.two_panels(s.comm, None, 4e-3),
        e.OutlineError,
        "outline = None",
    ),
    case(
        "outline is ragged",
        lambda s: m.two_panels(s.comm, [(0, 0), (1,)], 4e-3),
        e.OutlineError,
        "outline =",
    ),
    case(
        "outline is complex",
        lambda s: m.two_panels(s.comm, np.ones((4, 2)) * 1j, 4e-3),
        e.OutlineError,
        "real numbers",
    ),
    case(
        "outline is empty",
        lambda s: m.two_panels(s.comm, np.zeros((0, 2)), 4e-3),
        e.OutlineError,
        "points",
    ),
    case(
        "outline is a line",
        lambda s: m.two_panels(s.comm, [(0, 0), (1, 0), (2, 0)], 0.1),
        e.OutlineError,
        "outline",
    ),
    case(
        "outline crosses itself",
        lambda s: m.two_panels(s.comm, [(0, 0), (1, 1), (1, 0), (0, 1)], 0.1),
        e.OutlineError,
        "simple",
    ),
    case(
        "outline's edges are text",
        lambda s: m.two_panels(s.comm, SQUARE, "fine"),
        e.OutlineError,
        "edge_length = 'fine'",
    ),
    case(
        "outline's edges are negative",
        lambda s: m.two_panels(s.comm, SQUARE, -1e-3),
        e.OutlineError,
        "edge_length = -0.001",
    ),
    case(
        "outline's lines are numbers",
        lambda s: m.two_panels(s.comm, SQUARE, 4e-3, lines=[3.0]),
        e.OutlineError,
        "line 0",
    ),
    case(
        "outline's planes are axis 2",
        lambda s: m.two_panels(s.comm, SQUARE, 4e-3, planes=(2,)),
        e.OutlineError,
        "planes holds 2",
    ),
    case("radius of arcs is text", lambda s: m.rounded(SQUARE, "3 mm"), P, "radius = '3 mm'"),
    case("tile's size is text", lambda s: m.tile(s.comm, "1 cm", 1e-3), P, "size = '1 cm'"),
    case("tile's size has three", lambda s: m.tile(s.comm, (1, 2, 3), 1e-3), P, "two (a, b)"),
    case(
        "tile repeated without end",
        lambda s: m.tile(s.comm, 0.01, 2e-3).repeated(10**6, 10**6),
        e.MeshSizeError,
        "more than 2000000",
    ),
    case(
        "star of 2.5 arms", lambda s: m.Star(2.5, 0.06, 0.02, 0.02, 5e-3), P, "arms = 2.5", "whole"
    ),
    case(
        "star's angle is text", lambda s: m.Star(3, 0.06, 0.02, 0.02, 5e-3, "45"), P, "angle = '45'"
    ),
    case("walker's star is text", lambda s: m.walker(s.comm, 4e-3, "star"), P, "star = 'star'"),
    case("mirrored pattern is a mesh", lambda s: m.mirrored(s.skin, (1,)), P, "must be a Pattern"),
    case("mirrored axes are a number", lambda s: m.mirrored(s.pattern, 1), P, "axes = 1"),
    case(
        "moulded points are text",
        lambda s: m.moulded("sphere", [[0, 1, 2]]),
        e.PatternError,
        "points = 'sphere'",
    ),
    case(
        "moulded points are NaN",
        lambda s: m.moulded(np.full((3, 3), NAN), [[0, 1, 2]]),
        e.PatternError,
        "finite",
    ),
    case(
        "moulded corners are halves",
        lambda s: m.moulded(np.eye(3), [[0, 1, 1.5]]),
        e.PatternError,
        "1.5",
        "whole",
    ),
    case(
        "a single triangle under pressure",
        lambda s: _one_triangle().solve(np.zeros(1), 10.0),
        e.OpenSkinError,
        "closed skin",
    ),
    case(
        "an open tube under pressure",
        lambda s: _open_tube(s).solve(s.plain[:0], 10.0),
        e.OpenSkinError,
        "closed skin",
        "cap",
    ),
]


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


PATTERNS = [
    case(
        "pattern's points are text",
        lambda s: _pattern(s, points="far"),
        e.PatternError,
        "points = 'far'",
    ),
    case(
        "pattern's points are complex",
        lambda s: _pattern(s, points=np.ones((25, 3)) * 1j),
        e.PatternError,
        "points",
    ),
    case(
        "pattern's triangles are halves",
        lambda s: _pattern(s, flat_triangles=np.full((32, 3), 0.5)),
        e.PatternError,
        "0.5",
        "whole",
    ),
    case(
        "pattern's triangles are NaN",
        lambda s: _pattern(s, flat_triangles=np.full((32, 3), NAN)),
        e.PatternError,
        "nan",
        "whole",
    ),
    case(
        "pattern's panel is short",
        lambda s: _pattern(s, panel=[0, 0]),
        e.PatternError,
        "panel has 2 entries for 32",
    ),
    case(
        "pattern's names are text",
        lambda s: _pattern(s, panel_names="sheet"),
        e.PatternError,
        "list of names",
    ),
    case(
        "pattern's names are numbers",
        lambda s: _pattern(s, panel_names=(3,)),
        e.PatternError,
        "list of names",
    ),
    case(
        "pattern's tolerance is text",
        lambda s: _pattern(s, seam_tolerance="1e-3"),
        e.PatternError,
        "seam_tolerance = '1e-3'",
    ),
    case(
        "pattern uses a vertex twice",
        lambda s: _pattern(s, flat_triangles=[[0, 0, 1]] * 32),
        e.PatternError,
        "",
    ),
    case(
        "pattern has no triangle",
        lambda s: _pattern(s, flat_triangles=np.zeros((0, 3), int), panel=[]),
        e.PatternError,
        "no triangle",
    ),
    case(
        "panel is unknown",
        lambda s: s.pattern.cells_of("wal"),
        e.PanelError,
        "'wal'",
        "'wall'",
        risky=True,
    ),
    case("panel is a list", lambda s: s.pattern.cells_of(["wall"]), e.PanelError, "['wall']"),
    case(
        "sewn pattern is text", lambda s: tf.sew(s.comm, "tube"), P, "pattern = 'tube'", risky=True
    ),
    case("sewn pattern is a surface", lambda s: tf.sew(s.comm, s.finger), P, "must be a Pattern"),
    case(
        "surface's points are text",
        lambda s: m.Surface("ball", [[0, 1, 2]]),
        e.SurfaceError,
        "points = 'ball'",
    ),
    case(
        "surface's triangles are text",
        lambda s: m.Surface(np.eye(3), "abc"),
        e.SurfaceError,
        "triangles = 'abc'",
    ),
    case(
        "surface is NaN",
        lambda s: m.Surface(np.full((3, 3), NAN), [[0, 1, 2]]),
        e.SurfaceError,
        "not finite",
    ),
    case(
        "surface's triangles leave the points",
        lambda s: m.Surface(np.eye(3), [[0, 1, 7]]),
        e.SurfaceError,
        "triangles holds 7",
    ),
    case(
        "surface's triangles are None",
        lambda s: m.Surface(np.eye(3), None),
        e.SurfaceError,
        "triangles = None",
    ),
    case(
        "unwrapped surface is a path", lambda s: m.unwrap(s.comm, "finger.stl"), P, "read_surface"
    ),
    case(
        "seams are words",
        lambda s: m.unwrap(s.comm, s.finger, "none"),
        P,
        "seams = 'none'",
        "'auto'",
    ),
    case(
        "seams are halves",
        lambda s: m.unwrap(s.comm, s.finger, [[0.5, 1.0]]),
        e.SurfaceError,
        "0.5",
        "whole",
    ),
    case(
        "seams name no vertices",
        lambda s: m.unwrap(s.comm, s.finger, [[0, 10**6]]),
        e.SurfaceError,
        "names no vertices",
    ),
    case(
        "crease angle is negative",
        lambda s: m.unwrap(s.comm, s.finger, crease_angle=-5.0),
        P,
        "in rad",
        "-5.0",
    ),
    case(
        "stretch is text",
        lambda s: m.unwrap(s.comm, s.finger, max_stretch="10 %"),
        P,
        "max_stretch = '10 %'",
    ),
]

FILES = [
    case(
        "no file",
        lambda s: m.read_surface(s.comm, s.folder / "none.stl"),
        e.SurfaceError,
        "there is no file",
        risky=True,
    ),
    case("path is a number", lambda s: m.read_surface(s.comm, 3), e.SurfaceError, "path = 3"),
    case(
        "file is empty",
        lambda s: m.read_surface(s.comm, s.file("empty.stl", "")),
        e.SurfaceError,
        "empty.stl",
    ),
    case("file is a folder", lambda s: m.read_surface(s.comm, s.folder), e.SurfaceError, "no file"),
    case(
        "file is noise",
        lambda s: m.read_surface(s.comm, s.file("noise.obj", bytes(range(256)))),
        e.SurfaceError,
        "noise.obj",
    ),
    case(
        "format is unknown",
        lambda s: m.read_surface(s.comm, s.file("part.step", "ISO-10303")),
        e.SurfaceError,
        "STL, OBJ",
    ),
    case(
        "mesh in millimetres",
        lambda s: m.read_surface(s.comm, s.file("mm.obj", obj(TETRAHEDRON, size=80.0))),
        e.UnitError,
        "80 m",
        "scale = 1e-3",
        risky=True,
    ),
    case(
        "mesh scaled away",
        lambda s: m.read_surface(s.comm, s.file("t.obj", obj(TETRAHEDRON)), scale=1e300),
        e.UnitError,
        "scale = 1e+300",
    ),
    case(
        "mesh scaled to nothing",
        lambda s: m.read_surface(s.comm, s.file("t.obj", obj(TETRAHEDRON)), scale=1e-9),
        e.UnitError,
        "scale",
    ),
    case(
        "scale is text",
        lambda s: m.read_surface(s.comm, s.file("t.obj", obj(TETRAHEDRON)), scale="mm"),
        P,
        "scale = 'mm'",
    ),
    case(
        "scale is negative",
        lambda s: m.read_surface(s.comm, s.file("t.obj", obj(TETRAHEDRON)), scale=-1),
        P,
        "scale = -1",
    ),
    case(
        "component is a half",
        lambda s: m.read_surface(s.comm, s.file("t.obj", obj(TETRAHEDRON)), component=0.5),
        P,
        "component = 0.5",
    ),
    case(
        "face of a missing vertex",
        lambda s: m.read_surface(s.comm, s.file("f.obj", obj("1 2 9"))),
        e.SurfaceError,
        "vertices are 0",
    ),
    case(
        "coordinates are NaN",
        lambda s: m.read_surface(s.comm, s.file("n.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")),
        e.SurfaceError,
        "not finite",
    ),
    case(
        "points only",
        lambda s: m.read_surface(s.comm, s.file("p.obj", "v 0 0 0\nv 1 0 0\n")),
        e.SurfaceError,
        "no triangles",
    ),
    case(
        "target file is missing",
        lambda s: m.from_mesh(s.comm, s.folder / "none.ply", s.pattern),
        e.TargetError,
        "no file",
    ),
    case(
        "target file is another mesh",
        lambda s: m.from_mesh(s.comm, s.file("t.obj", obj(TETRAHEDRON)), s.pattern),
        e.TargetError,
        "4 vertices",
    ),
    case(
        "target file without a pattern",
        lambda s: m.from_mesh(s.comm, s.folder / "none.ply", None),
        P,
        "must be a Pattern",
    ),
    case(
        "pattern file is noise",
        lambda s: m.read_pattern(s.comm, s.file("p.npz", "noise")),
        e.PatternFileError,
        "cannot be read",
    ),
    case(
        "tile's folder is missing",
        lambda s: read_tile(s.comm, s.folder / "none"),
        e.TileFileError,
        "cannot be read",
        risky=True,
    ),
    case(
        "tile is noise",
        lambda s: read_tile(s.comm, s.file("tile.npz", "PK\x03\x04 noise").parent),
        e.TileFileError,
        "tile.npz",
    ),
]

TARGETS = [
    case(
        "bend of 180 in degrees",
        lambda s: m.bend(180.0, 0.15),
        P,
        "angle = 180 rad",
        "np.radians(180)",
        risky=True,
    ),
    case("bend is text", lambda s: m.bend("90", 0.1), P, "angle = '90'"),
    case("bend is NaN", lambda s: m.bend(NAN, 0.1), P, "angle = nan"),
    case("bend of no length", lambda s: m.bend(1.0, 0.0), P, "length = 0.0"),
    case("twist in degrees", lambda s: m.twist(300.0, 0.1), P, "300 rad", "degrees"),
    case("twist is a list", lambda s: m.twist([1.0], 0.1), P, "angle = [1.0]"),
    case("contract to nothing", lambda s: m.contract(0.0), P, "axial = 0.0"),
    case("contract is text", lambda s: m.contract("0.9"), P, "axial = '0.9'"),
    case(
        "curl's direction is text",
        lambda s: m.curl(1.0, 0.1, origin=(0, 0, 0), along="z", toward=(1, 0, 0)),
        P,
        "along = 'z'",
    ),
    case(
        "stand's directions are text",
        lambda s: m.stand(1.0, 0.1, directions="out", root=0.01),
        P,
        "directions = 'out'",
    ),
    case("composed of a number", lambda s: m.compose(3.0), P, "deformers[0] = 3.0"),
    case(
        "target is text",
        lambda s: s.designed(target="bend"),
        e.TargetError,
        "target = 'bend'",
        risky=True,
    ),
    case("target is None", lambda s: s.designed(target=None), e.TargetError, "target = None"),
    case(
        "target is short",
        lambda s: s.designed(target=s.pattern.points[:-1]),
        e.TargetError,
        "shape",
    ),
    case(
        "target is NaN",
        lambda s: s.designed(target=s.pattern.points * NAN),
        e.TargetError,
        "not finite",
    ),
    case(
        "target is complex",
        lambda s: s.designed(target=s.pattern.points * 1j),
        e.TargetError,
        "real numbers",
    ),
    case(
        "target in millimetres",
        lambda s: s.designed(target=1e3 * s.pattern.points),
        e.TargetError,
        "millimetres",
        "1e-3",
        risky=True,
    ),
    case(
        "target is far away",
        lambda s: s.designed(target=s.pattern.points + 5.0),
        e.TargetError,
        "away from the skin",
    ),
    case(
        "target map returns text",
        lambda s: s.designed(target=lambda x: "bent"),
        e.TargetError,
        "target = 'bent'",
    ),
]

MATERIALS = [
    case("modulus is text", lambda s: tf.Material("1e5", 0.3, 5e-4), P, "Material.young = '1e5'"),
    case("modulus is zero", lambda s: tf.Material(0.0, 0.3, 5e-4), P, "Material.young = 0.0"),
    case(
        "modulus is a list",
        lambda s: tf.Material([1e5], 0.3, 5e-4),
        P,
        "Material.young = [100000.0]",
    ),
    case(
        "thickness is None", lambda s: tf.Material(1e5, 0.3, None), P, "Material.thickness = None"
    ),
    case(
        "Poisson's ratio is 0.9", lambda s: tf.Material(1e5, 0.9, 5e-4), P, "poisson = 0.9", "0.5"
    ),
    case(
        "fabric is a name",
        lambda s: tf.Composite(fabric="cotton"),
        P,
        "fabric = 'cotton'",
        "Material",
    ),
    case(
        "reinforcement is a number",
        lambda s: tf.Composite(reinforcement=26e6),
        P,
        "must be a Material",
    ),
    case("c1 is text", lambda s: tf.Composite(c1="2"), P, "c1 = '2'"),
    case("c1 is one", lambda s: tf.Composite(c1=1.0), P, "c1 = 1.0", "greater than 1"),
    case("membrane is text", lambda s: tf.Composite(membrane="thin"), P, "must be a Membrane"),
    case("curvature is unknown", lambda s: tf.Bending("cubic"), P, "'midedge'"),
    case("curvature is None", lambda s: tf.Bending(None), P, "curvature = None"),
    case(
        "bladder's modulus is text", lambda s: tf.Bladder("soft", 1e-4), P, "Bladder.young = 'soft'"
    ),
    case("grain is text", lambda s: tf.Knit(2.0, "45"), P, "grain of all panels = '45'"),
    case("weight is text", lambda s: tf.Weight("light", 1.0), P, "fabric = 'light'"),
    case(
        "gravity is a number", lambda s: tf.Weight(0.1, 0.2, 9.81), P, "gravity", "three components"
    ),
    case("gravity is text", lambda s: tf.Weight(0.1, 0.2, "down"), P, "gravity = 'down'"),
]

SUPPORTS = [
    case("clamped panels are text", lambda s: tf.clamp(s.pattern, "base"), P, "['base']"),
    case("clamped panels are numbers", lambda s: tf.clamp(s.pattern, [0]), P, "list of names"),
    case("clamped panels are None", lambda s: tf.clamp(s.pattern, None), P, "panels = None"),
    case("clamped pattern is a skin", lambda s: tf.clamp(s.skin, ["base"]), P, "must be a Pattern"),
    case(
        "region is text", lambda s: tf.clamp_where(s.pattern, "z < 5 mm"), P, "where = 'z < 5 mm'"
    ),
    case(
        "region is empty",
        lambda s: tf.clamp_where(s.pattern, lambda x: x[:, 2] > 9),
        P,
        "no vertex",
        "unit",
    ),
    case(
        "region returns numbers",
        lambda s: tf.clamp_where(s.pattern, lambda x: x[:, 2]),
        P,
        "True or False",
    ),
    case(
        "supports from a list",
        lambda s: tf.Supports([1, 2, 3]),
        P,
        "fixed = [1, 2, 3]",
        "(n, 3)",
        risky=True,
    ),
    case(
        "supports from integers", lambda s: tf.Supports(np.zeros((9, 3), int)), P, "True or False"
    ),
    case(
        "supports of another pattern",
        lambda s: tf.EquilibriumSolver(
            s.skin, tf.Composite(bending=None), tf.Supports(np.ones((3, 3), bool))
        ),
        P,
        "supports.fixed has shape (3, 3)",
    ),
    case("guides are text", lambda s: tf.Supports(s.held.fixed, "edge"), P, "guided = 'edge'"),
    case(
        "displaced by a word",
        lambda s: tf.displace(s.pattern, ["tip"], "up"),
        P,
        "displacement = 'up'",
        risky=True,
    ),
    case(
        "displaced by NaN",
        lambda s: tf.displace(s.pattern, ["tip"], [0, 0, NAN]),
        P,
        "displacement[2] = nan",
    ),
    case("displaced by a number", lambda s: tf.displace(s.pattern, ["tip"], 0.01), P, "shape ()"),
    case("pinned panel is unknown", lambda s: tf.pin(s.pattern, "top"), e.PanelError, "'top'"),
    case("symmetry across axis 7", lambda s: tf.symmetry_plane(s.pattern, 7), P, "axis = 7"),
    case("symmetry across a letter", lambda s: tf.symmetry_plane(s.pattern, "x"), P, "axis = 'x'"),
    case(
        "built-in vertices are numbers",
        lambda s: tf.build_in(s.pattern, [1, 2]),
        P,
        "True or False",
    ),
    case(
        "nothing is fixed",
        lambda s: tf.EquilibriumSolver(
            s.skin, tf.Composite(bending=None), tf.Supports(np.zeros_like(s.held.fixed))
        ),
        P,
        "rigid motions",
    ),
    case(
        "chambers are short",
        lambda s: tf.EquilibriumSolver(
            s.skin, tf.Composite(bending=None), s.held, chambers=tf.Chambers(("a", "b"), [0, 1])
        ),
        P,
        "chambers.of_cell has shape (2,)",
        risky=True,
    ),
    case(
        "chambers leave a number out",
        lambda s: tf.Chambers(("a", "b"), [0, 2]),
        P,
        "each of 0 to 1",
    ),
    case(
        "chambers hold 100 000 numbers",
        lambda s: tf.Chambers(("a",), np.arange(100_000)),
        P,
        "0, 1, 2, 3, 4, 5, …",
    ),
    case("chambers are words", lambda s: tf.Chambers(("a",), ["a", "a"]), P, "of_cell ="),
    case("chambers' name is text", lambda s: tf.Chambers("ab", [0, 1]), P, "list of names"),
    case(
        "chambers of panels are a list",
        lambda s: chambers_of_panels(s.pattern, ["base"]),
        P,
        "a mapping",
    ),
    case(
        "force is a word", lambda s: tf.spread_force(s.pattern, "tip", "down"), P, "force = 'down'"
    ),
    case(
        "force at no place", lambda s: tf.point_force(s.pattern, (9, 9, 9), (0, 0, 1)), P, "m away"
    ),
]


def _solver(s: Scene, **changes: Any) -> tf.EquilibriumSolver:
    given = {"skin": s.skin, "composite": tf.Composite(bending=None), "supports": s.held}
    return tf.EquilibriumSolver(**{**given, **changes})


SOLVES = [
    case("skin is a pattern", lambda s: _solver(s, skin=s.pattern), P, "must be a Skin", "sew"),
    case(
        "composite is a material",
        lambda s: _solver(s, composite=tf.Material(1e5, 0.3, 5e-4)),
        P,
        "must be a Composite",
    ),
    case("supports are None", lambda s: _solver(s, supports=None), P, "supports = None", "clamp"),
    case("options are a dict", lambda s: _solver(s, options={"max_steps": 3}), P, "NewtonOptions"),
    case("log is text", lambda s: _solver(s, log="verbose"), P, "log = 'verbose'"),
    case("steps are 1.5", lambda s: tf.NewtonOptions(max_steps=1.5), P, "max_steps = 1.5", "whole"),
    case(
        "tolerance is text", lambda s: tf.NewtonOptions(tolerance="tight"), P, "tolerance = 'tight'"
    ),
    case(
        "pressure is None",
        lambda s: s.solver.solve(s.plain, pressure=None),
        P,
        "pressure = None",
        risky=True,
    ),
    case(
        "pressure is text",
        lambda s: s.solver.solve(s.plain, "5 kPa"),
        P,
        "pressure = '5 kPa'",
        "in Pa",
    ),
    case(
        "pressure is negative",
        lambda s: s.solver.solve(s.plain, -1.0),
        P,
        "pressure = -1.0 Pa",
        "at least 0",
        risky=True,
    ),
    case("pressure is NaN", lambda s: s.solver.solve(s.plain, NAN), P, "pressure = nan"),
    case("pressure is complex", lambda s: s.solver.solve(s.plain, 1j), P, "real numbers"),
    case(
        "pressure is 100 000 numbers", lambda s: s.solver.solve(s.plain, LONG), P, "shape (100000,)"
    ),
    case(
        "density is text",
        lambda s: s.solver.solve("plain", 10.0),
        e.DensityError,
        "density = 'plain'",
        risky=True,
    ),
    case("density is None", lambda s: s.solver.solve(None, 10.0), e.DensityError, "density = None"),
    case(
        "density is complex",
        lambda s: s.solver.solve(s.plain + 0.5j, 10.0),
        e.DensityError,
        "real numbers",
    ),
    case(
        "density is objects",
        lambda s: s.solver.solve(s.plain.astype(object), 10.0),
        e.DensityError,
        "real numbers",
    ),
    case(
        "density is a number",
        lambda s: s.solver.solve(0.5, 10.0),
        e.DensityError,
        "shape ()",
        "triangles",
    ),
    case("density is long", lambda s: s.solver.solve(LONG, 10.0), e.DensityError, "owns"),
    case(
        "density leaves its bounds",
        lambda s: s.solver.solve(s.plain + 1.5, 10.0),
        e.DensityError,
        "1.5",
        "[0, 1]",
    ),
    case("density is NaN", lambda s: s.solver.solve(s.plain * NAN, 10.0), e.DensityError, "nan"),
    case(
        "force is flat",
        lambda s: s.solver.solve(s.plain, 10.0, force=np.zeros(3)),
        P,
        "force has shape (3,)",
    ),
    case(
        "displacement is text",
        lambda s: s.solver.solve(s.plain, 10.0, displacement="up"),
        P,
        "displacement = 'up'",
    ),
    case(
        "start is text", lambda s: s.solver.solve(s.plain, 10.0, start="flat"), P, "start = 'flat'"
    ),
    case(
        "start is short",
        lambda s: s.solver.solve(s.plain, 10.0, start=np.zeros(2)),
        P,
        "start has shape (2,)",
    ),
    case(
        "start is collapsed",
        lambda s: s.solver.solve(s.plain, 10.0, start=0 * s.result.state),
        P,
        "stretch bounds",
    ),
    case(
        "trial is a word", lambda s: s.solver.solve(s.plain, 10.0, trial="yes"), P, "trial = 'yes'"
    ),
    case("path of one pressure", lambda s: tf.trace(s.solver, s.plain, 1e3), P, "all pressures"),
    case(
        "path of text",
        lambda s: tf.trace(s.solver, s.plain, ["low", "high"]),
        P,
        "pressure = 'low'",
    ),
    case(
        "path into vacuum",
        lambda s: tf.trace(s.solver, s.plain, [1e3, -1e3]),
        P,
        "-1000.0 Pa",
        risky=True,
    ),
    case(
        "path by time",
        lambda s: tf.trace(s.solver, s.plain, [1e3], by="time"),
        P,
        "by = 'time'",
        "'arc-length'",
    ),
    case("path of a skin", lambda s: tf.trace(s.skin, s.plain, [1e3]), P, "EquilibriumSolver"),
    case(
        "first increment is zero",
        lambda s: tf.ArcLengthOptions(first_increment=0),
        P,
        "first_increment = 0",
    ),
    case("limit points of numbers", lambda s: tf.limit_points([1.0, 2.0]), P, "TracePoints"),
    case("limit points of a path", lambda s: tf.limit_points(iter([])), P, "list(trace(…))"),
    case(
        "states in 0 tries",
        lambda s: tf.find_states(s.solver, s.plain, 10.0, tries=0),
        P,
        "tries = 0",
    ),
    case(
        "states by a word",
        lambda s: tf.find_states(s.solver, s.plain, 10.0, seed="x"),
        P,
        "seed = 'x'",
    ),
    case(
        "error of nothing",
        lambda s: tf.estimate_error(s.solver, s.plain, None, [tf.swelling]),
        P,
        "EquilibriumResult",
    ),
    case(
        "error of a function",
        lambda s: tf.estimate_error(s.solver, s.plain, s.result, tf.swelling),
        P,
        "list of functions",
    ),
    case(
        "error of a name",
        lambda s: tf.estimate_error(s.solver, s.plain, s.result, ["swelling"]),
        P,
        "quantities[0] = 'swelling'",
    ),
    case(
        "wrinkles of a membrane",
        lambda s: tf.wrinkle_field(s.solver, s.plain, s.result),
        P,
        "tension-field",
    ),
    case(
        "wrinkles of nothing",
        lambda s: tf.wrinkle_field(s.solver, s.plain, None),
        P,
        "EquilibriumResult",
    ),
]


def _metric(value: Any, name: str = "height", unit: str = "mm") -> tf.Metric:
    return tf.Metric(name, unit, None, lambda pattern, positions: value)


def _measured(s: Scene, *metrics: tf.Metric) -> list[tf.TracePoint]:
    return list(tf.trace(s.solver, s.plain, [500.0], list(metrics)))


METRICS = [
    case("metric's name is a sentence", lambda s: _metric(1.0, "bend angle"), P, "identifiers"),
    case("metric's name is a number", lambda s: _metric(1.0, 3), P, "name = 3"),
    case(
        "metric's target is text",
        lambda s: tf.Metric("a", "deg", "90", tf.bend_angle),
        P,
        "target of the metric a = '90'",
    ),
    case("metric's target is NaN", lambda s: tf.Metric("a", "deg", NAN, tf.bend_angle), P, "nan"),
    case(
        "metric's function is a name",
        lambda s: tf.Metric("a", "deg", 90.0, "bend_angle"),
        P,
        "measure = 'bend_angle'",
    ),
    case(
        "metric returns NaN",
        lambda s: _measured(s, _metric(NAN)),
        e.MetricError,
        "'height_mm' returned nan",
        risky=True,
    ),
    case(
        "metric returns None", lambda s: _measured(s, _metric(None)), e.MetricError, "returned None"
    ),
    case(
        "metric returns an array",
        lambda s: _measured(s, _metric(LONG)),
        e.MetricError,
        "an array of shape (100000,)",
    ),
    case(
        "two metrics of a name",
        lambda s: tf.trace(s.solver, s.plain, [1.0], [_metric(1.0), _metric(2.0)]),
        P,
        "two metrics are named 'height_mm'",
        risky=True,
    ),
    case(
        "metrics of a design have one name",
        lambda s: s.designed(metrics=[_metric(1.0)] * 2),
        P,
        "overwrite",
    ),
    case(
        "metric hides the pressure",
        lambda s: s.designed(metrics=[_metric(1.0, "pressure", "pa")]),
        P,
        "'pressure_pa'",
    ),
    case(
        "metrics are one metric", lambda s: s.designed(metrics=_metric(1.0)), P, "list of Metrics"
    ),
    case(
        "metrics are functions",
        lambda s: s.designed(metrics=[tf.bend_angle]),
        P,
        "Metrics, by Metric",
    ),
    case(
        "gap's body is text",
        lambda s: tf.GapObjective(s.skin, "ball", np.ones(9)),
        P,
        "must be a Body",
    ),
    case(
        "gap's weights are short",
        lambda s: tf.GapObjective(s.skin, tf.Body("sphere", 0.01, (0, 0, 0)), np.ones(9)),
        P,
        "weights have shape (9,)",
    ),
    case("body's centre is a number", lambda s: tf.Body("sphere", 0.01, 0.0), P, "centre"),
    case(
        "body is a cone",
        lambda s: tf.Body("cone", 0.01, (0, 0, 0)),
        P,
        "shape = 'cone'",
        "'sphere'",
    ),
    case(
        "weights are negative",
        lambda s: tf.ShapeObjective(s.skin, s.pattern.points, -np.ones(len(s.pattern.points))),
        P,
        "not negative",
    ),
    case(
        "weights are text",
        lambda s: tf.ShapeObjective(s.skin, s.pattern.points, "area"),
        P,
        "weights = 'area'",
    ),
    case(
        "labels are text",
        lambda s: tf.CrossSections("rings", np.ones((1, 3)), np.ones(1)),
        P,
        "labels = 'rings'",
    ),
]

DESIGNS = [
    case("filter radius is zero", lambda s: s.designed(filter_radius=0), P, "filter radius = 0"),
    case(
        "filter radius is text",
        lambda s: s.designed(filter_radius="5 mm"),
        P,
        "filter radius = '5 mm'",
    ),
    case(
        "filter radius over the skin",
        lambda s: s.designed(filter_radius=3.0),
        P,
        "larger than the skin",
        risky=True,
    ),
    case(
        "filter radius of Helmholtz over the skin",
        lambda s: tf.make_filter("helmholtz", s.skin, 3.0),
        P,
        "larger than the skin",
    ),
    case(
        "filter is unknown", lambda s: s.designed(filter="gauss"), P, "filter = 'gauss'", "'cone'"
    ),
    case(
        "filter of a pattern",
        lambda s: tf.make_filter("cone", s.pattern, 0.01),
        P,
        "must be a Skin",
    ),
    case("threshold is 0", lambda s: tf.Projection(eta=0), P, "eta = 0", "between 0 and 1"),
    case("threshold is 1", lambda s: tf.Projection(eta=1.0), P, "eta = 1.0"),
    case("steepness is text", lambda s: tf.Projection(beta="steep"), P, "beta = 'steep'"),
    case(
        "projection is a number", lambda s: s.designed(projection=20.0), P, "must be a Projection"
    ),
    case("widths are text", lambda s: tf.LengthScale(line_width="1 mm"), P, "line_width = '1 mm'"),
    case(
        "passive is short",
        lambda s: s.designed(passive=np.zeros(3)),
        e.DensityError,
        "passive has shape (3,)",
        risky=True,
    ),
    case(
        "passive is text", lambda s: s.designed(passive="base"), e.DensityError, "passive = 'base'"
    ),
    case(
        "passive everywhere",
        lambda s: s.designed(passive=np.ones(len(s.pattern.panel))),
        e.DensityError,
        "none is designed",
    ),
    case(
        "passive is 2",
        lambda s: s.designed(passive=np.full(len(s.pattern.panel), 2.0)),
        e.DensityError,
        "[0, 1]",
    ),
    case(
        "start of a design is short",
        lambda s: s.designed(start=np.full(3, 0.5)),
        e.DensityError,
        "start has shape (3,)",
    ),
    case(
        "start of a design is text",
        lambda s: s.designed(start="grey"),
        e.DensityError,
        "start = 'grey'",
    ),
    case(
        "start of a design is 0",
        lambda s: s.designed(start=np.zeros(len(s.pattern.panel))),
        e.DensityError,
        "[0.1, 0.9]",
    ),
    case("printed panels are text", lambda s: s.designed(printed_panels="base"), P, "['base']"),
    case(
        "printed panel is unknown",
        lambda s: s.designed(printed_panels=["cap"]),
        e.PanelError,
        "'cap'",
        "'base'",
    ),
    case(
        "design's pressure is text", lambda s: s.designed(pressure="5 kPa"), P, "pressure = '5 kPa'"
    ),
    case("design's pressure is None", lambda s: s.designed(pressure=None), P, "pressure = None"),
    case(
        "pressure bounds are one number",
        lambda s: s.designed(pressure_bounds=1e4),
        P,
        "pressure_bounds = 10000.0",
    ),
    case(
        "pressure bounds are exchanged",
        lambda s: s.designed(pressure_bounds=(2e3, 1e2)),
        P,
        "no room",
    ),
    case(
        "pressure bounds are three",
        lambda s: s.designed(pressure_bounds=(1.0, 2.0, 3.0)),
        P,
        "two numbers",
    ),
    case(
        "perimeter's weight is negative",
        lambda s: s.designed(perimeter_weight=-1.0),
        P,
        "perimeter_weight = -1.0",
    ),
    case(
        "perimeter's sharpness is 0",
        lambda s: s.designed(perimeter_weight=1.0, perimeter_sharpness=0),
        P,
        "sharpness = 0",
    ),
    case("objective is text", lambda s: s.designed(objective="shape"), P, "objective = 'shape'"),
    case("symmetry is text", lambda s: s.designed(symmetry="y"), P, "symmetry = 'y'"),
    case(
        "force of a design is short",
        lambda s: tf.optimize(s.designed(force=np.zeros(3)), [tf.Stage(1)]),
        P,
        "force has shape (3,)",
    ),
    case("no stage", lambda s: tf.DesignOptions(stages=()), P, "at least one Stage"),
    case(
        "stages are numbers",
        lambda s: tf.optimize(s.design, [60, 40]),
        P,
        "Stages, by Stage(iterations)",
    ),
    case("stages are a number", lambda s: tf.optimize(s.design, 60), P, "list of Stages"),
    case("one stage", lambda s: tf.optimize(s.design, tf.Stage(2)), P, "[Stage(…)]"),
    case("stage of half a step", lambda s: tf.Stage(0.5), P, "iterations = 0.5"),
    case(
        "stage is constrained by a word",
        lambda s: tf.Stage(5, constrained="yes"),
        P,
        "constrained = 'yes'",
    ),
    case(
        "stage without widths",
        lambda s: tf.optimize(s.design, [tf.Stage(1, constrained=True)]),
        P,
        "length_scale",
    ),
    case(
        "seed is negative",
        lambda s: tf.optimize(s.design, [tf.Stage(1)], seed=-1),
        P,
        "seed = -1",
        risky=True,
    ),
    case(
        "seed is a half", lambda s: tf.optimize(s.design, [tf.Stage(1)], seed=0.5), P, "seed = 0.5"
    ),
    case("optimised skin", lambda s: tf.optimize(s.skin, [tf.Stage(1)]), P, "design problem"),
    case(
        "callback is text",
        lambda s: tf.optimize(s.design, [tf.Stage(1)], callback="print"),
        P,
        "callback = 'print'",
    ),
    case(
        "optimisation starts at text",
        lambda s: tf.optimize(s.design, [tf.Stage(1)], start="grey"),
        e.DensityError,
        "density = 'grey'",
    ),
    case(
        "levels without options",
        lambda s: tf.optimize_levels([s.design], []),
        P,
        "options is empty",
    ),
    case("refined 0 times", lambda s: next(tf.refinements(s.design, 0)), P, "levels = 0"),
    case("moving limit is 2", lambda s: MMAOptions(move=2.0), P, "move = 2.0", "at most 1"),
    case(
        "random density leaves its bounds",
        lambda s: tf.random_density(s.skin, 0, mean=0.95),
        e.DensityError,
        "0.95",
    ),
    case(
        "random density of text",
        lambda s: tf.random_density(s.skin, 0, mean="half"),
        P,
        "mean = 'half'",
    ),
    case("lines of a word", lambda s: tf.LineField(s.pattern, "some", "0"), P, "shares = 'some'"),
    case(
        "lines of negative shares",
        lambda s: tf.LineField(
            s.pattern, -np.ones((len(s.pattern.panel), 1)), np.zeros((len(s.pattern.panel), 1))
        ),
        P,
        "negative share",
    ),
    case("lines laid on a pattern", lambda s: tf.lay_lines(s.pattern), P, "must be a LineField"),
    case("lines of no width", lambda s: tf.LineOptions(widths=()), P, "widths is empty"),
    case(
        "lines' width is a number", lambda s: tf.LineOptions(widths=1e-3), P, "widths has shape ()"
    ),
    case("lines found for a skin", lambda s: tf.find_lines(s.skin), P, "ShapeProblem"),
    case("lines' steps are a number", lambda s: tf.RelaxedOptions(iterations=40), P, "two numbers"),
    case("print's width is text", lambda s: tf.PrintLimits(width="0.6 mm"), P, "width = '0.6 mm'"),
    case("print of nothing", lambda s: tf.as_printed(s.design, None), P, "DesignResult"),
    case(
        "islands larger than the skin",
        lambda s: require_island_area(s.pattern, 20.0),
        P,
        "island_area = 20.0",
        "20e-6",
    ),
]


def _vector(*values: float) -> PETSc.Vec:
    return PETSc.Vec().createWithArray(np.array(values), comm=MPI.COMM_SELF)


def _mma() -> MMA:
    return MMA(_vector(0.0, 0.0), _vector(1.0, 1.0))


OPTIMIZER = [
    case("MMA's bounds are lists", lambda s: MMA([0.0], [1.0]), P, "PETSc.Vec"),
    case("MMA's bounds are exchanged", lambda s: MMA(_vector(1.0), _vector(0.0)), P, "Exchange"),
    case(
        "MMA's bounds are infinite", lambda s: MMA(_vector(0.0), _vector(INF)), P, "finite bounds"
    ),
    case(
        "MMA's bounds have other sizes",
        lambda s: MMA(_vector(0.0), _vector(1.0, 1.0)),
        P,
        "different sizes",
    ),
    case(
        "MMA's constraints are a half",
        lambda s: MMA(_vector(0.0), _vector(1.0), 0.5),
        P,
        "constraints = 0.5",
    ),
    case(
        "MMA's value is NaN",
        lambda s: _mma().step(_vector(0.5, 0.5), NAN, _vector(1.0, 1.0)),
        P,
        "value = nan",
    ),
    case(
        "MMA's gradient is NaN",
        lambda s: _mma().step(_vector(0.5, 0.5), 1.0, _vector(NAN, 1.0)),
        P,
        "gradient is not finite",
    ),
    case(
        "MMA's values are too many",
        lambda s: _mma().step(_vector(0.5, 0.5), 1.0, _vector(1.0, 1.0), [1.0]),
        P,
        "0 constraints",
    ),
]


def _tile(printed: Any, **changes: Any) -> PrintedTile:
    return PrintedTile(**{"printed": printed, "size": (0.01, 0.01), "edge_length": 2e-3, **changes})


OUTPUTS = [
    case(
        "fields into a missing folder",
        lambda s: write_fields(s.folder / "no" / "a.vtu", s.pattern, s.pattern.points, {}),
        e.OutputError,
        "Make its folder first",
    ),
    case(
        "fields of other triangles",
        lambda s: write_fields(
            s.folder / "a.vtu", s.pattern, s.pattern.points, {"rho": np.zeros(3)}
        ),
        P,
        "cell_fields['rho'] has shape (3,)",
    ),
    case(
        "fields as text",
        lambda s: write_fields(s.folder / "a.txt", s.pattern, s.pattern.points, {}),
        P,
        ".vtu",
    ),
    case(
        "output is a file",
        lambda s: write_pictures(s.comm, s.file("file", "") / "x", {}),
        e.OutputError,
        "could not be written",
        risky=True,
    ),
    case(
        "reporter in a file",
        lambda s: tf.DesignReporter(s.comm, s.file("file", "")),
        e.OutputError,
        "could not be written",
    ),
    case("results of nothing", lambda s: tf.write_results(s.folder, None, None), P, "DesignResult"),
    case("tile printed as a list", lambda s: _tile([True]), e.DensityError, "printed"),
    case("tile printed in numbers", lambda s: _tile(np.zeros(4)), e.DensityError, "bool"),
    case("tile's size is a word", lambda s: _tile(np.ones(4, bool), size="cm"), P, "size"),
    case(
        "tile of another mesh",
        lambda s: _tile(np.ones(4, bool)).tile(s.comm),
        e.DensityError,
        "printed has 4 triangles",
    ),
]


def _island(s: Scene) -> object:
    config = BendConfig(edge_length=5e-3, filter_radius=0.01, island_area=1.0, levels=1)
    return actuator_problem(s.comm, bend_case(s.comm, config), config)


SCENES = [
    case(
        "curve ends below the pressure",
        lambda s: InflateConfig(pressure=50e3),
        P,
        "pressure = 50000 Pa",
        "highest_pressure = 20000 Pa",
    ),
    case(
        "inflation in one level", lambda s: InflateConfig(levels=1), P, "levels = 1", "at least 2"
    ),
    case("inflation in no level", lambda s: InflateConfig(levels=0), P, "levels = 0"),
    case(
        "twist of no sections",
        lambda s: TwistConfig(cross_sections=0),
        P,
        "cross_sections = 0",
        "at least 1",
    ),
    case("twist of many turns", lambda s: TwistConfig(twist=1e5), P, "100000", "2160"),
    case(
        "bend of many turns",
        lambda s: BendConfig(angle=1e4),
        P,
        "angle = 10000.0 deg",
        "at most 720",
    ),
    case(
        "bend of a scene is text", lambda s: BendConfig(angle="90"), P, "angle = '90'", "a number"
    ),
    case(
        "bend of an unknown number",
        lambda s: BendConfig(angel=90.0),
        P,
        "'angel'",
        "did you mean 'angle'?",
    ),
    case("bend of half a seed", lambda s: BendConfig(seed=0.5), P, "seed = 0.5"),
    case(
        "gripper lifts less than nothing",
        lambda s: GripperConfig(mass=-1.0),
        P,
        "mass = -1.0 kg",
        "above 0",
    ),
    case(
        "gripper wraps by NaN", lambda s: GripperConfig(wrap_angle=NAN), P, "wrap_angle = nan deg"
    ),
    case(
        "walker slides without friction",
        lambda s: WalkerConfig(pad_friction=0.0),
        P,
        "pad_friction = 0",
        "above 0",
    ),
    case("walker flies", lambda s: WalkerConfig(motion="fly"), P, "motion = 'fly'", "'crawl'"),
    case("islands of a scene larger than its skin", _island, P, "island_area = 1.0 m²", risky=True),
    case(
        "Poisson's ratio of a scene", lambda s: BendConfig(poisson=0.6), P, "poisson = 0.6", "0.5"
    ),
    case(
        "fabric of a scene without stiffness",
        lambda s: BendConfig(fabric_young=0.0),
        P,
        "fabric_young = 0.0 Pa",
    ),
    case("threshold of a scene", lambda s: BendConfig(eta=1.0), P, "eta = 1.0", "below 1"),
]


MINE: dict[str, Any] = {
    "name": "mine", "kind": "fabric", "title": "mine", "young": 1e5, "poisson": 0.3,
    "thickness": 5e-4, "stretch_range": (1.0, 1.5), "source": "a test", "trust": "measured",
}  # fmt: skip


def _material(**changes: Any) -> LibraryMaterial:
    return LibraryMaterial(**{**MINE, **changes})


LIBRARY = [
    case("young is text", lambda s: _material(young="1 MPa"), P, "young = '1 MPa'", "a number"),
    case("a name is a path", lambda s: _material(name="../mine"), P, "name = '../mine'"),
    case("a name is none", lambda s: _material(name="none"), P, "not 'none'"),
    case("trust is another word", lambda s: _material(trust="high"), P, "'measured'"),
    case("thickness in mm", lambda s: _material(thickness=0.5), P, "thickness = 0.5", "0.05"),
    case("range is an array", lambda s: _material(stretch_range=LONG), P, "stretch_range"),
    case("range is NaN", lambda s: _material(stretch_range=(1.0, NAN)), P, "not finite"),
    case("title is long", lambda s: _material(title=100 * "x"), P, "title =", "60 characters"),
    case("source is missing", lambda s: _material(source=None), P, "source = None"),
    case("library is a number", lambda s: read_library(3), e.LibraryError, "path = 3", "as text"),
    case(
        "library is missing",
        lambda s: read_library(s.folder / "no.toml", comm=s.comm),
        e.LibraryError,
        "no.toml cannot be read",
        risky=True,
    ),
    case(
        "library is a folder",
        lambda s: read_library(s.folder, comm=s.comm),
        e.LibraryError,
        "is a folder; name a file of materials",
        risky=True,
    ),
    case(
        "material is unknown",
        lambda s: named(read_library(), "tpu-95"),
        e.LibraryError,
        "did you mean 'tpu-95a'?",
    ),
    case(
        "entry is a dict", lambda s: write_material(s.folder / "m.toml", MINE), P, "LibraryMaterial"
    ),
]


CASES = [
    *LIBRARY,
    *SCENES,
    *MESHES,
    *PATTERNS,
    *FILES,
    *TARGETS,
    *MATERIALS,
    *SUPPORTS,
    *SOLVES,
    *METRICS,
    *DESIGNS,
    *OPTIMIZER,
    *OUTPUTS,
]


@pytest.fixture(scope="module")
def scene(comm: MPI.Comm, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return Scene(comm, shared(comm, tmp_path_factory.mktemp("bad")))


@pytest.mark.parametrize("bad", CASES, ids=str)
def test_bad_input(scene: Scene, bad: Case) -> None:
    """All ranks raise the same error, which is short and names what is wrong."""
    if scene.comm.size > 1 and not bad.risky:
        pytest.skip("tried on one rank")
    with pytest.raises(bad.error) as caught:
        bad.call(scene)
    message = str(caught.value)
    assert isinstance(caught.value, e.TorosError)
    assert type(caught.value).__name__ != "TorosError"
    for word in bad.words:
        assert word in message, message
    assert len(message) <= LONGEST, f"{len(message)} characters: {message}"
    assert re.search(r"[.?]$", message), message
    assert len(set(scene.comm.allgather(message))) == 1


def test_there_are_enough_cases() -> None:
    names = [bad.name for bad in CASES]
    assert len(set(names)) == len(names) >= 120
    assert sum(bad.risky for bad in CASES) >= 20


DIFFERENT: dict[str, Callable[[Scene], object]] = {
    "length": lambda s: m.cylinder(s.comm, s.by_rank(0.04, 0.05), 0.02, 7e-3),
    "edge_length": lambda s: m.cylinder(s.comm, 0.04, 0.02, s.by_rank(7e-3, "fine")),
    "outline": lambda s: m.two_panels(s.comm, s.by_rank(SQUARE, SQUARE[::-1]), 4e-3),
    "path": lambda s: m.read_surface(s.comm, s.by_rank("a.stl", "b.stl")),
    "pattern": lambda s: tf.sew(s.comm, s.by_rank(s.pattern, square())),
    "composite": lambda s: _solver(s, composite=tf.Composite(c1=s.by_rank(1.9, 1.8), bending=None)),
    "supports": lambda s: _solver(s, supports=s.by_rank(s.held, tf.clamp(s.pattern, ["tip"]))),
    "pressure": lambda s: s.solver.solve(s.plain, s.by_rank(100.0, 200.0)),
    "filter_radius": lambda s: s.designed(filter_radius=s.by_rank(0.012, 0.013)),
    "target": lambda s: s.designed(target=s.by_rank(s.pattern.points, 1.1 * s.pattern.points)),
    "seed": lambda s: tf.optimize(s.design, [tf.Stage(1)], seed=s.comm.rank),
    "options": lambda s: tf.optimize(s.design, [tf.Stage(1 + s.comm.rank)]),
}


@pytest.mark.parametrize("name", list(DIFFERENT))
def test_different_arguments_on_the_ranks(scene: Scene, name: str) -> None:
    if scene.comm.size == 1:
        pytest.skip("one rank has nothing to differ from")
    with pytest.raises(e.ParameterError, match=f"{name} differs between the ranks: .* on rank 1"):
        DIFFERENT[name](scene)


def test_more_ranks_than_triangles(scene: Scene) -> None:
    """It is told before anything is distributed; as many ranks as triangles are enough."""
    comm = scene.comm
    corners = [(0.0, 0.0, 0.0), (0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.01, 0.01, 0.0)]
    triangles = [[0, 1, 2], [1, 3, 2]][: max(1, comm.size - 1)]
    pattern = m.moulded(np.array(corners)[: 2 + len(triangles)], triangles)
    if comm.size > len(triangles):
        words = f"{len(triangles)} triangles cannot be shared by {comm.size} ranks"
        with pytest.raises(e.PatternError, match=words):
            tf.sew(comm, pattern)
    else:
        assert len(tf.sew(comm, pattern).owned_cells) == len(triangles)
