"""Fields are read back as they were written, and files are whole or absent."""

from pathlib import Path

import meshio
import numpy as np
import pytest
from helpers.scenes import square

from toros_fem.base.errors import OutputError
from toros_fem.base.files import if_plotting
from toros_fem.base.versions import versions
from toros_fem.results.pictures.style import page
from toros_fem.results.writer import write_fields


def test_fields(tmp_path: Path) -> None:
    pattern = square(n=2)
    positions = pattern.points * [1, 2, 1] + [0, 0, 0.5]
    density = np.linspace(0, 1, len(pattern.triangles)).astype(np.float64)
    write_fields(tmp_path / "skin.vtu", pattern, positions, {"density": density})
    mesh = meshio.read(tmp_path / "skin.vtu")
    assert mesh.points == pytest.approx(positions)
    assert np.array_equal(mesh.cells_dict["triangle"], pattern.triangles)
    assert mesh.point_data["displacement"] == pytest.approx(positions - pattern.points)
    assert mesh.cell_data["density"][0] == pytest.approx(density)
    assert np.array_equal(mesh.cell_data["panel"][0], pattern.panel)


def test_a_field_file_is_whole_or_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pattern, path = square(n=2), tmp_path / "skin.vtu"
    write_fields(path, pattern, pattern.points, {})
    before = path.read_bytes()

    def cut_off(_: object, place: Path, **__: str) -> None:
        place.write_bytes(before[:100])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(meshio.Mesh, "write", cut_off)
    with pytest.raises(OutputError, match=r"skin\.vtu could not be written: .*No space left"):
        write_fields(path, pattern, pattern.points, {})
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == ["skin.vtu"]


def test_pictures_are_whole_or_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that cannot be drawn or written leaves what was there."""
    path = tmp_path / "a.png"
    with page(path, "A title"):
        pass
    before = path.read_bytes()

    def stopped() -> None:
        with page(path, "Another"):
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        stopped()
    monkeypatch.setattr(
        Path, "replace", lambda self, to: (_ for _ in ()).throw(OSError(28, "full"))
    )
    with pytest.raises(OSError, match="full"), page(path, "Another"):
        pass
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_no_pictures_without_matplotlib(capsys: pytest.CaptureFixture[str]) -> None:
    def lacking() -> None:
        raise ImportError("No module named 'matplotlib'")

    if_plotting(lacking)
    said = "no pictures: No module named 'matplotlib'; in the checkout: pip install '.[plot]'"
    assert said in capsys.readouterr().err


def test_versions() -> None:
    found = versions()
    always = {"toros_fem", "dolfinx", "petsc4py", "numpy", "python", "platform"}
    assert always <= set(found) <= always | {"gmsh", "blas_kernel"}
    assert all(isinstance(version, str) and version for version in found.values())
