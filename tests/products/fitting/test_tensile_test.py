"""Branches of load cycles, and tests that are none."""

from itertools import pairwise

import numpy as np
import pytest

from toros_fem.base.errors import FileError
from toros_fem.products.fitting.samples import TensileTest


def cycles(noise: float = 0.0) -> TensileTest:
    """Three cycles, each to a larger stretch; the stress holds the number of the branch."""
    rng = np.random.default_rng(0)
    ends = [1.0, 1.3, 1.05, 1.4, 1.1, 1.5, 1.0]
    parts = [np.linspace(a, b, 40, endpoint=False) for a, b in pairwise(ends)]
    stretch = np.concatenate(parts) + noise * rng.standard_normal(240)
    return TensileTest(stretch, np.repeat(np.arange(6.0), 40), 1e-3, lateral=2 - stretch / 2)


@pytest.mark.parametrize("noise", [0.0, 0.004])
@pytest.mark.parametrize(
    ("which", "number", "ends"),
    [
        ("first-loading", 0, (1.0, 1.3)),
        ("last-loading", 4, (1.1, 1.5)),
        ("last-unloading", 5, (1.5, 1.0)),
    ],
)
def test_branches(noise: float, which: str, number: int, ends: tuple[float, float]) -> None:
    found = cycles(noise).branch(which)
    inner = found.stress[4:-4]
    assert (inner == number).all()
    assert found.stretch[[0, -1]] == pytest.approx(ends, abs=0.02)
    assert found.lateral == pytest.approx(2 - found.stretch / 2)


def test_all_and_one_pull() -> None:
    test = cycles()
    assert test.branch("all") is test
    stretch: np.ndarray = np.linspace(1, 1.5, 20)
    pull = TensileTest(stretch, stretch, 1e-3)
    assert np.array_equal(pull.branch("last-loading").stretch, stretch)
    with pytest.raises(FileError, match="no branch of unloading"):
        pull.branch("last-unloading")
