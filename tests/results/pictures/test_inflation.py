"""States stand in the rows in which they are largest."""

import numpy as np
import pytest

from toros_fem.results.pictures.of_run import GAP, NAME_ABOVE, NAME_ACROSS, arrange

PAGE = np.array([400.0, 180.0])  # points


def boxes(*sizes: tuple[float, float]) -> list[np.ndarray]:
    """Extents in m from sizes in mm, each from the place of its foot."""
    return [1e-3 * np.array([[-w / 2, 0.0], [w / 2, h]]) for w, h in sizes]


def rows_of(moves: np.ndarray) -> list[int]:
    """Number of states in each row, from the top."""
    return [int(n) for n in np.unique(-moves[:, 1].round(6), return_counts=True)[1]]


@pytest.mark.parametrize(
    ("size", "rows"),
    [((20, 150), [5]), ((140, 100), [3, 2]), ((150, 20), [2, 2, 1]), ((300, 10), [1] * 5)],
)
def test_rows_by_the_shape(size: tuple[float, float], rows: list[int]) -> None:
    """Tall ones stand in one row, flat ones lie above each other, others in a grid."""
    extents = boxes(*[size] * 5)
    found = arrange(extents, PAGE)
    assert rows_of(found.moves) == rows


@pytest.mark.parametrize("size", [(20, 150), (140, 100), (150, 20), (300, 10), (4, 3), (70, 70)])
@pytest.mark.parametrize("number", [1, 2, 3, 5])
def test_states_are_apart_and_on_the_page(size: tuple[float, float], number: int) -> None:
    """With their names, in points; none could be larger in any of the other rows."""
    extents = np.array(boxes(*[size] * number))
    found = arrange(list(extents), PAGE)
    placed = found.scale * (extents + found.moves[:, None])
    low, high = found.scale * found.low, found.scale * found.high
    assert np.all(high - low <= PAGE + 1e-9)
    assert np.all(placed[:, 0] >= low - 1e-9)
    assert np.all(placed[:, 1] + [0, NAME_ABOVE] <= high + 1e-9)
    for k, one in enumerate(placed):
        for other in placed[:k]:
            across = max(one[0, 0] - other[1, 0], other[0, 0] - one[1, 0])
            above = max(one[0, 1] - other[1, 1], other[0, 1] - one[1, 1])
            names = abs(one[:, 0].mean() - other[:, 0].mean())
            beside = across >= GAP - 1e-9 and names >= NAME_ACROSS - 1e-9
            assert beside or above >= GAP + NAME_ABOVE - 1e-9
    wide, tall = 1e-3 * np.array(size)
    for columns in range(1, number + 1):
        lines = -(-number // columns)
        up = (PAGE[1] - NAME_ABOVE * lines - GAP * (lines - 1)) / (lines * tall)
        assert found.scale >= min((PAGE[0] / columns - GAP) / wide, up) * (1 - 1e-9)


def test_a_flat_state_takes_a_low_row() -> None:
    """What the last state needs is not taken twice; states of a row keep their heights."""
    flat, swollen = boxes((140, 10), (100, 90))
    mixed = arrange([flat, swollen], np.array([160.0, 300.0]))
    equal = arrange([swollen, swollen], np.array([160.0, 300.0]))
    assert rows_of(mixed.moves) == rows_of(equal.moves) == [1, 1]
    drop = -np.diff(mixed.moves[:, 1])[0]
    assert drop == pytest.approx(0.09 + (NAME_ABOVE + GAP) / mixed.scale)
    one, other = boxes((20, 100), (20, 100))
    row = arrange([one, other + [0.0, 0.03]], PAGE)
    assert row.moves[0, 1] == row.moves[1, 1]
