"""The benchmark of the perimeter term: its settings, tables and resumption."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import perimeter
import pytest
from perimeter import CHOSEN, FREE, ORDERS, STUDIES, WITHOUT, Setting

ROWS = json.loads((perimeter.PAGE.parent.parent / "benchmarks" / "perimeter.json").read_text())


def test_all_orders_take_all_steps() -> None:
    for order, parts in ORDERS.items():
        assert sum(fraction for fraction, _, _ in parts) == pytest.approx(1), order
        stages = perimeter.parts_of(replace(CHOSEN, order=order), 70)
        assert sum(stage.iterations for stage, _ in stages) == 70
        assert sum(stage.iterations for stage, _ in stages if stage.constrained) == 30
        assert max(factor for _, factor in stages) == 1
        free = perimeter.parts_of(replace(FREE, order=order), 70)
        assert not any(stage.constrained for stage, _ in free)


def test_settings_have_names_of_their_own() -> None:
    settings = {setting for _, study in STUDIES.values() for setting in study}
    assert len({perimeter.label(setting) for setting in settings}) == len(settings)
    assert perimeter.label(WITHOUT) == "widths, no term"
    assert perimeter.label(replace(CHOSEN, seed=1)) == "widths, w = -20, 1·10⁻⁴, seed 1"


def test_rows_are_complete_and_on_the_page() -> None:
    for title, study in STUDIES.values():
        for setting in study:
            assert [row["setting"] for row in ROWS].count(asdict(setting)) == 1, (title, setting)
    page = perimeter.PAGE.read_text(encoding="utf-8")
    assert perimeter.with_tables(page, perimeter.tables(ROWS)) == page
    with pytest.raises(ValueError, match="needs the lines"):
        perimeter.with_tables("a page", "tables")


def test_known_designs_are_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Setting] = []

    def row_of(setting: Setting, *, quick: bool) -> dict[str, Any]:
        assert quick
        made.append(setting)
        return {"setting": asdict(setting), "failure": "there is none"}

    monkeypatch.setattr(perimeter, "row_of", row_of)
    file = tmp_path / "rows.json"
    perimeter.complete([WITHOUT, CHOSEN], file, quick=True)
    rows = perimeter.complete([CHOSEN, FREE], file, quick=True)
    assert made == [WITHOUT, CHOSEN, FREE]
    assert rows == json.loads(file.read_text(encoding="utf-8"))
    assert "no equilibrium" in perimeter.tables(rows)


def test_power_law() -> None:
    law = perimeter.PowerLaw(exponent=3.0)
    values = np.array([0.0, 0.3, 0.5, 1.0])
    assert law.forward(values) == pytest.approx(values**3)
    step = 1e-6
    slope = (law.forward(values + step)[1:3] - law.forward(values - step)[1:3]) / (2 * step)
    assert law.backward(values, np.ones(4))[1:3] == pytest.approx(slope, rel=1e-8)


def test_papers_sum_costs_the_same() -> None:
    """A metre of straight border raises T alike, whatever counts it."""
    ours, steps = perimeter.problem_of(replace(CHOSEN, sharpness=0.5), quick=True)
    papers, _ = perimeter.problem_of(replace(CHOSEN, sharpness=0.5, papers_sum=True), quick=True)
    assert steps == 4
    pattern = ours.skin.pattern
    along = pattern.centroids[:, 1]
    inside = pattern.panel == pattern.panel_index("wall")
    step = (inside & (along > np.median(along[inside])))[ours.skin.owned_cells].astype(float)
    costs = []
    for problem in (ours, papers):
        assert problem.perimeter is not None
        assert problem.perimeter_weight is not None
        costs.append(problem.perimeter_weight * problem.perimeter.forward(step))
    assert costs[1] == pytest.approx(costs[0], rel=0.35)


@pytest.mark.slow
def test_design_in_parts() -> None:
    """The term acts in its parts of the design only, and the row has its figures."""
    setting = replace(CHOSEN, order="late")
    problem, result = perimeter.designed(setting, quick=True)
    assert problem.perimeter is not None
    border = [row.perimeter for row in result.history]
    stages = [row.stage for row in result.history]
    assert [value > 0 for value in border] == [stage == 1 for stage in stages]
    assert result.history[-1].iteration == 4
    row = perimeter.row_of(replace(FREE, exponent=3.0), quick=True)
    assert row["setting"]["exponent"] == 3.0
    assert row["penalty_share"] is row["perimeter_mm"] is None
    assert row["steps"] == 4
