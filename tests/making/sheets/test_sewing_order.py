"""Order of sewing: a ring after the seams that end at it, the opening last."""

import numpy as np
import pytest
from helpers.runs import tube
from mpi4py import MPI

from toros_fem.making.panels.seam_lines import sewn_seams
from toros_fem.making.sheets.sewing_order import SewingStep, sewing_order
from toros_fem.meshes import Pattern, cylinder
from toros_fem.meshes.pattern import Panel


def strip(name: str, x: float, turn: float, count: int = 4) -> Panel:
    """A rectangle of 10 × 40 mm, as one of three walls around an axis."""
    u, v = np.meshgrid([0.0, 1.0], np.linspace(0, 1, count + 1))
    flat = np.column_stack([10e-3 * u.ravel() + x, 40e-3 * v.ravel()])
    k = 2 * np.arange(count)[:, None]
    triangles = np.concatenate([k + [0, 1, 3], k + [0, 3, 2]])
    angle = 2 * np.pi * (turn + u.ravel() / 3)
    around = np.column_stack([np.cos(angle), np.sin(angle), 4 * v.ravel()])
    return Panel(name, flat, triangles, 10e-3 * around)


def test_a_tube_is_closed_before_its_caps() -> None:
    pattern = tube()
    seams = {seam.number: seam for seam in sewn_seams(pattern)}
    steps = sewing_order(pattern, list(seams.values()))
    assert sorted(step.seam for step in steps) == sorted(seams)
    assert [step.kind for step in steps] == ["edge", "ring", "closing"]
    assert seams[steps[0].seam].panels[0] == seams[steps[0].seam].panels[1]
    last = seams[steps[-1].seam]
    assert pattern.panel_names[last.panels[1]] == "base"
    assert steps[-1].opening == pytest.approx(last.length)  # short enough to stay open whole
    assert not any(step.opening for step in steps[:-1])


def test_the_bladders_tube_chooses_the_last_seam() -> None:
    pattern = tube()
    seams = sewn_seams(pattern)
    tip = next(s for s in seams if pattern.panel_names[s.panels[1]] == "tip")
    last = sewing_order(pattern, seams, [tip.number])[-1]
    assert last == SewingStep(tip.number, "closing", tip.length)


def test_pieces_are_joined_flat_before_they_are_closed() -> None:
    walls = [strip(f"wall {k}", 0.02 * k, k / 3) for k in range(3)]
    pattern = Pattern.from_panels(walls, 1e-6)
    steps = sewing_order(pattern, sewn_seams(pattern))
    assert [step.kind for step in steps] == ["flat", "flat", "closing"]
    assert steps[-1].opening == pytest.approx(40e-3)


def test_an_open_tube_has_one_seam_only() -> None:
    pattern = cylinder(MPI.COMM_SELF, 0.2, 0.02, 8e-3, caps=None, mesh="left")
    (step,) = sewing_order(pattern, sewn_seams(pattern))
    assert step.kind == "closing"
    assert step.opening == pytest.approx(60e-3)
