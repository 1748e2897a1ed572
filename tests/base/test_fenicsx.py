"""Compiled forms: one whose compilation was killed is compiled again, one in the making is not."""

import fcntl
import os
from pathlib import Path

import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

from toros_fem.base import fenicsx
from toros_fem.base.fenicsx import LOCK, SharedForms, compiled


@pytest.fixture
def area(alone: MPI.Comm) -> ufl.Form:
    square = mesh.create_unit_square(alone, 2, 2)
    return fem.Constant(square, 3.0) * ufl.dx


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(fenicsx, "form_cache", lambda: tmp_path)
    return tmp_path


def killed(folder: Path) -> Path:
    """Leave what a killed compilation leaves, and return its file."""
    (mark,) = folder.glob("*.c.cached")
    source = mark.with_suffix("")
    for path in folder.glob(f"{source.stem}*"):
        path.unlink()
    source.touch()
    return source


def test_a_killed_compilation_is_made_good(area: ufl.Form, folder: Path) -> None:
    assert fem.assemble_scalar(compiled(area)) == pytest.approx(3.0)
    source = killed(folder)
    assert fem.assemble_scalar(compiled(area)) == pytest.approx(3.0)
    assert source.with_suffix(".c.cached").exists()


@pytest.mark.parametrize("damage", ["gone", "cut", "empty"])
def test_a_damaged_module_is_compiled_again(area: ufl.Form, folder: Path, damage: str) -> None:
    assert fem.assemble_scalar(compiled(area)) == pytest.approx(3.0)
    fenicsx._WHOLE.clear()
    (module,) = folder.glob("*.so")
    content = module.read_bytes()
    module.unlink()  # it stays loaded here
    if damage != "gone":
        module.write_bytes(content[: len(content) // 2 if damage == "cut" else 0])
    assert fem.assemble_scalar(compiled(area)) == pytest.approx(3.0)
    assert len(module.read_bytes()) == len(content)


def test_no_compiler_is_told(area: ufl.Form, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And all is well as soon as there is one."""
    with monkeypatch.context() as patch:
        patch.setenv("CC", "/nowhere/cc")
        with pytest.raises(ImportError, match=r"/nowhere/cc'. A C compiler, .* are needed$"):
            compiled(area)
    assert fem.assemble_scalar(compiled(area)) == pytest.approx(3.0)
    assert list(folder.glob("*.so"))


def test_what_another_process_compiles_stays(area: ufl.Form, folder: Path) -> None:
    compiled(area)
    source = killed(folder)
    other = os.open(folder / LOCK, os.O_RDWR)
    fcntl.flock(other, fcntl.LOCK_SH)
    with fenicsx._compiling(folder):
        assert source.exists()
    os.close(other)
    with fenicsx._compiling(folder):
        assert not source.exists()


def test_the_cache_tells_compilers_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    folders = []
    for name in ("cc", "no-such-compiler"):
        monkeypatch.setenv("CC", name)
        fenicsx.form_cache.cache_clear()
        folders.append(fenicsx.form_cache())
    fenicsx.form_cache.cache_clear()
    assert len(set(folders)) == 2
    assert len({folder.parent for folder in folders}) == 1


def test_a_folder_that_cannot_be_made_is_told(
    area: ufl.Form, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(fenicsx, "form_cache", lambda: tmp_path / "file" / "cache")
    with pytest.raises(OSError, match="cache"):
        compiled(area)


def test_shared_code_that_some_ranks_lack(comm: MPI.Comm) -> None:
    """The first rank knows the code from a mesh of its own; all compile it together."""

    def volume(on: MPI.Comm, height: float) -> float:
        square = mesh.create_unit_square(on, 2, 2)
        constant = fem.Constant(square, height)
        forms = SharedForms(square, ("some ranks", [constant, None]))
        form = forms.compiled("volume", lambda: constant * ufl.dx)
        return float(on.allreduce(fem.assemble_scalar(form)))

    if comm.rank == 0:
        assert volume(MPI.COMM_SELF, 2.0) == pytest.approx(2.0)
    for height in (3.0, 4.0):
        assert volume(comm, height) == pytest.approx(height)


def test_unknown_symbols_are_not_shared(alone: MPI.Comm) -> None:
    square = mesh.create_unit_square(alone, 2, 2)
    for height in (3.0, 4.0):
        forms = SharedForms(square, ("unknown", NotImplemented))
        form = forms.compiled("volume", lambda height=height: height * ufl.dx(square))  # type: ignore[misc]
        assert fem.assemble_scalar(form) == pytest.approx(height)
