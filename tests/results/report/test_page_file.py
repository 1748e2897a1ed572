"""The page holds all of a run, and nothing from elsewhere."""

import html
import json
import re
from pathlib import Path

import pytest
from helpers.runs import change_summary

from toros_fem.base.errors import FileError, OutputError
from toros_fem.measures.figures import Figure
from toros_fem.results.report.page_file import write_report
from toros_fem.results.report.tables import as_text, key_figures
from toros_fem.results.runs.stored_run import read_run, summary_of


def scene_of(page: str) -> dict:
    found = re.search(r'id="scene">(.*?)</script>', page, re.DOTALL)
    assert found
    return dict(json.loads(found[1]))


def test_all_parts_are_there(run: Path) -> None:
    path = write_report(run)
    assert path == run / "report.html"
    page = path.read_text(encoding="utf-8")
    assert not re.search(r"@[A-Z]+@", page), "every place is filled"
    for text in ("88.25°", "± 1.5°", "90°", "89°", "fabric", "summary.json", "1.0", "cone"):
        assert text in page
    assert page.count('<svg class="chart"') == 2, "one over the pressure, one over iterations"
    assert "70° (paper)" in page
    scene = scene_of(page)
    assert scene["start"] == {"series": "pressure", "index": 4}
    assert [entry["label"] for entry in scene["series"]["iteration"]][-1] == "11 of 11"
    assert ["angle", "60°"] in scene["series"]["pressure"][4]["shown"]
    assert ">88.2 ± 1.5°<" in page, "what the summary says, on the curve"
    change_summary(run, figures=[Figure("pressure", "pa", 2e4).as_dict()])
    page = html.unescape(write_report(run).read_text(encoding="utf-8"))
    assert "at 20 kPa" not in page, "the curve ends before it"


def test_a_finer_mesh_is_named(run: Path) -> None:
    for other, said in (("1.5", False), ("0.5", True)):
        change_summary(run, errors={"meshes": {"1.0": {}, other: {}}})
        page = write_report(run).read_text(encoding="utf-8")
        assert ("key figures those of a finer one" in page) is said
        assert ("dots with intervals are of a finer mesh" in page) is said


def test_an_interval_that_is_not_known_is_told_in_words(run: Path) -> None:
    """Warnings tell the reason."""
    told = Figure("angle", "deg", 88.25, None, 90.0, 2.7).as_dict()
    change_summary(run, figures=[told])
    (line,) = key_figures(read_run(run)).rows
    assert line[2] == "not estimated"
    page = html.unescape(write_report(run).read_text(encoding="utf-8"))
    assert "not estimated" in page
    assert "not certain (error not estimated)" in as_text(summary_of(run))


def test_nothing_is_fetched(run: Path) -> None:
    page = write_report(run).read_text(encoding="utf-8")
    assert "default-src 'none'" in page
    own = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    links = re.findall(r'(?:src|href)="([^"]*)"', own)
    assert links
    assert not [link for link in links if re.match(r"(https?:)?//", link)]
    assert set(re.findall(r"https?://[\w./]+", page)) <= {
        "http://www.w3.org/1999/xhtml", "http://www.w3.org/2000/svg",
    }  # fmt: skip


def test_names_of_panels_are_no_identifiers(run: Path) -> None:
    """A panel may be called like a part of the page."""
    named = {f"<title>{name}</title>" for name in ("wall", "base", "tip")}
    page = write_report(run).read_text(encoding="utf-8")
    assert all(title in page for title in named)
    body = re.sub(r'<script.*?</script>|<svg class="chart".*?</svg>', "", page, flags=re.DOTALL)
    known = re.findall(r'\bid="([^"]*)"', body)
    assert known
    assert len(set(known)) == len(known)
    assert not {"wall", "base", "tip"} & set(known)


def test_what_is_unusual_is_told(run: Path) -> None:
    """In the page and in the terminal; of a run without a summary, by its frames."""
    warnings = ["At 10 kPa: It is near a limit point.", "1 place is narrower than <that>."]
    change_summary(run, manufacture={"pieces": 3, "islands": 1}, warnings=warnings)
    page = html.unescape(write_report(run).read_text(encoding="utf-8"))
    for text in (*warnings, "of these 1 island<"):
        assert text in page
    assert as_text(read_run(run).summary).endswith("Warnings:\n  " + "\n  ".join(warnings))
    (run / "summary.json").unlink()
    page = html.unescape(write_report(run).read_text(encoding="utf-8"))
    assert "This run has no summary" in page
    assert "At 10 kPa: It is near a limit point." in page


def test_the_page_says_what_was_missed(run: Path) -> None:
    """By how much, what binds, and the state of each figure, those of the shape too."""
    figures = [
        Figure("angle", "deg", 80.0, 1.5, 90.0, 2.7),
        Figure("shape_distance", "percent", 2.0, 0.5, 0.0, 3.0),
        Figure("tip_distance", "mm", 4.0, 0.5, 0.0),
    ]
    change_summary(
        run,
        figures=[figure.as_dict() for figure in figures],
        verdict={"state": "missed", "words": "", "binding": ["pressure at its bound, 5 kPa"]},
    )
    page = html.unescape(write_report(run).read_text(encoding="utf-8"))
    for text in (
        '<section id="verdict"><h2>Missed</h2>',
        "<p>Angle 10.0° short of 90° (± 1.5°; within 2.7° is reached).</p>",
        "<p>What binds: pressure at its bound, 5 kPa.</p>",
        "<td>90 ± 2.7°</td>",
        ">shape distance</t",
        ">tip distance</t",
        "<td>reached</td>",
        "<td>missed</td>",
    ):
        assert text in page
    change_summary(run, figures=[Figure("angle", "deg", 80.0).as_dict()], verdict=None)
    assert 'id="verdict"' not in write_report(run).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["history.csv", "curve.csv"])
def test_a_row_that_a_kill_cut_off_is_left_out(run: Path, name: str) -> None:
    whole = (run / name).read_bytes()
    rows = whole.count(b"\n") - 1
    for missing in (2, 5, 9):
        (run / name).write_bytes(whole[:-missing])
        found = read_run(run)
        assert len(found.history if name == "history.csv" else found.curve) == rows - 1
        write_report(run)


def test_the_name_of_a_folder_is_no_place_to_fill(run: Path) -> None:
    named = run.rename(run.with_name("my @DATA@ run"))
    page = write_report(named).read_text(encoding="utf-8")
    assert "<h1>my @DATA@ run</h1>" in page
    assert "<title>my @DATA@ run – toros_fem</title>" in page


def test_a_run_without_a_curve_shows_its_print(run: Path) -> None:
    (run / "curve.csv").unlink()
    for path in (run / "frames").glob("pressure-*"):
        if path.stem == "pressure-000004":
            path.rename(path.with_name("print-000000.npz"))
        else:
            path.unlink()
    scene = scene_of(write_report(run).read_text(encoding="utf-8"))
    assert [entry["label"] for entry in scene["series"]["pressure"]] == ["5 kPa"]


def test_history_alone_makes_a_report(run: Path) -> None:
    for path in (*run.glob("frames/*"), run / "summary.json", run / "curve.csv"):
        path.unlink()
    page = write_report(run).read_text(encoding="utf-8")
    assert scene_of(page) == {"series": {}}
    assert page.count('<svg class="chart"') == 1


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("summary.json", "{", "summary.json cannot be read"),
        ("summary.json", "[]", "holds no table"),
        ("summary.json", '{"angle_deg": 1.0}', "written by an earlier version of toros_fem"),
        ("summary.json", '{"figures": [{"name": "angle"}]}', "is no figure"),
        ("summary.json", '{"figures": [], "inputs": [3], "seconds": "x"}', "no run writes"),
        ("history.csv", "a,b\n1,x\n", "history.csv cannot be read"),
        ("history.csv", "iteration,objectiv\n1,2\n", "line 2 has not .* and objective"),
        ("history.csv", "iteration,objective,x\n1,2,3\n1,2\n", "line 3 has not as many cells"),
        ("curve.csv", "pressure_pa,x\n1,2,3\n", "line 2 has not as many cells"),
        ("frames/iteration-000003.npz", "no archive", "iteration-000003.npz cannot be read"),
    ],
)
def test_damaged_files_are_named(run: Path, name: str, content: str, words: str) -> None:
    (run / name).write_text(content, encoding="utf-8")
    with pytest.raises(OutputError, match=words):
        write_report(run)


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="holds neither frames"):
        write_report(tmp_path)
    with pytest.raises(FileError, match="is no folder"):
        write_report(tmp_path / "missing")
    (tmp_path / "frames").mkdir()
    with pytest.raises(FileError, match="holds neither frames"):
        write_report(tmp_path)


def test_a_table_may_hold_the_direction_of_a_pull(run: Path) -> None:
    """Of a sheet of tiles `toros view` failed: "could not convert string to float: 'x'"."""
    (run / "curve.csv").write_text("direction,strain\nx,0.01\ny,0.02\n", encoding="utf-8")
    assert read_run(run).curve == [{"strain": 0.01}, {"strain": 0.02}]
    write_report(run)
