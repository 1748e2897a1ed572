"""A notebook shows runs, and reads their tables as they are."""

import csv
import sys
from pathlib import Path

import pytest
from helpers.runs import change_summary

from toros_fem.base.errors import FileError, MissingPackageError
from toros_fem.measures.figures import Figure
from toros_fem.products.actuators.result import SkinDesign
from toros_fem.products.tiles.report import TileRun
from toros_fem.products.tubes.inflate import InflationResult
from toros_fem.results.report.page_file import read_summary, write_report
from toros_fem.results.result import RunResult


def test_a_run_is_a_table_of_its_figures(run: Path) -> None:
    table = read_summary(run)._repr_html_()
    assert "<td>angle</td><td>88.2 ± 1.5°</td><td>90 ± 2.7°</td><td>not certain" in table
    change_summary(run, figures=[Figure("<b>", "deg", None).as_dict()])
    assert "&lt;b&gt;</td><td>no equilibrium" in read_summary(run)._repr_html_()


def test_a_view_is_the_page_in_a_frame_of_its_own(run: Path) -> None:
    shown = read_summary(run).show(height=321)
    frame = shown._repr_html_()
    assert "height: 321px" in frame
    assert 'sandbox="allow-scripts"' in frame
    assert frame.count('"') == 6, "the page is escaped"
    assert 'id="canvas"' in shown.page
    assert 'id="figures"' not in shown.page
    assert repr(shown) == "EmbeddedPage(height=321)", "beside HTML a notebook keeps this text"
    with pytest.raises(FileError, match="is no folder"):
        read_summary(run / "missing").show()


def test_a_result_is_told_in_a_line() -> None:
    """A notebook and a console show it, and not the arrays of a run."""
    known = [*RunResult.__subclasses__()]
    for kind in known:
        known += kind.__subclasses__()
    assert {SkinDesign, InflationResult, TileRun} < set(known)
    assert [kind for kind in known if kind.__repr__ is not RunResult.__repr__] == []
    empty = object.__new__(SkinDesign)
    assert repr(empty) == "SkinDesign()"
    object.__setattr__(empty, "folder", Path("output/bend"))
    assert repr(empty) == "SkinDesign('output/bend')"


@pytest.mark.parametrize("package", ["jinja2", "matplotlib"])
def test_a_missing_package_is_named_with_its_extra(
    run: Path, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in list(sys.modules):
        if name.partition(".")[0] == package:
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingPackageError, match=rf"{package}.*pip install '\.\[plot\]'"):
        write_report(run)


def test_tables_have_one_line_of_names_and_plain_numbers(run: Path) -> None:
    """So that `pandas.read_csv` needs no arguments."""
    for name in ("history.csv", "curve.csv"):
        text = (run / name).read_text(encoding="ascii")
        head, *rows = csv.reader(text.splitlines())
        assert all(name.isidentifier() for name in head)
        assert len(set(head)) == len(head)
        assert len(rows) == text.count("\n") - 1 > 1
        assert all([float(value) for value in row] and len(row) == len(head) for row in rows)
