"""Configuration of the start: options of the relaxed design and of its lines."""

from toros_fem.design.lines.field import LineOptions
from toros_fem.design.relaxed.find import RelaxedOptions
from toros_fem.products.actuators.scene import ActuatorScene


def test_defaults_are_those_of_the_options() -> None:
    config = ActuatorScene()
    assert config.relaxed_options == RelaxedOptions(share_weight=0.01)
    lines, plain = config.line_options, LineOptions()
    assert lines == LineOptions(widths=(*plain.widths, *plain.widths))


def test_numbers_reach_the_options() -> None:
    config = ActuatorScene.of(
        relaxed_iterations=7, directions=24, share_limit=0.5, smoothing_radius=5e-3,
        laid_width=4e-3, second_laid_width=0.8e-3, print_width=0.5e-3,
    )  # fmt: skip
    found = config.relaxed_options
    assert (found.iterations, found.directions, found.share_limit) == ((7, 7), 24, 0.5)
    assert found.radius == 5e-3
    assert found.width_ratio == 0.2
    assert config.line_options == LineOptions(widths=(4e-3, 0.8e-3), print_width=0.5e-3)
    assert config.updated(second_laid_width=None).line_options.widths == (4e-3, 4e-3)
