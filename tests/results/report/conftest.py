"""Runs to report of."""

from pathlib import Path

import pytest
from helpers.runs import tube, write_run

from toros_fem.meshes import Pattern


@pytest.fixture(scope="session")
def pattern() -> Pattern:
    return tube()


@pytest.fixture
def run(tmp_path: Path, pattern: Pattern) -> Path:
    """A finished run."""
    return write_run(tmp_path / "run", pattern)
