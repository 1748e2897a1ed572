"""Lines of keys in TOML files."""

import tomllib

from toros_fem.base.toml_file import key_lines, line_of

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
