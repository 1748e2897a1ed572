"""Prints with narrower and wider lines, against those of `toros tolerance`."""

import dataclasses

import numpy as np
import pytest
from helpers.worn import printed_tube
from mpi4py import MPI

from toros_fem.making.as_printed.print_spread import print_spread
from toros_fem.products.options import ToleranceConfig
from toros_fem.products.tolerance.simulated import tolerances

WIDTH = 1e-4


def test_angles_are_those_of_the_tolerances(alone: MPI.Comm) -> None:
    problem, printed = printed_tube(alone)
    found = print_spread(printed, WIDTH / 2)
    only = ToleranceConfig(width=WIDTH, modulus=None, thickness=None, pressure_change=None)
    wanted = {v.change: v.values for v in tolerances(problem, printed, only).variants}
    for values, change in zip(found.metrics, (-WIDTH, WIDTH), strict=True):
        assert values["angle_deg"] == pytest.approx(wanted[change]["angle_deg"], abs=1e-3)
    narrow, wide = (values["angle_deg"] for values in found.metrics)
    assert abs(narrow - wide) > 0.05
    assert found.error({"angle_deg": 60.0}) == pytest.approx(abs(narrow - wide) / 120)
    # The shapes tell the same: the tip's motion is that of its turn.
    tip = problem.skin.pattern.vertices_of("tip")
    half = found.half[tip].mean(axis=0)
    assert 1e-5 < np.linalg.norm(half) < 1e-3


def test_none_without_an_equilibrium(comm: MPI.Comm) -> None:
    _, printed = printed_tube(comm)
    missing = dataclasses.replace(printed, evaluation=None, failure="none")
    assert print_spread(missing, WIDTH / 2) is None
