"""Curves tell what they show beside the lines."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure as Page
from matplotlib.text import Annotation

from toros_fem.measures.figures import Figure
from toros_fem.results.pictures.curves import draw_curve, draw_history, draw_tracks
from toros_fem.results.pictures.style import bar_length, page
from toros_fem.results.runs.stored_run import Measured, PoseFigure, StoredCurve

ROWS = [
    {"pressure_pa": 1e3 * k, "angle_deg": 20.0 * k, "twist_deg": 5.0 * k, "length_ratio": 1 + k / 9}
    for k in range(6)
]
ANGLE = Figure("angle", "deg", 80.0, 3.0, 90.0, 2.7)
TWIST = Figure("twist", "deg", 20.0)
LENGTH = Figure("length", "ratio", 1.4)


def words(figure: Page) -> list[str]:
    return [text.get_text() for axes in figure.axes for text in axes.texts]


def test_figures_of_one_unit_share_axes() -> None:
    """Each line has its name, the target and the value at the design's pressure their words."""
    figure = Page(figsize=(8, 4.5))
    draw_curve(figure, StoredCurve(ROWS, 4e3), [ANGLE, TWIST, LENGTH])
    assert len(figure.axes) == 2
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "angle and twist (°)",
        "length (relative to rest)",
    ]
    told = words(figure)
    assert {"angle", "twist", "target 90°", "80.0 ± 3.0°", "20°", "1.4×"} <= set(told)
    bar = figure.axes[0].containers[0]
    (low, high) = bar[2][0].get_segments()[0][:, 1]
    assert (low, high) == (77.0, 83.0)


def test_curves_without_names_reach_the_border() -> None:
    for figures, right in (([ANGLE], 0.97), ([ANGLE, LENGTH], 0.97), ([ANGLE, TWIST], 0.88)):
        figure = Page(figsize=(8, 4.5))
        draw_curve(figure, StoredCurve(ROWS, 4e3), figures)
        assert figure.axes[0].get_position().x1 == pytest.approx(right)


def test_a_finer_mesh_is_named() -> None:
    for finer in (False, True):
        figure = Page(figsize=(8, 4.5))
        draw_curve(figure, StoredCurve(ROWS, 4e3, finer=finer), [ANGLE, LENGTH])
        below = figure.axes[-1].get_xlabel()
        assert ("finer mesh" in below) is finer
        assert below.startswith("pressure (kPa)")


def test_measured_values_stand_beside_ours() -> None:
    figure = Page(figsize=(8, 4.5))
    measured = [Measured("angle_deg", 3e3, 50.0, 60.0, "paper"),
                Measured("angle_deg", 5e3, 70.0, None, "a bench"),
                Measured("twist_deg", 5e3, 7.0, None, "another")]  # fmt: skip
    draw_curve(figure, StoredCurve(ROWS, 4e3, measured), [ANGLE])
    told = words(figure)
    assert "50° (paper),\n60° ours" in told
    assert "70° (a bench)" in told
    assert not any("another" in word for word in told)


def test_further_poses_stand_at_their_pressures() -> None:
    """Each with its target; those of other figures are left out."""
    figure = Page(figsize=(8, 4.5))
    half = Figure("half_angle", "deg", 44.0, 1.0, 45.0, 3.0)
    curve = StoredCurve(ROWS, 4e3, poses=[
        PoseFigure("angle_deg", 2e3, half), PoseFigure("twist_deg", 2e3, TWIST),
    ])  # fmt: skip
    draw_curve(figure, curve, [ANGLE])
    told = words(figure)
    assert {"target 90°", "target 45°", "44.0 ± 1.0°"} <= set(told)
    assert "20°" not in told


@pytest.mark.parametrize("broken", [(True, False), (False, True), (True, True)])
def test_ends_without_equilibrium(broken: tuple[bool, bool]) -> None:
    """A curve that begins late has none at lower pressures, one that ends early at higher ones."""
    figure = Page(figsize=(8, 4.5))
    draw_curve(figure, StoredCurve(ROWS, broken=broken), [ANGLE])
    told = words(figure)
    assert ("no equilibrium below" in told, "no equilibrium beyond" in told) == broken


def test_units_are_those_of_readers() -> None:
    """A held mass of 0.05 kg is drawn as 50 g."""
    figure = Page(figsize=(8, 4.5))
    rows = [{"pressure_pa": 1e3, "mass_kg": 0.01}, {"pressure_pa": 2e3, "mass_kg": 0.05}]
    draw_curve(figure, StoredCurve(rows, 2e3), [Figure("mass", "kg", 0.05)])
    assert np.asarray(figure.axes[0].lines[0].get_ydata())[-1] == pytest.approx(50.0)


def test_history_marks_the_next_mesh() -> None:
    rows = [
        {"iteration": k, "level": k // 3, "objective": 0.5**k, "angle_deg": 10.0 * k}
        for k in range(6)
    ]
    figure = Page(figsize=(8, 3))
    axes = figure.add_axes((0.1, 0.1, 0.8, 0.8))
    draw_history(axes, rows, ANGLE)
    assert [np.asarray(line.get_xdata())[0] for line in axes.lines[1:]] == [3]
    assert len(figure.axes) == 2
    assert words(figure)[-1] == "target 90°"
    bare = Page(figsize=(8, 3))
    draw_history(bare.add_axes((0.1, 0.1, 0.8, 0.8)), rows, TWIST)
    assert len(bare.axes) == 1


def test_tracks_show_the_stride_to_scale(tmp_path: Path) -> None:
    t = np.linspace(0, 1, 13)
    feet = np.stack(
        [np.stack([0.02 * t + k, 0 * t, 0.005 * np.sin(9 * t)], 1) for k in (0, 0.05)], 1
    )
    with page(tmp_path / "tracks.png") as figure:
        stride = Figure("stride", "mm", 20.0, 1.4)
        draw_tracks(figure, feet, 3, stride, ("measured", 0.015))
        told = words(figure)
        (axes,) = figure.axes
        arrows = [
            text for text in axes.texts if isinstance(text, Annotation) and not text.get_text()
        ]
        ends = [(arrow.xy[0], arrow.xyann[0]) for arrow in arrows]
    assert "simulated: 20.0 ± 1.4 mm" in told
    assert "measured: 15 mm" in told
    assert [a - b for a, b in ends] == pytest.approx([20.0, 15.0])


def test_feet_of_a_mirror_image_have_one_name_and_colour() -> None:
    """Their paths coincide within a numerical error, here across a border of rounded numbers."""
    t = np.linspace(0, 1, 7)
    path = np.stack([0.04445 * t, 0 * t, 0.005 * np.sin(9 * t)], 1)
    feet = np.stack([path, path + [0.1, 0, 0], path - 2e-6], 1)
    figure = Page(figsize=(8, 4.5))
    draw_tracks(figure, feet, 3)
    assert words(figure) == ["feet 0, 2", "foot 1"]
    colours = [line.get_color() for line in figure.axes[0].lines]
    assert colours[:3] == colours[6:]
    assert colours[0] != colours[3]


def test_bars_have_round_lengths() -> None:
    assert [bar_length(span) for span in (100, 150, 340, 12, 0.9)] == [10, 20, 50, 1, 0.1]
