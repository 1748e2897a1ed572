"""Keys of targets: an angle, a twist and a shortening, each in the unit of its metric."""

from __future__ import annotations

from typing import Annotated, Any

from toros_fem.base.keys import In, key

BendAngle = Annotated[float, In("deg", at_least=-720, at_most=720)]
TwistAngle = Annotated[float, In("deg", at_least=-2160, at_most=2160)]
Shortening = Annotated[float, In("%", below=100)]


def bend_key(default: float | None) -> Any:
    """Return the key of a bend angle."""
    return key(default, "bend angle of the target", metric="angle")


def twist_key(default: float | None) -> Any:
    """Return the key of a twist."""
    meaning = "twist of the target, positive if counter-clockwise seen from the tip"
    return key(default, meaning, metric="twist")


def shortening_key(default: float | None) -> Any:
    """Return the key of a shortening."""
    return key(default, "shortening of the target", metric="shortening")
