"""Options of tolerances and of fits: command lines tell them without loading what solves."""

from __future__ import annotations

from typing import Annotated

from toros_fem.base.keys import In, Number, OneOf, Stretch, Table, key

# Branches of the load cycles of a test, and losses of residuals with scipy's names.
BRANCHES = ("last-loading", "first-loading", "last-unloading", "all")
LOSSES = {"soft-l1": "soft_l1", "huber": "huber", "squares": "linear"}
# What extension without force is, and force without extension.
STARTS = ("auto", "slack", "set", "none")
OFFSETS = ("ask", "preload", "untared")


class FitOptions(Table):
    """How a material is fitted to tensile tests."""

    branch: Annotated[str, OneOf(BRANCHES)] = key(
        "last-loading", "branch of the load cycles that is fitted"
    )
    start: Annotated[str, OneOf(STARTS)] = key(
        "auto",
        "what extension before the force rises is: slack of the strip, or the set of the fabric, "
        "by which the gauge length grows; auto takes slack in a first loading, set in a later one",
    )
    offset: Annotated[str, OneOf(OFFSETS)] = key(
        "ask", "what a force at a strain of 0 is: a preload, or that of an untared cell"
    )
    up_to: Stretch | None = key(None, "largest stretch that is fitted; none takes all")
    loss: Annotated[str, OneOf(tuple(LOSSES))] = key(
        "soft-l1", "loss of the residuals; the first two bound what an outlier counts"
    )
    draws: Annotated[int, In(at_least=40, at_most=100000)] = key(
        400, "times that the tests are drawn again, for the 95 % intervals"
    )
    seed: Number = key(0, "seed of these draws")
    points: Annotated[int, In(at_least=10, at_most=10000)] = key(
        60, "points that each curve is averaged to, even over the stretch"
    )


class ToleranceConfig(Table):
    """Tolerances of printer, material and pressure; SI units."""

    width: Annotated[float, In("m", above=0, at_most=0.01)] | None = key(
        1e-4,
        "width by which lines are off; each border by half of it, and twice as much is simulated "
        "too; none leaves it out",
    )
    modulus: Annotated[float, In(above=0, at_most=0.9)] | None = key(
        0.2, "fraction by which moduli are off; none leaves them out"
    )
    thickness: Annotated[float, In(above=0, at_most=0.9)] | None = key(
        0.2, "fraction by which thicknesses are off; none leaves them out"
    )
    pressure_change: Annotated[float, In(above=0, at_most=0.9)] | None = key(
        0.05, "fraction by which the pressure is off; none leaves it out"
    )
