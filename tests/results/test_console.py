"""Lines of the console stand under their titles; the bar shows on a terminal only."""

import io
import sys
from typing import Any

import pytest
from mpi4py import MPI

from toros_fem.base.units import duration
from toros_fem.design.loop.options import Iteration
from toros_fem.mechanics.equilibrium.continuation import NewtonStep
from toros_fem.results.reporter import ProgressBar, header, line, print_step


def row(metrics: dict[str, float]) -> Iteration:
    values: dict[str, Any] = {name: 0 for name in Iteration.__dataclass_fields__}
    values |= {"iteration": 7, "level": 2, "stage": 1, "objective": 1.5e-3, "pressure": 5e3}
    values |= {"g_r": 1e-5, "rejected": 2, "newton_steps": 31, "seconds": 1.25}
    return Iteration(**{**values, "metrics": metrics})


class Terminal(io.StringIO):
    """A stream that says to be a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    "metrics", [{}, {"angle_deg": 179.3}, {"angle_deg": -12.5, "a_very_long_name_percent": 100.0}]
)
def test_line_has_a_value_for_each_title(metrics: dict[str, float]) -> None:
    titles, values = header(row(metrics)), line(row(metrics))
    assert len(titles.split()) == len(values.split()) == 12 + len(metrics)
    found = dict(zip(titles.split(), values.split(), strict=True))
    assert found["it"] == "7"
    assert found["level"] == "2"
    assert found["stage"] == "1"
    assert found["kPa"] == "5.000"
    assert found["rejected"] == "2"
    assert found["newton"] == "31"
    for key, value in metrics.items():
        title = "/".join(key.rsplit("_", 1))
        assert float(found[title]) == pytest.approx(value, abs=0.005)
        # A value ends where its title ends.
        end = titles.index(title) + len(title)
        assert values[:end].split()[-1] == found[title]


def test_bar_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    bar = ProgressBar()
    bar.advance(1)
    assert screen.getvalue() == "", "nothing is shown of an unknown number of steps"
    bar.expect(40)
    bar.advance(10)
    assert "10/40" in screen.getvalue()
    bar.expect(20)
    assert "10/20" in screen.getvalue()
    bar.advance(20)
    assert screen.getvalue().endswith("\r"), "the last step removes the bar"
    bar.close()


def test_lines_without_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Now and then, with the time left; steps before a run was resumed took no time."""
    stream, clock = io.StringIO(), iter((0.0, 20.0, 40.0, 50.0, 5000.0, 5010.0))
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr("toros_fem.results.reporter.time.monotonic", lambda: next(clock))
    bar = ProgressBar()
    bar.expect(40)
    for done in (10, 11, 12, 13, 20, 40):
        bar.advance(done)
    bar.close()
    assert stream.getvalue() == ""
    assert capsys.readouterr().out.splitlines() == [
        "step 12 of 40, about 9.3 min left",
        "step 20 of 40, about 2.8 h left",
    ]
    assert [duration(s) for s in (3.4, 59, 61, 7000)] == ["3 s", "59 s", "1.0 min", "1.9 h"]


def test_steps_of_the_first_rank_are_printed(
    comm: MPI.Comm, capsys: pytest.CaptureFixture[str]
) -> None:
    fields: dict[str, Any] = {name: 1 for name in NewtonStep.__dataclass_fields__}
    step = NewtonStep(**{**fields, "kind": "newton"})
    print_step(comm)(step)
    assert capsys.readouterr().out == (f"    {step}\n" if comm.rank == 0 else "")
