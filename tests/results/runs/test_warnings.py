"""Warnings of a run: what they say, where they stand, and what of a curve was never tested."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

from toros_fem.measures.figures import Figure
from toros_fem.results.pictures.curves import last_tested
from toros_fem.results.result import RunResult, write_summary
from toros_fem.results.runs.open_run import open_run
from toros_fem.results.runs.stored_run import StoredCurve, known_use, notes_at, warnings_of


class Told(RunResult):
    """A result with a note."""

    figures = (Figure("angle", "deg", 1.0),)
    notes: Sequence[str] = ("At 2 kPa: The skin may have snapped.",)

    def entries(self) -> dict[str, Any]:
        return {"manufacture": {"narrow_places": 1}}

    def description(self) -> str:
        return "an angle"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({}, []),
        (
            {"manufacture": {"islands": 2}},
            ["2 islands of the print hang on nothing but the fabric."],
        ),
        (
            {"manufacture": {"tight_places": 1, "narrow_places": 0}},
            ["1 gap is narrower than the printer's least gap."],
        ),
        ({"printed_failure": "no step"}, ["The print has no equilibrium: no step."]),
        (
            {"curve": {"failure_above": "no step."}},
            ["The curve ends before higher pressures: no step."],
        ),
        ({"load": {"printed": {"failure": "it fell"}}}, ["The lift ends early: it fell."]),
        (
            {"errors": {"failure": "one mesh"}, "curve": None},
            ["The discretisation error is unknown: one mesh."],
        ),
    ],
)
def test_what_a_summary_warns_of(content: dict[str, Any], said: list[str]) -> None:
    assert warnings_of(content) == said


@pytest.mark.parametrize(
    ("tested", "used", "warned"),
    [
        (1.5, 0.9, True),
        (1.81, 0.9, False),
        (1.8, 0.9, False),
        (None, 0.9, False),
        (1.5, 0.5, False),
    ],
)
def test_a_fabric_beyond_its_tests(tested: float | None, used: float, warned: bool) -> None:
    """0.9 of a bound of 1.9 is a stretch of 1.81; 2 % of the strain more is no reason to warn."""
    figures = [Figure("stretch", "use", used).as_dict()]
    content = {"inputs": {"tested_stretch": tested, "c1": 1.9}, "figures": figures}
    found = warnings_of(content)
    assert bool(found) == warned
    if warned:
        assert "up to about 1.81, and the fabric was tested up to 1.5" in found[0]


def test_which_part_of_a_curve_was_tested() -> None:
    tested = known_use({"inputs": {"tested_stretch": 1.45, "c1": 1.9}})
    assert tested == pytest.approx(0.5)
    rows = [{"pressure_pa": p, "stretch_use": p / 10} for p in (1.0, 3.0, 5.0, 7.0, 9.0)]
    assert last_tested(StoredCurve(rows, tested=tested)) == 2
    assert last_tested(StoredCurve(rows, tested=0.05)) == 0
    assert (
        last_tested(StoredCurve(rows, tested=None))
        == last_tested(StoredCurve(rows, tested=0.9))
        == 4
    )
    assert known_use({"inputs": None}) is None


def test_pressures_of_one_note_stand_together() -> None:
    notes = [(1e3 * k, "It is near a limit point.") for k in range(1, 9)]
    assert notes_at([(500.0, "It snapped."), *notes, (1.0, "")]) == [
        "At 0.5 kPa: It snapped.",
        "At 1 kPa, 2 kPa, 3 kPa, 4 kPa, 5 kPa, 6 kPa, …: It is near a limit point.",
    ]


def test_what_is_logged_while_a_run_is_open_is_in_its_summary(
    alone: MPI.Comm, tmp_path: Path
) -> None:
    """Once, with the notes of the result and what its entries warn of."""
    log = logging.getLogger("toros_fem.products")
    log.warning("before")
    with open_run(alone, tmp_path / "run", {}):
        for _ in range(2):
            log.warning("a mesh is left out")
        log.info("no warning")
        content = write_summary(alone, tmp_path / "run", Told())
    log.warning("after")
    assert content["warnings"] == [
        "a mesh is left out.",
        "At 2 kPa: The skin may have snapped.",
        "1 place is narrower than the printer's least line.",
    ]
