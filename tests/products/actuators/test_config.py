"""Configuration of an actuator: what is left out by None, and what follows from the numbers."""

import math
from typing import Annotated, ClassVar

import numpy as np
import pytest

from toros_fem import errors
from toros_fem.base.keys import In, Table, key
from toros_fem.design.density.length_scale import LengthScale
from toros_fem.design.lines.field import LineOptions
from toros_fem.design.relaxed.find import RelaxedOptions
from toros_fem.materials.sheet import Bending, Bladder, Composite, Knit, Material
from toros_fem.mechanics.readings.bare_tube import tube_pressure
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.common.tables import Sheets
from toros_fem.products.tubes import BendScene, TubeScene


def test_composite() -> None:
    plain = ActuatorScene().material.composite
    assert plain.bending == Bending()
    assert plain.bladder is None
    assert ActuatorScene.of(bending=None).material.composite.bending is None
    hinged = ActuatorScene.of(bending="average", seams="hinged").material.composite
    assert hinged.bending == Bending("average", "hinged")
    lined = ActuatorScene.of(bladder_thickness=2e-4, bladder_young=1e5).material.composite
    assert lined.bladder == Bladder(1e5, 2e-4)
    assert plain.knit is None
    assert ActuatorScene.of(grain_angle=30.0).material.composite.knit is None
    knitted = ActuatorScene.of(knit_ratio=3.0, grain_angle=90.0).material.composite
    assert knitted.knit == Knit(3.0, math.pi / 2)
    assert ActuatorScene.of(fabric_young=3e5).material.composite.fabric.young == 3e5


def test_materials_of_the_numbers() -> None:
    found = Sheets(
        fabric_young=2e5,
        reinforcement_young=3e7,
        poisson=0.4,
        thickness=1e-3,
        c1=2.0,
        c2=3.0,
        reinforcement_thickness=None,
    ).composite
    assert found == Composite(
        Material(2e5, 0.4, 1e-3), Material(3e7, 0.4, 1e-3), c1=2.0, c2=3.0, bending=None
    )
    assert Sheets().composite == Composite(bending=None)


def test_options_of_the_relaxed_design_and_its_lines() -> None:
    config, plain = ActuatorScene(), LineOptions()
    assert config.relaxed_options == RelaxedOptions(share_weight=0.01)
    assert config.line_options == LineOptions(widths=(*plain.widths, *plain.widths))
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


def test_designed_pressures() -> None:
    """From where a bare tube has 1.3 times the strain of the target, at least 1.1 times."""
    assert ActuatorScene.of(pressure=9e3).pressures == (9e3, (900.0, 9e3)), "of no known strain"
    assert ActuatorScene.of(pressure=9e3, hold_pressure=True).pressures == (9e3, None)
    scene, sheet = BendScene.of(angle=60.0, pressure=8e3), Composite()
    strain = np.radians(60) * 0.02 / 0.15
    assert scene.needed_strain == pytest.approx(strain, rel=1e-12)
    start, least = (tube_pressure(sheet, 0.01, k * strain) for k in (1.3, 1.1))
    assert scene.pressures[0] == pytest.approx(start, rel=1e-12)
    assert scene.pressures[1] == pytest.approx((least, 8e3), rel=1e-12)
    assert scene.updated(pressure=30e3).pressures[0] == pytest.approx(start, rel=1e-12)
    assert scene.updated(pressure=1e3).pressures == (1e3, (900.0, 1e3)), "less than it needs"


class FromMore(BendScene):
    START_STRAIN: ClassVar = 1.9


@pytest.mark.parametrize(
    ("angle", "factor"), [(60.0, 1.9), (120.0, 0.4 / np.radians(16)), (150.0, 1.3)]
)
def test_a_start_from_more_pressure_is_bounded_by_its_strain(angle: float, factor: float) -> None:
    scene, sheet = FromMore.of(angle=angle, pressure=30e3), Composite()
    start = tube_pressure(sheet, 0.01, factor * np.radians(angle) * 0.02 / 0.15)
    assert scene.pressures[0] == pytest.approx(start, rel=1e-9)


class TiltedTarget(Table):
    """A target."""

    angle: Annotated[float, In("deg", above=0)] = key(30.0, "an angle", metric="angle")
    share: Annotated[float, In("%", below=100)] = key(5.0, "a part", metric="share")


class Tilted(TubeScene):
    target: TiltedTarget = TiltedTarget()


def test_other_targets() -> None:
    assert Tilted.of(seed=5).asked({"angle_deg": 36.0}) == Tilted.of(seed=5, angle=36.0)
    assert Tilted().asked({}) == Tilted()
    assert Tilted().targets() == {"angle_deg": "angle", "share_percent": "share"}
    with pytest.raises(errors.ParameterError, match="angle = -1.0 deg"):
        Tilted().asked({"angle_deg": -1.0})


def test_options_and_widths() -> None:
    both = ActuatorScene.of(iterations=7, constrained_iterations=5, move_limit=0.1, line_width=1e-3)
    (options,) = both.options
    assert [(s.iterations, s.constrained) for s in options.stages] == [(7, False), (5, True)]
    assert options.mma.move == 0.1
    assert both.design.length_scale == LengthScale(line_width=1e-3)
    free = both.updated(constrained_iterations=0)
    assert [s.iterations for s in free.options[0].stages] == [7]
    assert free.design.length_scale is None
    limits = ActuatorScene.of(print_width=0.4e-3).print.limits
    assert (limits.width, limits.gap) == (0.4e-3, 0.4e-3)


def test_levels_of_a_tube() -> None:
    config = TubeScene.of(
        edge_length=1.4e-3, filter_radius=2e-3, line_width=1e-3, iterations=9, level_iterations=3,
        level_move_limit=0.05,
    )  # fmt: skip
    assert config.level_count == 2, "with three there would be fewer than eighteen edges around"
    lengths = [
        (x.edge_length, x.regularisation.filter_radius, x.regularisation.length_scale.line_width)
        for x in config.levels
    ]
    assert lengths == [(2.8e-3, 4e-3, 2e-3), (1.4e-3, 2e-3, 1e-3)]
    assert config.levels[1].regularisation.length_scale.gap_width is None
    assert config.levels[1] == config.finest_level
    coarse, *finer = config.updated(levels=2).options
    assert coarse.iterations == 9 + config.design.constrained_iterations
    (fine,) = finer
    assert [(s.iterations, s.constrained) for s in fine.stages] == [(3, True)]
    assert fine.mma.move == 0.05
    (free,) = config.updated(levels=2, constrained_iterations=0).options[1:]
    assert not free.stages[0].constrained


def test_too_many_levels() -> None:
    with pytest.raises(errors.ParameterError, match="levels = 3 is too many: edges of more than"):
        TubeScene.of(edge_length=1.4e-3, levels=3)
    with pytest.raises(errors.ParameterError, match="levels = 2 is too many: the mesh is given"):
        ActuatorScene.of(levels=2)
    assert ActuatorScene().level_count == 1
    assert TubeScene.of(edge_length=8e-3).level_count == 1
