"""Warnings, which the first rank alone gives."""

from contextlib import AbstractContextManager, nullcontext
from typing import Any

import pytest
from mpi4py import MPI

from toros_fem.base.errors import TorosWarning


def warned(comm: MPI.Comm, match: str) -> AbstractContextManager[Any]:
    """Return a context that needs a warning on the first rank, and accepts none on the others."""
    return pytest.warns(TorosWarning, match=match) if comm.rank == 0 else nullcontext()
