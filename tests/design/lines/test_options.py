from toros_fem.design.lines.field import LineOptions


def test_one_width_counts_for_all_families() -> None:
    assert LineOptions(widths=[1e-3]).width_of(1, 2) == 1e-3
    assert LineOptions(widths=(4e-3, 1e-3)).width_of(1, 2) == 1e-3
