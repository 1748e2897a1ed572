"""All pictures of a run come from its folder."""

from pathlib import Path

import numpy as np
import pytest
from helpers.runs import change_summary, regions_of
from PIL import Image

from toros_fem.base.errors import FileError
from toros_fem.making.printability import PrintLimits, write_print_polygons
from toros_fem.measures.figures import Figure
from toros_fem.meshes import Pattern
from toros_fem.results.pictures.of_run import _Pictures, draw_run, facts_of, sentence
from toros_fem.results.runs.stored_run import read_run

pytestmark = pytest.mark.usefixtures("rough")
MOST = 500_000


@pytest.mark.slow
def test_a_finished_run_has_all_pictures(run: Path, pattern: Pattern) -> None:
    write_print_polygons(run / "print.npz", pattern, regions_of(pattern), PrintLimits())
    found = [path.name for path in draw_run(run)]
    assert found == [
        "shape.png", "miss.png", "inflation.png", "hero.png", "pattern.png", "curve.png",
        "design.png",
    ]  # fmt: skip
    for name in found:
        path = run / name
        assert path.stat().st_size < MOST
        with Image.open(path) as picture:
            assert picture.size[0] == 1600
            assert picture.info["Description"] == "angle 88.2 ± 1.5° of 90°"
            assert picture.info["Title"] == "run"
    assert not list(run.glob("*.unfinished"))
    before = {name: (run / name).read_bytes() for name in found}
    draw_run(run)
    assert before == {name: (run / name).read_bytes() for name in found}, "equal runs, equal bytes"


def test_a_run_that_was_stopped_has_what_it_has(run: Path) -> None:
    (run / "summary.json").unlink()
    (run / "curve.csv").unlink()
    for path in (run / "frames").glob("pressure-*"):
        path.unlink()
    assert [path.name for path in draw_run(run)] == ["shape.png", "miss.png", "design.png"]


def test_no_run_no_pictures(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no run"):
        draw_run(tmp_path)


def test_seed_and_figures_are_in_the_file(run: Path) -> None:
    change_summary(run, inputs={"design": {"seed": 7}})
    assert facts_of(read_run(run)) == {
        "Title": "run",
        "Description": "angle 88.2 ± 1.5° of 90°",
        "Comment": "seed 7",
    }


def test_sentences() -> None:
    angle = Figure("angle", "deg", 88.25, 1.5, 90.0, 2.7)
    assert sentence([angle], 5e3) == "Angle 88.2 ± 1.5° (target 90°) at 5 kPa"
    assert sentence([Figure("held_mass", "kg", 0.05)], None) == "Held mass 50 g"
    assert sentence([], 5e3) == "At 5 kPa"


def test_a_title_tells_figures_of_the_pressure_that_it_names(run: Path) -> None:
    """Not one of another pressure, as that of the saturation."""
    told = [Figure("angle", "deg", 88.25, 1.5), Figure("angle_when_saturated", "deg", 80.0)]
    change_summary(run, figures=[figure.as_dict() for figure in told])
    drawn = _Pictures(read_run(run))
    assert drawn.title.startswith("Angle 88.2 ± 1.5° at ")
    assert len(drawn.figures) == 2


def test_states_are_at_equal_steps_of_the_way(run: Path, pattern: Pattern) -> None:
    from toros_fem.results.pictures.of_run import states_of
    from toros_fem.results.pictures.shown import DrawnSkin

    found = read_run(run)
    frames = found.series["pressure"]
    state = frames[6]
    drawn = DrawnSkin(found.skins[state.skin])
    states = states_of(frames, state, drawn)
    assert [name for name, _ in states] == ["at rest", "2 kPa", "3 kPa", "5 kPa", "7 kPa"]
    assert np.array_equal(states[0][1], drawn.pattern.points)
    assert np.array_equal(states[-1][1], state.positions)
