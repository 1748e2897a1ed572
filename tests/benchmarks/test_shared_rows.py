"""Rows are kept as they finish, and a rerun skips them."""

from pathlib import Path

import pytest
from shared_rows import complete, deadline, read_rows


def test_a_rerun_plays_only_what_is_missing(tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    played: list[int] = []

    def play(number: int) -> dict[str, int]:
        played.append(number)
        return {"square": number**2}

    complete({"1": 1, "2": 2}, play, file)
    with file.open("a", encoding="utf-8") as lines:
        lines.write('{"key": "3", "squ')  # killed while it wrote
    rows = complete({"3": 3, "2": 2}, play, file)
    assert played == [1, 2, 3]
    assert list(rows.items()) == [("3", {"square": 9}), ("2", {"square": 4})]
    assert set(read_rows(file)) == {"1", "2", "3"}


def test_processes_give_the_same_rows(tmp_path: Path) -> None:
    tasks = {"a": -2, "b": 3}
    alone = complete(tasks, magnitude, None)
    assert complete(tasks, magnitude, tmp_path / "rows.jsonl", workers=2) == alone


def magnitude(number: int) -> dict[str, int]:
    return {"magnitude": abs(number)}


def hang() -> None:
    with deadline(0.05):
        while True:
            pass


def test_deadline_ends_a_hang() -> None:
    with pytest.raises(TimeoutError, match="gave up after"):
        hang()
