"""Scenes: tables by name, keys by theirs."""

from typing import Any

import pytest

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Count, Length, Table, key
from toros_fem.base.scene import Scene


class Skin(Table):
    """Sizes."""

    length: Length = key(1.0, "length")
    cuts: Count = key(2, "cuts")


class Steps(Table):
    """Steps."""

    seed: Count = key(3, "seed")


class Sample(Scene):
    """A sample."""

    skin: Skin = Skin(cuts=5)
    design: Steps = Steps()
    held: tuple[Skin, ...] = ()


def test_updated_takes_keys_and_tables() -> None:
    found = Sample().updated(skin=Skin(length=7.0), cuts=4, seed=9, held=[{"length": 2.0}])
    assert found == Sample(Skin(7.0, 4), Steps(9), (Skin(2.0),))
    assert Sample.of(length=2.0) == Sample(Skin(2.0, 5))
    assert found.as_dict() == {
        "length": 7.0, "cuts": 4, "seed": 9, "held": [{"length": 2.0, "cuts": 2}],
    }  # fmt: skip
    assert (found.value("seed"), Sample.table_of("cuts")) == (9, "skin")


def test_what_is_refused() -> None:
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"lenght": 1.0}, "unknown parameter 'lenght'; did you mean 'length'"),
        ({"skin": 3}, "unknown parameter 'skin'"),
        ({"held": 3}, "held = 3 must be a list"),
        ({"held": [Steps()]}, r"held = Steps\(seed=3\) must be a Skin"),
    ]
    for changes, message in wrong:
        with pytest.raises(ParameterError, match=message):
            Sample().updated(**changes)
    with pytest.raises(ParameterError, match=r"design = Skin\(.* must be a Steps"):
        Sample(design=Skin())  # type: ignore[arg-type]

    class Twice(Scene):
        skin: Skin = Skin()
        print: Skin = Skin()

    with pytest.raises(TypeError, match="has a key in two tables"):
        Twice.described()
