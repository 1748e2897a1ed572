"""Mesh files that cannot be read, and lines of OBJ files."""

import sys
from pathlib import Path

import numpy as np
import pytest
from helpers import surfaces
from helpers.mesh_files import obj, text, write
from mpi4py import MPI

from toros_fem import errors
from toros_fem.meshes import read_surface
from toros_fem.meshes.mesh_file import load, obj_lines


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
    path = text(alone, tmp_path / "bad.obj", content + "f -1 -2 -14\n")
    with pytest.raises(errors.SurfaceError, match="a triangle at vertex -2, .* 0 … 59"):
        read_surface(alone, path)


def test_files_that_cannot_be_read(alone: MPI.Comm, tmp_path: Path) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 0.5, 0]], dtype=float)
    path = text(alone, tmp_path / "five.obj", "".join(f"v {x} {y} {z}\n" for x, y, z in points)
                + "f 1 2 3 4 5\n")  # fmt: skip
    with pytest.raises(errors.SurfaceError, match="polygon.*Triangulate"):
        read_surface(alone, path)
    path = write(alone, tmp_path / "line.ply", points, [("triangle", np.array([[0, 1, 1]]))])
    with pytest.raises(errors.SurfaceError, match="no area"):
        read_surface(alone, path)


def test_line_elements_of_an_obj_file(tmp_path: Path) -> None:
    path = tmp_path / "lines.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nl 1/4 2/5\nv 1 1 0\nl -1 -3\n# l 1 3\n", encoding="utf-8")
    assert obj_lines(path).tolist() == [[0, 1], [2, 0]]
    path.write_text("v 0 0 0\n", encoding="utf-8")
    assert obj_lines(path).shape == (0, 2)


def test_meshio_prints_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The error has the requested type and says what to do."""
    path = tmp_path / "broken.ply"
    path.write_text("no mesh", encoding="utf-8")
    with pytest.raises(errors.TargetError, match=r"broken.ply cannot .* Save it as OBJ or VTU."):
        load(path, errors.TargetError, "OBJ or VTU")
    printed = capsys.readouterr()
    assert (printed.out, printed.err) == ("", "")
