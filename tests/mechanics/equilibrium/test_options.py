"""Options of the equilibrium solver are checked on construction."""

import pytest

from toros_fem.base.errors import ParameterError
from toros_fem.mechanics.equilibrium.options import NewtonOptions


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("tolerance", 0.0),
        ("tolerance", 0.1),
        ("max_steps", 1.5),
        ("max_steps", 0),
        ("fraction_to_barrier", 1.0),
        ("min_increment", -1.0),
        ("min_increment", float("nan")),
    ],
)
def test_bad_options(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=f"{name} = "):
        NewtonOptions(**{name: value})  # type: ignore[arg-type]
