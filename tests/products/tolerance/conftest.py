"""Tolerances of one print, which several tests look at."""

import pytest
from helpers.worn import Printed, printed_tube
from mpi4py import MPI

import toros_fem as tf


@pytest.fixture(scope="session")
def printed(comm: MPI.Comm) -> Printed:
    return printed_tube(comm)


@pytest.fixture(scope="session")
def found(printed: Printed) -> tf.Tolerances:
    return tf.tolerances(*printed)
