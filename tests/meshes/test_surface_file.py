"""Mesh files become one oriented manifold surface, mended, or a clear error."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import basix.ufl
import dolfinx.mesh
import numpy as np
import pytest
import ufl
from dolfinx.io import XDMFFile
from helpers import surfaces
from helpers.mesh_files import obj, text, write, xdmf
from helpers.scenes import square
from mpi4py import MPI

from toros_fem import errors
from toros_fem.meshes import read_surface, unwrap
from toros_fem.meshes.surface import volume
from toros_fem.meshes.triangles import edges_of

FORMATS: dict[str, dict[str, Any]] = {
    "stl": {"file_format": "stl", "binary": True},
    "obj": {},
    "ply": {},
    "msh": {"file_format": "gmsh"},
}


@pytest.mark.parametrize("kind", [*FORMATS, "xdmf"])
def test_round_trip(alone: MPI.Comm, tmp_path: Path, kind: str) -> None:
    """Every format gives the same surface and the same pattern; an STL to seven digits."""
    made = surfaces.cap(5, 1.0)[0]
    path, points = tmp_path / f"cap.{kind}", made.points * 1e3
    if kind == "xdmf":
        text(alone, path, xdmf(points, made.triangles))
    else:
        write(alone, path, points, [("triangle", made.triangles)], **FORMATS[kind])
    found = read_surface(alone, path, scale=1e-3)
    # Vertices are numbered by first use.
    used = np.argsort(np.unique(made.triangles, return_index=True)[1])
    digits = 2e-7 if kind == "stl" else 1e-15
    assert found.points == pytest.approx(made.points[used], abs=0.01 * digits)
    assert np.array_equal(used[found.triangles], made.triangles)
    wanted = unwrap(alone, replace(found, points=made.points[used])).pattern
    pattern = unwrap(alone, found).pattern
    assert np.array_equal(pattern.flat_triangles, wanted.flat_triangles)
    assert pattern.areas == pytest.approx(wanted.areas, rel=1e3 * digits)


def test_flat_xdmf(alone: MPI.Comm, tmp_path: Path) -> None:
    """Points of two coordinates, as text and in HDF5, lie in z = 0."""
    sheet = square(n=2)
    written = xdmf(sheet.flat_points, sheet.flat_triangles)
    flat = written.replace("XYZ", "XY").replace('"9 3"', '"9 2"')
    domain = dolfinx.mesh.create_mesh(
        MPI.COMM_SELF, cells=sheet.flat_triangles, x=sheet.flat_points,
        e=ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))),
    )  # fmt: skip
    with XDMFFile(MPI.COMM_SELF, str(tmp_path / "hdf5.xdmf"), "w") as file:
        file.write_mesh(domain)
    for path in (text(alone, tmp_path / "text.xmf", flat), tmp_path / "hdf5.xdmf"):
        found = read_surface(alone, path)
        assert found.points.shape == (9, 3)
        assert found.area == pytest.approx(4e-4, rel=1e-12)
        assert np.all(found.points[:, 2] == 0)
    hdf5 = (tmp_path / "hdf5.xdmf").read_text(encoding="utf-8")
    path = text(alone, tmp_path / "apart.xdmf", hdf5.replace('"XY"', '"X_Y"'))
    with pytest.raises(errors.SurfaceError, match=r'apart.xdmf .* "X_Y".* Save it as STL'):
        read_surface(alone, path)
    begin, end = hdf5.index("<Grid"), hdf5.index("</Domain>")
    path = text(alone, tmp_path / "two.xdmf", hdf5[:end] + hdf5[begin:end] + hdf5[end:])
    with pytest.raises(errors.SurfaceError, match=r"one grid.* Save it as STL"):
        read_surface(alone, path)


def test_box_from_separate_sides(alone: MPI.Comm, tmp_path: Path) -> None:
    points, triangles = surfaces.box(2)
    rng = np.random.default_rng(3)
    some = rng.random(len(triangles)) < 0.4
    triangles = np.where(some[:, None], triangles[:, ::-1], triangles)
    triangles = np.concatenate([triangles, triangles[:3], triangles[:2, ::-1], [[0, 0, 1]]])
    path = write(alone, tmp_path / "box.ply", points, [("triangle", triangles)])
    found = read_surface(alone, path)
    assert found.closed
    assert found.area == pytest.approx(2 * (6 + 3 + 2) * 1e-4, rel=1e-12)
    assert volume(found.points, found.triangles) == pytest.approx(6e-6, rel=1e-12)
    assert found.repairs.merged == 54 - 26
    assert found.repairs.dropped == 6
    assert found.repairs.turned == some.sum()
    assert "28 coincident vertices merged, 6 triangles dropped" in str(found.repairs)


def test_seams_and_parts(alone: MPI.Comm, tmp_path: Path) -> None:
    """Lines of MSH and OBJ are seams, cell groups parts; names of physical groups are kept."""
    tube = surfaces.prism(12, 4)
    line = np.stack([np.arange(4) * 12, np.arange(1, 5) * 12], axis=1)
    tag = (np.arange(len(tube.triangles)) >= 48).astype(int) + 5
    path = write(
        alone, tmp_path / "tube.msh", tube.points, [("triangle", tube.triangles), ("line", line)],
        cell_data={"gmsh:physical": [tag, np.full(4, 9)], "gmsh:geometrical": [tag, np.full(4, 9)]},
        field_data={"lower": np.array([5, 2]), "upper": np.array([6, 2])}, file_format="gmsh22",
    )  # fmt: skip
    found = read_surface(alone, path)
    assert found.part_names == ("lower", "upper")
    assert np.bincount(found.parts).tolist() == [48, 48]
    assert len(found.seams) == 4
    assert np.ptp(found.points[found.seams][:, :, :2], axis=(0, 1)) == pytest.approx(0, abs=1e-15)
    pattern = unwrap(alone, found).pattern
    assert pattern.panel_names == ("lower", "upper")
    content = "".join(f"v {x} {y} {z}\n" for x, y, z in tube.points)
    content += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in tube.triangles)
    chain = " ".join(str(k + 1) for k in np.arange(5) * 12)
    found = read_surface(alone, text(alone, tmp_path / "tube.obj", content + f"l {chain}\n"))
    assert len(found.seams) == 4
    assert unwrap(alone, found).methods == ("exact",)


def test_seams_elsewhere_are_dropped(alone: MPI.Comm, tmp_path: Path) -> None:
    """On another component, or collapsed with a needle."""
    one, two = surfaces.prism(12, 4), surfaces.prism(12, 4, 0.005)
    points = np.vstack([one.points, two.points + [0.05, 0, 0]])
    triangles = np.vstack([one.triangles, two.triangles + 60])
    content = obj(points, triangles) + "l 1 13 25\nl 61 73\n"
    path = text(alone, tmp_path / "two.obj", content)
    assert [len(read_surface(alone, path, component=k).seams) for k in (0, 1)] == [2, 1]
    points = one.points.copy()
    points[13] += (1 - 1e-5) * (points[14] - points[13])
    path = text(alone, tmp_path / "needle.obj", obj(points, one.triangles) + "l 14 15 16\n")
    found = read_surface(alone, path)
    assert found.repairs.collapsed == 1
    assert len(found.seams) == 1


def test_quads_are_split(alone: MPI.Comm, tmp_path: Path) -> None:
    points = np.array([[0, 0, 0], [2, 0, 0], [3, 1, 0], [1, 1, 0]]) * 1e-2
    path = write(alone, tmp_path / "quad.obj", points, [("quad", np.array([[0, 1, 2, 3]]))])
    found = read_surface(alone, path)
    assert len(found.triangles) == 2
    # The shorter diagonal, from (2, 0) to (1, 1).
    inner = edges_of(found.triangles)
    ends = found.points[inner.ends[inner.inner[0]]]
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(np.sqrt(2) * 1e-2)


def test_several_components(alone: MPI.Comm, tmp_path: Path) -> None:
    large, small = surfaces.sphere(1), surfaces.sphere(1, 0.004)
    points = np.vstack([small.points + [0.05, 0, 0], large.points])
    triangles = np.vstack([small.triangles, large.triangles + len(small.points)])
    path = write(alone, tmp_path / "two.ply", points, [("triangle", triangles)])
    with pytest.raises(errors.SurfaceError, match="2 components.*by `component`"):
        read_surface(alone, path)
    assert read_surface(alone, path, component=0).area == pytest.approx(large.area)
    assert read_surface(alone, path, component=1).area == pytest.approx(small.area)
    with pytest.raises(errors.SurfaceError, match="component = 2, but"):
        read_surface(alone, path, component=2)
