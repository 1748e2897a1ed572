"""One small surface in the many spellings of its formats is always the same surface."""

import logging
import tempfile
from pathlib import Path

import dolfinx.mesh
import numpy as np
import pytest
from dolfinx.io import XDMFFile
from helpers import surfaces
from helpers.mesh_files import obj
from hypothesis import given, settings
from hypothesis import strategies as st
from mpi4py import MPI

from toros_fem import errors
from toros_fem.mechanics.contact.solids import rigid_mesh
from toros_fem.meshes import from_mesh, moulded, read_surface
from toros_fem.meshes.formats import content_of
from toros_fem.meshes.surface import Surface, volume

BALL = surfaces.sphere(1)
POINTS, TRIANGLES = BALL.points.round(6), BALL.triangles
ALONE = MPI.COMM_SELF
MANY = settings(max_examples=60, deadline=None, derandomize=True)


def read(name: str, content: str | bytes) -> Surface:
    """The surface in a file of this name."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return read_surface(ALONE, path)


def require_ball(found: Surface, digits: float = 1e-12) -> None:
    """All its triangles are there, and what they enclose."""
    assert len(found.triangles) == len(TRIANGLES)
    assert found.closed
    assert volume(found.points, found.triangles) == pytest.approx(
        volume(POINTS, TRIANGLES), rel=max(digits, 1e-12)
    )


# ------------------------------------------------------------------------------------------ STL


@MANY
@given(
    upper=st.booleans(),
    ends=st.sampled_from(["endloop", "end loop"]),
    facet_ends=st.sampled_from(["endfacet", "end facet"]),
    line=st.sampled_from(["\n", "\r\n", "\n\n", " \n\t\n", "\r"]),
    name=st.sampled_from(["", "part", "Körper", "facet 1", "a vertex 1 2 3"]),
    encoding=st.sampled_from(["utf-8", "latin-1", "utf-16", "utf-8-sig"]),
    last=st.sampled_from(["endsolid", "end solid x", ""]),
    number=st.sampled_from(["{}", "{:.9e}", "{:+.8f}", "comma"]),
)
def test_ascii_stl(
    upper: bool, ends: str, facet_ends: str, line: str, name: str, encoding: str, last: str,
    number: str,
) -> None:  # fmt: skip
    lines = [f"solid {name}"]

    def written(x: float) -> str:
        return f"{x:.8f}".replace(".", ",") if number == "comma" else number.format(x)

    for corners in POINTS[TRIANGLES]:
        lines += ["  facet normal 0 0 0", "outer loop"]
        lines += ["\tvertex  " + " ".join(written(float(x)) for x in corner) for corner in corners]
        lines += [ends, facet_ends]
    text = line.join([*lines, last])
    require_ball(read("ball.stl", (text.upper() if upper else text).encode(encoding)), 1e-6)


def binary_stl(count: int, header: bytes = b"") -> bytes:
    """A file whose header tells so many facets."""
    facets = np.zeros(len(TRIANGLES), dtype=[("floats", "<f4", (4, 3)), ("attribute", "<u2")])
    facets["floats"][:, 1:] = POINTS[TRIANGLES]
    return header.ljust(80, b"\0") + count.to_bytes(4, "little") + facets.tobytes()


@MANY
@given(
    count=st.sampled_from([0, 1, 40, len(TRIANGLES), len(TRIANGLES) + 3, 2**32 - 1]),
    header=st.sampled_from([b"", b"solid of a program", b"COLOR=\xff\x00"]),
    more=st.sampled_from([b"", b"\0", b"\0" * 50, b"\0" * 120, b" made by a program " * 7]),
)
def test_binary_stl(count: int, header: bytes, more: bytes) -> None:
    require_ball(read("ball.stl", binary_stl(count, header) + more), 1e-6)


def test_what_no_stl_is(caplog: pytest.LogCaptureFixture) -> None:
    """The message tells what is wrong with this file."""
    text = "solid\nfacet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 x\n"
    for content, why in {
        "solid\nendsolid": "no line 'vertex' with three numbers",
        text: "'x' stands in place of a number",
        text.replace(" x", " 0\nfacet\nvertex 0 0 0"): "2 facets have 4 corners",
    }.items():
        with pytest.raises(errors.SurfaceError, match=f"bad.stl cannot .*{why}.*Save it as"):
            read("bad.stl", content)
    with caplog.at_level(logging.WARNING, logger="toros_fem"):
        read("ball.stl", binary_stl(40))
    assert f"header says 40 facets, and it holds {len(TRIANGLES)}" in caplog.text


# ------------------------------------------------------------------------------------------ OBJ


@MANY
@given(
    relative=st.booleans(),
    corner=st.sampled_from(["{0}", "{0}/{0}", "{0}//1", "{0}/1/1"]),
    more=st.sampled_from(["", " 1.0", " 0.5 0.25 1", " 1 0.5 0.5 0.5"]),
    continued=st.sampled_from(["", "\\\n", "\\ \n"]),
    line=st.sampled_from(["\n", "\r\n"]),
    head=st.sampled_from(
        ["", "# C:\\temp\\\nmtllib a.mtl\no Ball é\n", "vt 0 0\nvn 0 0 1\ns off\n"]
    ),
    mixed=st.booleans(),
)
def test_obj(
    relative: bool, corner: str, more: str, continued: str, line: str, head: str, mixed: bool
) -> None:
    """Vertices of faces may come as they are needed."""
    text, known = head, 0
    for triangle in TRIANGLES:
        needed = int(triangle.max()) + 1 if mixed else len(POINTS)
        for x, y, z in POINTS[known:needed]:
            text += f"v {x!r} {continued}{y!r}  {z!r}{more}  # a vertex\n".replace("np.float64", "")
        known = max(known, needed)
        numbers = (int(k) - known if relative else int(k) + 1 for k in triangle)
        text += f"f {f' {continued}'.join(corner.format(k) for k in numbers)}\n"
    text = text.replace("(", "").replace(")", "")
    require_ball(read("ball.obj", text.replace("\n", line).encode("latin-1")))


def test_groups_of_an_obj(caplog: pytest.LogCaptureFixture) -> None:
    """A group that comes twice is one; of two groups the smaller one counts; both are told."""
    lines = obj(POINTS[:0], TRIANGLES).splitlines(keepends=True)
    lines.insert(60, "g all upper # again\n")
    lines.insert(20, "g all\n")
    text = "".join([obj(POINTS, TRIANGLES[:0]), "g all upper\n", *lines])
    with caplog.at_level(logging.WARNING, logger="toros_fem"):
        found = read("ball.obj", text)
    assert dict(zip(found.part_names, np.bincount(found.parts), strict=True)) == {
        "all": 40, "upper": len(TRIANGLES) - 40,
    }  # fmt: skip
    assert "Its group 'upper' comes 2 times" in caplog.text
    assert f"{len(TRIANGLES) - 40} of 'all'" in caplog.text
    assert found.repairs == "none"


# ------------------------------------------------------------------------------------------ PLY


def ply(order: str, index: str, size: str, vertex: str, face: str, *, edges: bool) -> bytes:
    """A file whose vertices have colours, before or after the position, and so have its faces."""
    code = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}[order]
    types = {"uchar": "u1", "int": "i4", "float": "f4", "double": "f8"}
    colours = [(one, "uchar") for one in ("red", "green", "blue")]
    places = [(axis, "double") for axis in "xyz"]
    rows = {"before": [*colours, *places], "after": [*places, *colours], "": places}[vertex]
    listed = f"property list {size} int {index}\n"
    painted = "".join(f"property uchar {one}\n" for one, _ in colours)
    head = f"ply\nformat {order} 1.0\ncomment of a program\nobj_info 1\n"
    head += f"element vertex {len(POINTS)}\n"
    head += "".join(f"property {kind} {name}\n" for name, kind in rows)
    if edges:
        head += "element edge 1\nproperty int vertex1\nproperty int vertex2\n"
    head += f"element face {len(TRIANGLES)}\n"
    head += {"before": painted + listed, "after": listed + painted, "": listed}[face]
    body: list[tuple[float, str]] = []
    for point in POINTS:
        values = dict(zip("xyz", point, strict=True))
        body += [(values.get(name, 200), kind) for name, kind in rows]
    if edges:
        body += [(int(k), "int") for k in TRIANGLES[0, :2]]
    for triangle in TRIANGLES:
        ring = [(3, size), *((int(k), "int") for k in triangle)]
        paint = [(17, "uchar")] * 3
        body += {"before": paint + ring, "after": ring + paint, "": ring}[face]
    if order == "ascii":
        words = (repr(float(x)) if kind == "double" else str(x) for x, kind in body)
        return (head + "end_header\n" + " ".join(words)).encode()
    made = b"".join(np.array(x, dtype=code + types[kind]).tobytes() for x, kind in body)
    return head.encode() + b"end_header\n" + made


@MANY
@given(
    order=st.sampled_from(["ascii", "binary_little_endian", "binary_big_endian"]),
    index=st.sampled_from(["vertex_indices", "vertex_index"]),
    size=st.sampled_from(["uchar", "int"]),
    vertex=st.sampled_from(["", "before", "after"]),
    face=st.sampled_from(["", "before", "after"]),
    edges=st.booleans(),
)
def test_ply(order: str, index: str, size: str, vertex: str, face: str, edges: bool) -> None:
    found = read("ball.ply", ply(order, index, size, vertex, face, edges=edges))
    require_ball(found)
    assert len(found.seams) == edges


def test_mixed_faces_of_a_ply(tmp_path: Path) -> None:
    """Rows of several lengths keep their order; the header may end as Windows ends lines."""
    head = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n"
    head += "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
    text = head + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n3 1 4 2\n4 0 1 2 3\n"
    (tmp_path / "mixed.ply").write_bytes(text.replace("\n", "\r\n").encode())
    found = content_of(tmp_path / "mixed.ply")
    assert found.faces[0, :3].tolist() == [1, 4, 2]
    assert found.faces[1].tolist() == [0, 1, 2, 3]
    assert found.triangles.tolist() == [[1, 4, 2]]
    for wrong, why in {
        text[:-8]: "ends before", text.replace("4 0", "9 0"): "9 numbers|ends before",
        text.replace("float z", "float w"): "no x, y and z", text[4:]: "does not begin with 'ply'",
        text.replace("float y", "real y"): "its header holds 'property real y'",
    }.items():  # fmt: skip
        with pytest.raises(errors.SurfaceError, match=why):
            read("bad.ply", wrong)


# ------------------------------------------------------------------------------------ MSH and XDMF


@pytest.mark.parametrize(
    ("version", "binary"), [(2.2, False), (2.2, True), (4.0, False), (4.1, False), (4.1, True)]
)
@pytest.mark.parametrize("parametric", [False, True])
def test_msh_of_gmsh(tmp_path: Path, version: float, binary: bool, parametric: bool) -> None:
    """Some faces are in a group, some in none; nodes may have parameters."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addBox(0, 0, 0, 1, 2, 3)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [1, 3], 7, "wall")
        if version == 2.2:  # which saves only what is in groups
            gmsh.model.addPhysicalGroup(2, [2, 4, 5, 6], 9, "part-0")
        gmsh.model.mesh.generate(2)
        for name, value in {
            "MshFileVersion": version, "Binary": binary, "SaveParametric": parametric,
            "SaveAll": version > 3,
        }.items():  # fmt: skip
            gmsh.option.setNumber(f"Mesh.{name}", value)
        gmsh.write(str(tmp_path / "box.msh"))
        count = len(gmsh.model.mesh.getElementsByType(2)[0])
    finally:
        gmsh.finalize()
    found = read_surface(ALONE, tmp_path / "box.msh")
    assert found.closed
    assert len(found.triangles) == count
    assert volume(found.points, found.triangles) == pytest.approx(6)
    area = {
        name: float(np.sum(np.linalg.norm(np.cross(b - a, c - a), axis=1)) / 2)
        for part, name in enumerate(found.part_names)
        for a, b, c in [np.moveaxis(found.points[found.triangles[found.parts == part]], 1, 0)]
    }
    assert area == pytest.approx({"part-0": 22 - area["wall"], "wall": 6 + 3})


def test_groups_of_one_name(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """They are one part, and that is told."""
    text = '$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n2 1 "a"\n2 2 "a"\n'
    text += f"$EndPhysicalNames\n$Nodes\n{len(POINTS)}\n"
    text += "".join(f"{k} {x} {y} {z}\n" for k, (x, y, z) in enumerate(POINTS, 1))
    text += f"$EndNodes\n$Elements\n{len(TRIANGLES)}\n"
    for k, (a, b, c) in enumerate(TRIANGLES + 1):
        text += f"{k + 1} 2 2 {1 + k % 2} 1 {a} {b} {c}\n"
    with caplog.at_level(logging.WARNING, logger="toros_fem"):
        found = read("ball.msh", text + "$EndElements\n")
    assert found.part_names == ("a",)
    assert "2 groups are called 'a'; they are one part" in caplog.text


@pytest.mark.parametrize("tagged", ["some", "all"])
def test_xdmf_of_dolfinx(tmp_path: Path, tagged: str) -> None:
    """Tags of triangles are parts, tagged edges are seams; others are no seams."""
    mesh = dolfinx.mesh.create_rectangle(ALONE, [[0, 0], [0.02, 0.01]], [4, 4])
    mesh.topology.create_connectivity(1, 2)
    cells = np.arange(32 if tagged == "all" else 20, dtype=np.int32)
    parts = dolfinx.mesh.meshtags(mesh, 2, cells, np.where(cells < 12, 3, 8).astype(np.int32))
    middle = dolfinx.mesh.locate_entities(mesh, 1, lambda x: np.isclose(x[0], 0.01))
    facets = np.arange(mesh.topology.index_map(1).size_local, dtype=np.int32)
    marks = np.isin(facets, middle).astype(np.int32)
    edges = dolfinx.mesh.meshtags(mesh, 1, facets, marks)
    parts.name, edges.name = "parts", "cuts"
    path = tmp_path / "sheet.xdmf"
    with XDMFFile(ALONE, str(path), "w") as file:
        file.write_mesh(mesh)
        file.write_meshtags(parts, mesh.geometry)
        file.write_meshtags(edges, mesh.geometry)
    found = read_surface(ALONE, path)
    assert len(found.triangles) == 32
    assert len(found.seams) == len(middle) == 4
    sizes = dict(zip(found.part_names, np.bincount(found.parts), strict=True))
    wanted = {"part-3": 12, "part-8": 20} if tagged == "all" else {
        "part-3": 12, "part-8": 8, "untagged": 12,
    }  # fmt: skip
    assert sizes == wanted


# ------------------------------------------------------------------------- corners, targets, bodies


@pytest.mark.parametrize("apart", [1e-8, 1e-6, 1e-4])
def test_corners_that_nearly_meet(apart: float, caplog: pytest.LogCaptureFixture) -> None:
    """They are merged where that closes the surface; otherwise the message tells them."""
    rng = np.random.default_rng(1)
    corners = POINTS[TRIANGLES].reshape(-1, 3)
    moved = corners + rng.uniform(-1, 1, corners.shape) * apart * np.ptp(POINTS)
    text = obj(moved, np.arange(len(corners)).reshape(-1, 3))
    if apart > 1e-5:
        with pytest.raises(errors.SurfaceError, match="apart: merge them by distance"):
            read("ball.obj", text)
        return
    with caplog.at_level(logging.WARNING, logger="toros_fem"):
        require_ball(read("ball.obj", text), 1e-4)
    assert ("were merged, which closes it" in caplog.text) == (apart > 1e-7)


def test_a_body_is_read_as_a_skin(tmp_path: Path) -> None:
    (tmp_path / "ball.stl").write_bytes(binary_stl(0) + b"made by a program")
    body = rigid_mesh(ALONE, "ball", tmp_path / "ball.stl")
    assert body.volume == pytest.approx(volume(POINTS, TRIANGLES), rel=1e-6)


def test_a_target_keeps_its_order(tmp_path: Path) -> None:
    """Colours and other spellings change neither vertices nor triangles."""
    skin = moulded(POINTS, TRIANGLES)
    (tmp_path / "bent.ply").write_bytes(
        ply("binary_big_endian", "vertex_index", "int", "before", "after", edges=True)
    )
    lines = obj(POINTS, TRIANGLES).replace("\nf ", "\ng a b\nf ").replace("\nv ", " 0.5 0.5 1\nv ")
    (tmp_path / "bent.obj").write_text(lines)
    for path in tmp_path.iterdir():
        assert from_mesh(ALONE, path, skin) == pytest.approx(POINTS)
