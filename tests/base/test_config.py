"""Configurations: types, bounds, None, unknown names, derived classes."""

import copy
import json
import pickle
from dataclasses import FrozenInstanceError, dataclass
from typing import Any

import numpy as np
import pytest

from toros_fem.base.config import Config, entries, quantity
from toros_fem.base.errors import ParameterError


@dataclass(frozen=True)
class Sample(Config):
    """Numbers of a sample; SI units."""

    width: float = quantity(0.5, "width of the sample", "m", above=0, at_most=2)
    turn: float = quantity(0.0, "turn of the sample", "deg", at_least=-90, below=90)
    count: int = quantity(3, "number of samples", at_least=1)
    kind: str = quantity("round", "shape of the sample", choices=("round", "square"))
    note: str = quantity("", "free text")
    rigid: bool = quantity(False, "whether the sample is rigid")
    load: float | None = quantity(None, "load; none leaves it out", "N", above=0)
    edge: str | None = quantity("sharp", "shape of the edge", choices=("sharp", "blunt"))


@dataclass(frozen=True)
class LongSample(Sample):
    """Numbers of a long sample."""

    length: float = quantity(4.0, "length of the sample", "m", above=0)
    count: int = Sample.redefault("count", 7)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 0.0}, "width = 0.0 m must be a finite number, above 0 and at most 2"),
        ({"width": 2.1}, "width = 2.1 m must be a finite number, above 0 and at most 2"),
        ({"width": float("inf")}, "width = inf m must be a finite number"),
        ({"width": float("nan")}, "width = nan m must be a finite number"),
        ({"width": "wide"}, "width = 'wide' must be a number."),
        ({"width": None}, "width = None must be a number."),
        ({"width": True}, "width = True must be a number."),
        ({"turn": 90.0}, "turn = 90.0 deg must be a finite number, at least -90 and below 90"),
        ({"turn": -90.1}, "turn = -90.1 deg"),
        ({"count": 0}, "count = 0 must be a finite number, at least 1"),
        ({"count": 2.0}, "count = 2.0 must be a whole number."),
        ({"count": True}, "count = True must be a whole number."),
        ({"kind": "oval"}, "kind = 'oval' must be one of 'round', 'square'"),
        ({"kind": 3}, "kind = 3 must be a word."),
        ({"kind": None}, "kind = None must be a word."),
        ({"rigid": 1}, "rigid = 1 must be True or False."),
        ({"load": 0.0}, "load = 0.0 N must be a finite number, above 0"),
        ({"load": "none"}, "load = 'none' must be a number, or None."),
        ({"edge": "bent"}, "edge = 'bent' must be one of"),
    ],
)
def test_bad_values(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        Sample(**changes)
    with pytest.raises(ParameterError, match=message):
        Sample().updated(**changes)


def test_values_at_the_bounds_are_allowed() -> None:
    found = Sample(width=2.0, turn=-90.0, count=1, load=1e-9, edge=None)
    assert (found.width, found.turn, found.count, found.load) == (2.0, -90.0, 1, 1e-9)
    assert found.edge is None


def test_unknown_names_are_answered_by_the_nearest() -> None:
    with pytest.raises(ParameterError, match="unknown parameter 'widht'; did you mean 'width'?"):
        Sample().updated(widht=1.0)
    with pytest.raises(ParameterError, match="unknown parameter 'lenght'; did you mean 'length'?"):
        LongSample(lenght=1.0)  # type: ignore[call-arg]
    with pytest.raises(ParameterError, match="unknown parameter 'zzz'; known are width, turn, "):
        Sample(zzz=1.0)  # type: ignore[call-arg]


def test_numbers_become_plain_ones() -> None:
    """A whole number for a float, and numpy's numbers, are stored as Python's own."""
    found = Sample(width=1, count=np.int64(4), turn=np.float32(0.5))  # type: ignore[arg-type]
    assert [type(v) for v in (found.width, found.count, found.turn)] == [float, int, float]
    assert json.loads(json.dumps(found.as_dict())) == found.as_dict()
    assert found.as_dict() == {
        "width": 1.0, "turn": 0.5, "count": 4, "kind": "round", "note": "", "rigid": False,
        "load": None, "edge": "sharp",
    }  # fmt: skip


def test_derived_classes_take_over_meaning_and_bounds() -> None:
    found = LongSample()
    assert (found.count, found.length, found.width) == (7, 4.0, 0.5)
    assert LongSample.quantity("count") == Sample.quantity("count")
    with pytest.raises(ParameterError, match="count = 0"):
        LongSample(count=0)
    assert list(LongSample.kinds()) == [*Sample.kinds(), "length"]
    assert LongSample.kinds()["load"] == (float, True)
    assert LongSample.kinds()["rigid"] == (bool, False)


def test_configurations_are_values() -> None:
    found = Sample(width=1.0)
    assert pickle.loads(pickle.dumps(found)) == copy.copy(found) == found
    assert found.updated() == found != found.updated(count=9)
    assert found.width == 1.0
    with pytest.raises(FrozenInstanceError):
        found.width = 2.0  # type: ignore[misc]


def test_bounds_in_words() -> None:
    assert Sample.quantity("width").bounds == "above 0 and at most 2"
    assert Sample.quantity("turn").bounds == "at least -90 and below 90"
    assert Sample.quantity("kind").bounds == "one of round, square"
    assert Sample.quantity("note").bounds == ""


def test_a_class_with_another_type_is_refused() -> None:
    @dataclass(frozen=True)
    class Wrong(Config):
        sizes: tuple[float, ...] = quantity((1.0,), "sizes", "m")

    @dataclass(frozen=True)
    class Bare(Config):
        size: float = 1.0

    for kind in (Wrong, Bare):
        with pytest.raises(TypeError, match=r"size.* must be a float, int, bool or str"):
            kind()


@dataclass(frozen=True)
class Part(Config):
    """A part of a set."""

    size: float = quantity(1.0, "size of the part", "m", above=0)


@dataclass(frozen=True)
class Parts(Config):
    """A set of parts."""

    count: int = quantity(3, "number of samples", at_least=1)
    parts: tuple[Part, ...] = entries(Part, "A part")


def test_fields_that_hold_other_configurations() -> None:
    """They are no options, and come back from what summaries hold."""
    assert list(Parts.kinds()) == ["count"]
    assert Parts.entries() == {"parts": (Part, "A part")}

    def made(*parts: Any) -> Parts:
        return Parts(parts=parts)

    no_list: Any = 3
    both = Parts(parts=(Part(size=2.0), Part()))
    assert Parts(**json.loads(json.dumps(both.as_dict()))) == both
    assert made(Part(size=2.0), {"size": 1.0}) == both
    assert pickle.loads(pickle.dumps(both)) == both
    assert hash(both) == hash(copy.deepcopy(both))
    with pytest.raises(ParameterError, match="size = -1.0 m must be a finite number, above 0"):
        made({"size": -1.0})
    with pytest.raises(ParameterError, match="unknown parameter 'sise'; did you mean 'size'"):
        made({"sise": 1.0})
    with pytest.raises(ParameterError, match="parts = 3 must be a list of Part"):
        Parts(parts=no_list)
    with pytest.raises(ParameterError, match=r"parts has Sample\(.* in it; it must be a Part"):
        made(Sample())
