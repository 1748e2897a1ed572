"""Mesh files become oriented surfaces and targets, or a clear error."""

import sys
import time
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
from helpers.mesh_files import obj, text, write, xdmf
from helpers.scenes import square
from mpi4py import MPI

from toros_fem import errors
from toros_fem.base.errors import ParameterError
from toros_fem.meshes import bend, cylinder, files, from_mesh, read_surface, unwrap
from toros_fem.meshes.files import load
from toros_fem.meshes.formats import content_of
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
    assert found.repairs == (
        f"28 coincident vertices merged, 6 triangles dropped, {some.sum()} triangles reversed"
    )


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
    assert found.repairs == "1 edges collapsed"
    assert len(found.seams) == 1


@pytest.mark.parametrize(
    ("size", "told"),
    [
        (0.06, "Metres? Give scale = 1."),
        (2.36, "0.0254 for inches (0.06 m), 0.01 for centimetres (0.024 m)"),
        (60, "1e-3 for millimetres (0.06 m), 0.0254 for inches (1.5 m), 0.01 for centi"),
        (1500, "Millimetres? Give scale = 1e-3."),
        (1e5, "Is `scale`"),
    ],
)
def test_units_that_fit(size: float, told: str) -> None:
    assert told in files.unit_hint(size)


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


def test_formats_that_need_another_package(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without h5py, as a stand-in for a package that is missing."""
    monkeypatch.setitem(sys.modules, "h5py", None)
    path = text(alone, tmp_path / "code.med", "no mesh")
    with pytest.raises(errors.SurfaceError, match=r"lacks a package .*h5py.*Save it as STL"):
        read_surface(alone, path)


def test_lines_of_obj_files(alone: MPI.Comm, tmp_path: Path) -> None:
    """Negative numbers count back from the last vertex so far; points of its own are welded."""
    tube = surfaces.prism(12, 4)
    content = obj(tube.points, tube.triangles)
    up = tube.points[np.arange(5) * 12]
    own = "".join(f"v {x} {y} {z}\n" for x, y, z in up) + "l -5/-1 -4 -3 -2 -1\nv 9 9 9\n"
    for lines in ("l -60 -48 -36 -24 -12\n", own, "l 1 13\nl 25 13 13\nl 25 37 49\n"):
        found = read_surface(alone, text(alone, tmp_path / "tube.obj", content + lines))
        ends = found.points[found.seams]
        assert ends[:, :, 2].sum() == pytest.approx(2 * up[:, 2].sum() - up[-1, 2])
        assert ends[:, :, :2] == pytest.approx(np.broadcast_to(up[0, :2], (4, 2, 2)), abs=1e-15)
    for line, why in {
        "l a b": r"line 157 of .*'l a b'",
        "l 1 0": "a line at vertex -1, .* 0 … 59",
        "l 1 61": "a line at vertex 60, .* 0 … 59",
        "l 1 14\nl 1 2 15": r"2 lines of .* no edges .* \[0.01 0.   0.  \] to .* edge by edge",
    }.items():
        path = text(alone, tmp_path / "bad.obj", content + line + "\n")
        with pytest.raises(errors.SurfaceError, match=why):
            read_surface(alone, path)
    path = text(alone, tmp_path / "bad.obj", content + "f -1 -2 -64\n")
    with pytest.raises(errors.SurfaceError, match="a triangle at vertex -4, .* 0 … 59"):
        read_surface(alone, path)


def test_line_elements_of_an_obj_file(tmp_path: Path) -> None:
    path = tmp_path / "lines.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nl 1/4 2/5\nv 1 1 0\nl -1 -3\n# l 1 3\n", encoding="utf-8")
    assert content_of(path).lines.tolist() == [[0, 1], [2, 0]]
    path.write_text("v 0 0 0\n", encoding="utf-8")
    assert content_of(path).lines.shape == (0, 2)


def test_meshio_prints_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The error has the requested type and says what to do."""
    path = tmp_path / "broken.ply"
    path.write_text("no mesh", encoding="utf-8")
    with pytest.raises(errors.ParameterError, match=r"broken.ply cannot .* Save it as OBJ or VTU."):
        load(path, errors.ParameterError, "OBJ or VTU")
    printed = capsys.readouterr()
    assert (printed.out, printed.err) == ("", "")


@pytest.mark.parametrize("suffix", ["obj", "ply", "vtu"])
def test_target_from_a_mesh(alone: MPI.Comm, tmp_path: Path, suffix: str) -> None:
    pattern = cylinder(alone, 0.03, 0.02, 6e-3, mesh="structured")
    path = tmp_path / f"deformed.{suffix}"
    bent = bend(1.0, 0.03)(pattern.points)

    def write(points: np.ndarray, triangles: np.ndarray) -> None:
        meshio.write_points_cells(path, points, [("triangle", triangles)])

    shuffled = np.roll(pattern.triangles[::-1], 1, axis=1)
    write(bent, shuffled)
    assert from_mesh(alone, path, pattern) == pytest.approx(bent, abs=1e-8)
    write(bent, shuffled[:-1])
    with pytest.raises(ParameterError, match=f"and {len(shuffled) - 1} triangles; the skin has"):
        from_mesh(alone, path, pattern)
    write(bent[:-1], np.array([[0, 1, 2]]))
    less = len(bent) - 1
    with pytest.raises(ParameterError, match=f"has {less} vertices .* the skin has {less + 1} "):
        from_mesh(alone, path, pattern)
    write(bent, np.concatenate([pattern.triangles[:7], pattern.triangles[7:, ::-1]]))
    with pytest.raises(ParameterError, match="triangle 7 of the skin"):
        from_mesh(alone, path, pattern)


def forever() -> None:
    while True:
        time.sleep(0.01)


def test_a_loop_is_interrupted_in_time() -> None:
    with pytest.raises(TimeoutError), files.interrupted_after(0.2):
        forever()
    with files.interrupted_after(0.05):
        pass
    time.sleep(0.1)  # an interrupt that is late would come here


def test_a_file_that_ends_too_early(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here meshio looks for the next line for ever."""
    monkeypatch.setattr(files, "SECONDS", 0.5)
    path = tmp_path / "short.off"
    path.write_text("OFF\n")
    with pytest.raises(errors.SurfaceError, match="in a reasonable time: it ends too early"):
        read_surface(alone, path)
