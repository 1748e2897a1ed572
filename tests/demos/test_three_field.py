"""The demo of the three-field scheme: its variants, its table and its picture strip."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.designs import problem_of
from helpers.warned import warned
from matplotlib.figure import Figure
from mpi4py import MPI

from demos import three_field
from toros_fem import errors
from toros_fem.design.loop.fields import random_density

SMALL = three_field.ThreeFieldScene.of(
    length=0.08,
    edge_length=6e-3,
    filter_radius=9e-3,
    angle=45.0,
    perimeter_weight=1e-4,
    iterations=1,
    constrained_iterations=1,
)


def test_variants_take_the_same_number_of_steps() -> None:
    found = three_field.variants(SMALL)
    assert {c.design.iterations + c.design.constrained_iterations for c in found.values()} == {2}
    weights = [c.design.perimeter_weight for c in found.values()]
    assert weights == [None] * 4 + [1e-4] * 2
    assert [bool(c.design.constrained_iterations) for c in found.values()] == [
        False, False, False, True, False, True,
    ]  # fmt: skip
    with pytest.raises(errors.ParameterError, match="perimeter_weight = None"):
        three_field.variants(SMALL.updated(perimeter_weight=None))


def test_first_variant_has_no_filter_and_no_projection(alone: MPI.Comm) -> None:
    config = three_field.variants(SMALL)["no filter"]
    with warned(alone, match="filter radius"):
        problem = problem_of(alone, config)
    density = random_density(problem.skin, 1)
    filtered, projected = problem.fields.forward(density)
    assert np.array_equal(filtered, density)
    designed = problem.designed
    assert projected[designed] == pytest.approx(density[designed], abs=1e-6)


@pytest.mark.slow
@pytest.mark.usefixtures("without_pictures")
def test_table_and_strip(alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The strip's pictures are looked at in tests/results/pictures."""
    folder = tmp_path / "out"
    monkeypatch.setattr(Figure, "savefig", lambda self, to, **how: to.write(b"PNG"))
    three_field.run(alone, folder, SMALL)
    written = json.loads((folder / "three_field.json").read_text(encoding="utf-8"))
    rows = written["rows"]
    assert [row["variant"] for row in rows] == list(three_field.variants(SMALL))
    assert written["inputs"] == SMALL.as_dict()
    assert {row["iterations"] for row in rows} == {2}
    by_name = {row["variant"]: row for row in rows}
    assert by_name["filter only"]["grey_level"] > 1.1 * by_name["projection"]["grey_level"]
    assert by_name["perimeter"]["shape_designed"] != by_name["projection"]["shape_designed"]
    for name in ("three_field.png", "fig4.png", "fig5.png"):
        assert (folder / name).is_file()
