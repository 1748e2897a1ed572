"""Scenes, and TOML files."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Count, Length, Table, key
from toros_fem.base.scene import Scene, key_lines, line_of

TEXT = '''# a comment with [brackets]
kind = "bend" # [not a table]
text = """
[no table]
key = 1 \\""" still
"""
other = ['[', "]", # ]
  "a = 3",
]
a.b . c = 1

[design]  # a table
"quoted key" = 'it''s'
seed = 3
multi = \'\'\'
[x]
\'\'\'
[[held]]
where = "z < 5 mm"
[[ held ]]
where = "a"
inline = { x = 1, y = "}" }
last = 1
'''.replace("'it''s'", "'its'")


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


def test_places() -> None:
    tomllib.loads(TEXT)  # the text is valid
    lines = key_lines(TEXT)
    assert lines == {
        ("kind",): 2,
        ("text",): 3,
        ("other",): 7,
        ("a",): 10,
        ("a", "b"): 10,
        ("a", "b", "c"): 10,
        ("design",): 12,
        ("design", "quoted key"): 13,
        ("design", "seed"): 14,
        ("design", "multi"): 15,
        ("held", 0): 18,
        ("held", 0, "where"): 19,
        ("held", 1): 20,
        ("held", 1, "where"): 21,
        ("held", 1, "inline"): 22,
        ("held", 1, "last"): 23,
    }


def test_a_place_without_a_line_has_that_around_it() -> None:
    lines = key_lines(TEXT)
    assert line_of(lines, ("held", 1, "inline", "x")) == 22
    assert line_of(lines, ("design", "nothing")) == 12
    assert line_of(lines, ("nothing",)) is None
