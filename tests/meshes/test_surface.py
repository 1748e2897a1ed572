"""Mesh files become one oriented manifold surface, mended, or a clear error."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import basix.ufl
import dolfinx.mesh
import meshio
import numpy as np
import pytest
import ufl
from dolfinx.io import XDMFFile
from helpers import surfaces
from helpers.scenes import DATA, square
from mpi4py import MPI

from toros_fem import errors
from toros_fem.meshes import Surface, read_surface, unwrap
from toros_fem.meshes.surface import volume
from toros_fem.meshes.topology import edges_of, shapes


@pytest.fixture
def folder(comm: MPI.Comm, tmp_path: Path) -> Path:
    return Path(comm.bcast(tmp_path, root=0))


def write(comm: MPI.Comm, path: Path, points: np.ndarray, cells: object, **options: object) -> Path:
    """Write a mesh on the first rank."""
    if comm.rank == 0:
        more = {k: options.pop(k) for k in ("cell_data", "field_data") if k in options}
        meshio.Mesh(points, cells, **more).write(path, **options)
    comm.barrier()
    return path


def text(comm: MPI.Comm, path: Path, content: str) -> Path:
    if comm.rank == 0:
        path.write_text(content, encoding="utf-8")
    comm.barrier()
    return path


FORMATS: dict[str, dict[str, Any]] = {
    "stl": {"file_format": "stl", "binary": True},
    "obj": {},
    "ply": {},
    "msh": {"file_format": "gmsh"},
}


XDMF = """<Xdmf Version="3.0"><Domain><Grid Name="Grid">
<Geometry GeometryType="XYZ"><DataItem DataType="Float" Dimensions="{n} 3" Format="XML"
 Precision="8">{points}</DataItem></Geometry>
<Topology TopologyType="Triangle" NumberOfElements="{t}"><DataItem DataType="Int"
 Dimensions="{t} 3" Format="XML" Precision="8">{triangles}</DataItem></Topology>
</Grid></Domain></Xdmf>"""


def xdmf(points: np.ndarray, triangles: np.ndarray) -> str:
    """A file whose numbers are text: meshio wants h5py even to write those."""
    places = " ".join(repr(float(x)) for x in points.ravel())
    corners = " ".join(map(str, triangles.ravel()))
    return XDMF.format(n=len(points), t=len(triangles), points=places, triangles=corners)


@pytest.mark.parametrize("kind", [*FORMATS, "xdmf"])
def test_round_trip(comm: MPI.Comm, folder: Path, kind: str) -> None:
    """Every format gives the same surface and the same pattern; an STL to seven digits."""
    made = surfaces.cap(5, 1.0)[0]
    path, points = folder / f"cap.{kind}", made.points * 1e3
    if kind == "xdmf":
        text(comm, path, xdmf(points, made.triangles))
    else:
        write(comm, path, points, [("triangle", made.triangles)], **FORMATS[kind])
    found = read_surface(comm, path, scale=1e-3)
    # Vertices are numbered by first use.
    used = np.argsort(np.unique(made.triangles, return_index=True)[1])
    digits = 2e-7 if kind == "stl" else 1e-15
    assert found.points == pytest.approx(made.points[used], abs=0.01 * digits)
    assert np.array_equal(used[found.triangles], made.triangles)
    wanted = unwrap(comm, replace(found, points=made.points[used])).pattern
    pattern = unwrap(comm, found).pattern
    assert np.array_equal(pattern.flat_triangles, wanted.flat_triangles)
    assert pattern.areas == pytest.approx(wanted.areas, rel=1e3 * digits)


def test_xdmf_of_dolfinx(comm: MPI.Comm, folder: Path) -> None:
    """Its data lie in HDF5."""
    made = surfaces.cap(5, 1.0)[0]
    if comm.rank == 0:
        domain = dolfinx.mesh.create_mesh(
            MPI.COMM_SELF, cells=made.triangles, x=made.points,
            e=ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(3,))),
        )  # fmt: skip
        with XDMFFile(MPI.COMM_SELF, str(folder / "cap.xdmf"), "w") as file:
            file.write_mesh(domain)
    comm.barrier()
    found = read_surface(comm, folder / "cap.xdmf")
    assert found.area == pytest.approx(made.area, rel=1e-12)
    assert len(found.points) == len(made.points)


def test_flat_xdmf(comm: MPI.Comm, folder: Path) -> None:
    """Points of two coordinates, as text and in HDF5, lie in z = 0."""
    sheet = square(n=2)
    written = xdmf(sheet.flat_points, sheet.flat_triangles)
    flat = written.replace("XYZ", "XY").replace('"9 3"', '"9 2"')
    if comm.rank == 0:
        domain = dolfinx.mesh.create_mesh(
            MPI.COMM_SELF, cells=sheet.flat_triangles, x=sheet.flat_points,
            e=ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))),
        )  # fmt: skip
        with XDMFFile(MPI.COMM_SELF, str(folder / "hdf5.xdmf"), "w") as file:
            file.write_mesh(domain)
    for path in (text(comm, folder / "text.xmf", flat), folder / "hdf5.xdmf"):
        found = read_surface(comm, path)
        assert found.points.shape == (9, 3)
        assert found.area == pytest.approx(4e-4, rel=1e-12)
        assert np.all(found.points[:, 2] == 0)
    hdf5 = (folder / "hdf5.xdmf").read_text(encoding="utf-8")
    path = text(comm, folder / "apart.xdmf", hdf5.replace('"XY"', '"X_Y"'))
    with pytest.raises(errors.SurfaceError, match=r'apart.xdmf .* "X_Y".* Save it as STL'):
        read_surface(comm, path)
    begin, end = hdf5.index("<Grid"), hdf5.index("</Domain>")
    path = text(comm, folder / "two.xdmf", hdf5[:end] + hdf5[begin:end] + hdf5[end:])
    with pytest.raises(errors.SurfaceError, match=r"one grid.* Save it as STL"):
        read_surface(comm, path)


def test_formats_that_need_another_package(
    comm: MPI.Comm, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without h5py, as a stand-in for a package that is missing."""
    monkeypatch.setitem(sys.modules, "h5py", None)
    path = text(comm, folder / "code.med", "no mesh")
    with pytest.raises(errors.SurfaceError, match=r"lacks a package .*h5py.*Save it as STL"):
        read_surface(comm, path)


def test_box_from_separate_sides(comm: MPI.Comm, folder: Path) -> None:
    points, triangles = surfaces.box(2)
    rng = np.random.default_rng(3)
    some = rng.random(len(triangles)) < 0.4
    triangles = np.where(some[:, None], triangles[:, ::-1], triangles)
    triangles = np.concatenate([triangles, triangles[:3], triangles[:2, ::-1], [[0, 0, 1]]])
    path = write(comm, folder / "box.ply", points, [("triangle", triangles)])
    found = read_surface(comm, path)
    assert found.closed
    assert found.area == pytest.approx(2 * (6 + 3 + 2) * 1e-4, rel=1e-12)
    assert volume(found.points, found.triangles) == pytest.approx(6e-6, rel=1e-12)
    assert found.repairs.merged == 54 - 26
    assert found.repairs.dropped == 6
    assert found.repairs.turned == some.sum()
    assert "28 coincident vertices merged, 6 triangles dropped" in str(found.repairs)


def test_needles_and_caps_are_mended(comm: MPI.Comm, folder: Path) -> None:
    ball = surfaces.sphere(2)
    points, triangles = ball.points.copy(), ball.triangles
    edges = edges_of(triangles)
    # A needle: a vertex almost at its neighbour. A cap: one split into three, off its centre.
    a, b = edges.ends[100]
    points[a] += (1 - 1e-5) * (points[b] - points[a])
    p, q, r = triangles[200]
    points = np.vstack([points, (points[p] + points[q]) / 2 + 1e-6 * (points[r] - points[p])])
    new = len(points) - 1
    triangles = np.vstack(
        [np.delete(triangles, 200, axis=0), [[p, q, new], [q, r, new], [r, p, new]]]
    )
    assert shapes(points, triangles).min() < 1e-4
    path = write(comm, folder / "bad.obj", points, [("triangle", triangles)])
    found = read_surface(comm, path)
    assert found.repairs.collapsed == 1
    assert found.repairs.flipped == 1
    assert shapes(found.points, found.triangles).min() > 1e-3
    assert found.closed
    assert found.area == pytest.approx(ball.area, rel=0.02)


def test_caps_at_a_border_are_dropped_unless_that_tears(comm: MPI.Comm, folder: Path) -> None:
    """The apex inside, the apex on the border too, an ear, and a cap that is all there is."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 5e-4, 0], [0, 1, 0], [1, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [2, 1, 4], [2, 4, 3]])
    for kept, dropped in (([0, 1, 2, 3], 1), ([0, 1, 2], 0), ([0, 1], 1), ([0], 0)):
        path = write(comm, folder / "sheet.ply", points, [("triangle", triangles[kept])])
        found = read_surface(comm, path)
        assert found.repairs.dropped == dropped
        assert len(found.triangles) == len(kept) - dropped


def test_seams_and_parts(comm: MPI.Comm, folder: Path) -> None:
    """Lines of MSH and OBJ are seams, cell groups parts; names of physical groups are kept."""
    tube = surfaces.prism(12, 4)
    line = np.stack([np.arange(4) * 12, np.arange(1, 5) * 12], axis=1)
    tag = (np.arange(len(tube.triangles)) >= 48).astype(int) + 5
    path = write(
        comm, folder / "tube.msh", tube.points, [("triangle", tube.triangles), ("line", line)],
        cell_data={"gmsh:physical": [tag, np.full(4, 9)], "gmsh:geometrical": [tag, np.full(4, 9)]},
        field_data={"lower": np.array([5, 2]), "upper": np.array([6, 2])}, file_format="gmsh22",
    )  # fmt: skip
    found = read_surface(comm, path)
    assert found.part_names == ("lower", "upper")
    assert np.bincount(found.parts).tolist() == [48, 48]
    assert len(found.seams) == 4
    assert np.ptp(found.points[found.seams][:, :, :2], axis=(0, 1)) == pytest.approx(0, abs=1e-15)
    pattern = unwrap(comm, found).pattern
    assert pattern.panel_names == ("lower", "upper")
    content = "".join(f"v {x} {y} {z}\n" for x, y, z in tube.points)
    content += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in tube.triangles)
    chain = " ".join(str(k + 1) for k in np.arange(5) * 12)
    found = read_surface(comm, text(comm, folder / "tube.obj", content + f"l {chain}\n"))
    assert len(found.seams) == 4
    assert unwrap(comm, found).methods == ("exact",)


def obj(points: np.ndarray, triangles: np.ndarray) -> str:
    content = "".join(f"v {x} {y} {z}\n" for x, y, z in points)
    return content + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in triangles)


def test_lines_of_obj_files(comm: MPI.Comm, folder: Path) -> None:
    """Negative numbers count back from the last vertex so far; points of its own are welded."""
    tube = surfaces.prism(12, 4)
    content = obj(tube.points, tube.triangles)
    up = tube.points[np.arange(5) * 12]
    own = "".join(f"v {x} {y} {z}\n" for x, y, z in up) + "l -5/-1 -4 -3 -2 -1\nv 9 9 9\n"
    for lines in ("l -60 -48 -36 -24 -12\n", own, "l 1 13\nl 25 13 13\nl 25 37 49\n"):
        found = read_surface(comm, text(comm, folder / "tube.obj", content + lines))
        ends = found.points[found.seams]
        assert ends[:, :, 2].sum() == pytest.approx(2 * up[:, 2].sum() - up[-1, 2])
        assert ends[:, :, :2] == pytest.approx(np.broadcast_to(up[0, :2], (4, 2, 2)), abs=1e-15)
    for line, why in {
        "l a b": r"line 157 of .*'l a b'",
        "l 1 0": "a line at vertex -1, .* 0 … 59",
        "l 1 61": "a line at vertex 60, .* 0 … 59",
        "l 1 14\nl 1 2 15": r"2 lines of .* no edges .* \[0.01 0.   0.  \] to .* edge by edge",
    }.items():
        path = text(comm, folder / "bad.obj", content + line + "\n")
        with pytest.raises(errors.SurfaceError, match=why):
            read_surface(comm, path)
    path = text(comm, folder / "bad.obj", content + "f -1 -2 -14\n")
    with pytest.raises(errors.SurfaceError, match="a triangle at vertex -2, .* 0 … 59"):
        read_surface(comm, path)


def test_seams_elsewhere_are_dropped(comm: MPI.Comm, folder: Path) -> None:
    """On another component, or collapsed with a needle."""
    one, two = surfaces.prism(12, 4), surfaces.prism(12, 4, 0.005)
    points = np.vstack([one.points, two.points + [0.05, 0, 0]])
    triangles = np.vstack([one.triangles, two.triangles + 60])
    content = obj(points, triangles) + "l 1 13 25\nl 61 73\n"
    path = text(comm, folder / "two.obj", content)
    assert [len(read_surface(comm, path, component=k).seams) for k in (0, 1)] == [2, 1]
    points = one.points.copy()
    points[13] += (1 - 1e-5) * (points[14] - points[13])
    path = text(comm, folder / "needle.obj", obj(points, one.triangles) + "l 14 15 16\n")
    found = read_surface(comm, path)
    assert found.repairs.collapsed == 1
    assert len(found.seams) == 1


def test_quads_are_split(comm: MPI.Comm, folder: Path) -> None:
    points = np.array([[0, 0, 0], [2, 0, 0], [3, 1, 0], [1, 1, 0]]) * 1e-2
    path = write(comm, folder / "quad.obj", points, [("quad", np.array([[0, 1, 2, 3]]))])
    found = read_surface(comm, path)
    assert len(found.triangles) == 2
    # The shorter diagonal, from (2, 0) to (1, 1).
    inner = edges_of(found.triangles)
    ends = found.points[inner.ends[inner.inner[0]]]
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(np.sqrt(2) * 1e-2)


def test_several_components(comm: MPI.Comm, folder: Path) -> None:
    large, small = surfaces.sphere(1), surfaces.sphere(1, 0.004)
    points = np.vstack([small.points + [0.05, 0, 0], large.points])
    triangles = np.vstack([small.triangles, large.triangles + len(small.points)])
    path = write(comm, folder / "two.ply", points, [("triangle", triangles)])
    with pytest.raises(errors.SurfaceError, match="2 components.*by `component`"):
        read_surface(comm, path)
    assert read_surface(comm, path, component=0).area == pytest.approx(large.area)
    assert read_surface(comm, path, component=1).area == pytest.approx(small.area)
    with pytest.raises(errors.SurfaceError, match="component = 2, but"):
        read_surface(comm, path, component=2)


def test_files_that_cannot_be_read(comm: MPI.Comm, folder: Path) -> None:
    with pytest.raises(errors.SurfaceError, match="no file"):
        read_surface(comm, folder / "none.stl")
    for name in ("a.txt", "a.stl", "a.obj", "a.ply", "a.msh", "a.xdmf"):
        path = text(comm, folder / name, "this is no mesh\n")
        with pytest.raises(errors.SurfaceError, match="cannot be read|no triangles"):
            read_surface(comm, path)
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 0.5, 0]], dtype=float)
    path = text(comm, folder / "five.obj", "".join(f"v {x} {y} {z}\n" for x, y, z in points)
                + "f 1 2 3 4 5\n")  # fmt: skip
    with pytest.raises(errors.SurfaceError, match="polygon.*Triangulate"):
        read_surface(comm, path)
    path = write(comm, folder / "line.ply", points, [("triangle", np.array([[0, 1, 1]]))])
    with pytest.raises(errors.SurfaceError, match="no area"):
        read_surface(comm, path)
    with pytest.raises(errors.ParameterError, match="scale"):
        read_surface(comm, path, scale=0)


def test_surfaces_that_cannot_be_sewn(comm: MPI.Comm, folder: Path) -> None:
    points = np.vstack([np.eye(3), [[0, 0, 0], [1, 1, 1]]])
    path = write(comm, folder / "fin.ply", points,
                 [("triangle", np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]))])  # fmt: skip
    with pytest.raises(errors.ManifoldError, match=r"more than two triangles.*\[0, 1, 2\]"):
        read_surface(comm, path)
    with pytest.raises(errors.ManifoldError, match=r"between vertices 0 and 1 .*\[0, 1, 2\]"):
        Surface(points, np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))
    turn = np.arange(5) * np.pi / 4
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.cos(turn / 2)])
    # Five triangles in a ring, each sharing an edge with the next: a Möbius strip.
    five = np.stack([np.arange(5), (np.arange(5) + 1) % 5, (np.arange(5) + 2) % 5], axis=1)
    path = write(comm, folder / "moebius.ply", ring, [("triangle", five)])
    with pytest.raises(errors.OrientationError, match="one side only"):
        read_surface(comm, path)
    ball = surfaces.sphere(1)
    with pytest.raises(errors.OrientationError, match="inwards"):
        replace(ball, triangles=ball.triangles[:, ::-1])
    with pytest.raises(errors.SurfaceError, match=r"seams holds 99; .* 0 … 41"):
        replace(ball, seams=np.array([[0, 99]]))
    thin = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-7, 0]])
    with pytest.raises(errors.DegenerateTriangleError, match="1 triangles are thinner"):
        Surface(thin, np.array([[0, 1, 2]]))
    # A strip whose last corner is its first one.
    strip = np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4], [4, 5, 0]])
    with pytest.raises(errors.ManifoldError, match="vertex 0.*pinches"):
        Surface(surfaces.sphere(0).points[:6], strip)
    with pytest.raises(errors.SurfaceError, match="has 2 connected components"):
        Surface(np.vstack([points[:3], 3 + points[:3]]), np.arange(6).reshape(2, 3))


def test_a_modelled_part(comm: MPI.Comm) -> None:
    """A part from a CAD program (tests/data/README.md), of needles that are no defects."""
    part = read_surface(comm, DATA / "bracket.stl", scale=1e-3)
    assert part.closed
    assert len(part.triangles) == 494
    made = unwrap(comm, part)
    assert set(made.methods) <= {"exact", "abf"}
    assert len(made.methods) == 7
    assert made.distortion.worst_stretch < 1e-3
    assert made.pattern.areas.sum() == pytest.approx(part.area, rel=1e-6)
