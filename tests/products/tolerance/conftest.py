"""Tolerances of one print, which several tests look at."""

import pytest
from helpers.worn import Printed, printed_tube
from mpi4py import MPI

import toros_fem as tf
from toros_fem.products.options import ToleranceConfig
from toros_fem.products.tolerance.simulated import ToleranceResult


@pytest.fixture(scope="session")
def printed(alone: MPI.Comm) -> Printed:
    return printed_tube(alone)


@pytest.fixture(scope="session")
def found(printed: Printed) -> ToleranceResult:
    small = ToleranceConfig(modulus=0.01, thickness=0.01, pressure_change=0.005)
    return tf.tolerances(*printed, small)
