"""Materials are checked on construction, and keep their values as floats."""

from dataclasses import replace

import pytest

from toros_fem import errors
from toros_fem.materials.sheet import Bending, Bladder, Composite, Knit, Material, Membrane


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"c1": 1.0}, "c1 = 1.0"),
        ({"c2": 0.5}, "c2 = 0.5"),
        ({"c1": float("inf")}, "c1 = inf"),
    ],
)
def test_bad_bounds(changes: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Composite(**changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "changes",
    [
        {"young": -1.0},
        {"young": float("nan")},
        {"poisson": 0.6},
        {"thickness": 0.0},
        {"c1": 1.0},
        {"c2": "2"},
    ],
)
def test_bad_material(changes: dict[str, float]) -> None:
    name = next(iter(changes))
    good = {"young": 1e5, "poisson": 0.3, "thickness": 5e-4}
    with pytest.raises(ValueError, match=f"{name} = "):
        Material(**{**good, **changes})


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.5])
def test_lame_parameters(poisson: float) -> None:
    """They are those of plane stress, and lead back to the moduli."""
    made = Material(2.6e7, poisson, 4e-4)
    back = Material.from_lame(made.mu, made.lam, made.thickness)
    assert back.young == pytest.approx(made.young, rel=1e-14)
    assert back.poisson == pytest.approx(poisson, rel=1e-14)
    if poisson < 0.5:  # from three dimensions
        solid = made.young * poisson / ((1 + poisson) * (1 - 2 * poisson))
        assert made.lam == pytest.approx(2 * made.mu * solid / (solid + 2 * made.mu), rel=1e-14)


@pytest.mark.parametrize(("mu", "lam", "name"), [(0.0, 1.0, "mu"), (1.0, 2.1, "lam")])
def test_bad_lame_parameters(mu: float, lam: float, name: str) -> None:
    with pytest.raises(errors.ParameterError, match=f"{name} = "):
        Material.from_lame(mu, lam, 1e-3)


def test_bad_bending_and_bladder() -> None:
    for wrong in ({"curvature": "cubic"}, {"seams": "glued"}, {"rest": "round"}):
        with pytest.raises(errors.ParameterError, match=next(iter(wrong.values()))):
            Bending(**wrong)
    with pytest.raises(errors.ParameterError, match="bending = False must be a Bending"):
        Composite(bending=False)  # type: ignore[arg-type]
    with pytest.raises(errors.ParameterError, match="thickness = 0"):
        Bladder(1e5, 0.0)
    with pytest.raises(errors.ParameterError, match="must be a Bladder"):
        Composite(bladder=1e5)  # type: ignore[arg-type]


def test_bad_knit() -> None:
    with pytest.raises(
        errors.ParameterError, match="ratio = 0.5 must be a finite number, at least 1"
    ):
        Knit(0.5)
    with pytest.raises(errors.ParameterError, match="grain of all panels = inf must be a finite"):
        Knit(3.0, float("inf"))
    with pytest.raises(errors.ParameterError, match="grain of wall = nan must be a finite angle"):
        Knit(3.0, {"base": 0.0, "wall": float("nan")})
    with pytest.raises(errors.ParameterError, match=r"knit = 3\.0 must be a Knit"):
        Composite(knit=3.0)  # type: ignore[arg-type]


def test_bounds_of_each_material() -> None:
    """A material without bounds of its own takes those of the composite."""
    fabric, printed = Material(1e5, 0.3, 5e-4, c1=1.5), Material(1e7, 0.3, 5e-4, c2=2)
    made = Composite(fabric, printed, c1=1.9, c2=2.6)
    assert made.fabric_bounds == (1.5, 2.6)
    assert made.reinforcement_bounds == (1.9, 2.0)
    assert made.widest_bounds == (1.9, 2.6)
    assert not made.shares_bounds
    assert made.stated_bounds == "c1 = 1.5, c2 = 2.6 of the fabric, c1 = 1.9, c2 = 2 of the print"
    both = Composite(replace(fabric, c1=1.5, c2=2.0), replace(printed, c1=1.5))
    assert both.shares_bounds
    assert both.stated_bounds == "c1 = 1.5, c2 = 2"
    narrow = replace(printed, c1=1.2, c2=1.1)
    with pytest.raises(errors.ParameterError, match="c2 = 1.1 must be at least c1 = 1.2"):
        Composite(fabric, narrow, membrane=Membrane("tension-field"))
