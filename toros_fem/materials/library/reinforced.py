"""Reinforced sheet of a fabric and a printed layer: one sheet that is as stiff as both."""

from __future__ import annotations

import math
from dataclasses import replace

from toros_fem.materials.sheet import Material


def reinforced(fabric: Material, layer: Material) -> Material:
    """Return one sheet that stretches and bends as a fabric with a layer bonded to it.

    Lamé parameters times thickness add, those of plane stress. The thickness is the one with
    which the sheet is as stiff in bending as the laminate about its neutral plane: h = √(12 D/A)
    with A = Σ Aᵢ, Aᵢ = Eᵢ hᵢ/(1−νᵢ²) and D = Σ Aᵢ hᵢ²/12 + A₁A₂/A · (h₁ + h₂)²/4, the layers
    lying on each other. With equal Poisson's ratios this is classical laminate theory, exactly;
    otherwise Poisson's ratio in bending is that in stretching. Each bound on the stretches is the
    tighter one of both. `layer` is the printed layer alone.
    """
    first, second = _stiffnesses(fabric, layer)
    both = first + second
    bending = (
        first * fabric.thickness**2 / 12
        + second * layer.thickness**2 / 12
        + first * second / both * (fabric.thickness + layer.thickness) ** 2 / 4
    )
    thickness = math.sqrt(12 * bending / both)
    mu, lam = (
        sum(getattr(m, name) * m.thickness for m in (fabric, layer)) / thickness
        for name in ("mu", "lam")
    )
    sheet = Material.from_lame(mu, min(lam, 2 * mu), thickness)
    return replace(sheet, c1=_tighter(fabric.c1, layer.c1), c2=_tighter(fabric.c2, layer.c2))


def print_offset(fabric: Material, layer: Material) -> float:
    """Return the distance in m from the fabric's middle to the neutral plane of `reinforced`.

    It is A₂/(A₁ + A₂) · (h₁ + h₂)/2, the `print_offset` of a `Composite` whose print has a side.
    """
    first, second = _stiffnesses(fabric, layer)
    return second / (first + second) * (fabric.thickness + layer.thickness) / 2


def _stiffnesses(*layers: Material) -> tuple[float, ...]:
    """Return A = E h/(1−ν²) in N/m of each layer."""
    return tuple(m.young * m.thickness / (1 - m.poisson**2) for m in layers)


def _tighter(*bounds: float | None) -> float | None:
    """Return the smallest of the bounds that there are."""
    return min((bound for bound in bounds if bound is not None), default=None)
