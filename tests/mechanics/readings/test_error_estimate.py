"""Half-widths of intervals, from what coarser meshes tell."""

import numpy as np
import pytest

from toros_fem.mechanics.readings.error_estimate import EDGE, edge_of, half_width


def test_coarser_meshes_tell_the_error() -> None:
    """Each as if the error grew with the edge length; the largest counts."""
    changes = {1.5: 0.2, 2.25: 0.75}
    extents = (0.05, 0.1, 0.05)
    least = half_width({1.5: 0.0}, "angle_deg", extents, EDGE)
    assert half_width(changes, "angle_deg", extents, EDGE) == pytest.approx(0.65 * 0.6 + least)
    both = half_width({1.5: 0.4, 2.25: 0.4}, "angle_deg", extents, EDGE)
    assert both == pytest.approx(0.65 * 0.8 + least)
    assert least == 0.5


def test_what_no_mesh_tells_is_a_part_of_the_size() -> None:
    """Of lengths, in their unit; of a force nothing is known."""
    nothing, extents = {1.5: 0.0}, (0.1, 0.02, 0.02)
    assert half_width(nothing, "gap_mm", extents, EDGE) == pytest.approx(0.6)
    assert half_width(nothing, "length_m", extents, EDGE) == pytest.approx(0.6e-3)
    assert half_width(nothing, "length_ratio", extents, EDGE) == pytest.approx(0.45e-2)
    assert half_width(nothing, "force_n", extents, EDGE) == 0.0
    # Turns add up along a slender skin.
    slender = half_width(nothing, "angle_deg", extents, EDGE)
    assert slender == pytest.approx(0.5 * (5 / 2.1) ** 0.5)
    assert half_width(nothing, "angle_deg", (0.1, 0.1, 0.0), EDGE) == 0.5


def test_finer_meshes_leave_less_unseen() -> None:
    """It falls with the edge length from that of the study's meshes on."""
    of = [half_width({1.5: 0.0}, "angle_deg", (0.1, 0.1, 0.0), k * EDGE) for k in (2, 1, 0.5)]
    assert of == pytest.approx([0.5, 0.5, 0.25])
    assert edge_of(np.full(3, np.sqrt(3) / 4 * 9.0)) == pytest.approx(3.0)
