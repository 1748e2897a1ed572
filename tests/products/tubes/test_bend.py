"""The bending tube as a function: what cannot be written or held loses nothing."""

from pathlib import Path

import pytest
from mpi4py import MPI

from toros_fem import errors
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.products.tubes import bend

SMALL = bend.BendScene.of(length=0.06, edge_length=6e-3, filter_radius=9e-3, iterations=1)


def test_output_that_cannot_be_written(alone: MPI.Comm, tmp_path: Path) -> None:
    """Rank 0 alone writes, yet all ranks raise."""
    (tmp_path / "taken").write_text("a file, not a folder", encoding="utf-8")
    with pytest.raises(errors.OutputError, match="taken could not be written"):
        SMALL.run_design(alone, tmp_path / "taken")


def test_failure_keeps_what_is_written(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A design that nothing holds is refused; files of a run before stay as they are."""
    names = ("summary.json", "history.csv", "pattern.svg")
    for name in names:
        (tmp_path / name).write_text(f"{name} of a run before", encoding="utf-8")

    def refuses(*_: object, **__: object) -> None:
        raise errors.NoEquilibriumError("made to fail")

    monkeypatch.setattr(EquilibriumSolver, "solve", refuses)
    with pytest.raises(errors.NoEquilibriumError, match="made to fail"):
        SMALL.run_design(alone, tmp_path)
    for name in names:
        assert (tmp_path / name).read_text(encoding="utf-8") == f"{name} of a run before"
