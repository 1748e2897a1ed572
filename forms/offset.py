"""Print on one face of the fabric: coupling of membrane strain and curvature by its offset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from toros_fem.forms.jets import Scalar, total
from toros_fem.forms.kinematics import Strain
from toros_fem.forms.lines import Family, stretch_along


def coupling_energy(e: Strain, Lambda: Sequence[Scalar], mu: Any, lam: Any) -> Any:
    """Return E:B:Λ per flat area in J/m², plane-stress Hooke.

    E = U − 1 is the Biot strain of the fabric's mid-surface; U = (C + p I)/s. At the distance z
    along the normal the strain is E + zΛ, as in eq. (5) with z against the normal.

    Args:
        e: The strain.
        Lambda: Curvature (xx, yy, xy) in 1/m.
        mu, lam: Plane-stress Lamé parameters times thickness and offset, in N.
    """
    xx, yy, xy = Lambda
    E = [(e.C[0] + e.p) / e.s - 1, (e.C[1] + e.p) / e.s - 1, e.C[2] / e.s]
    return lam * e.total * (xx + yy) + 2 * mu * (E[0] * xx + E[1] * yy + 2 * E[2] * xy)


def coupling_of_lines(families: Sequence[Family], e: Strain, Lambda: Sequence[Scalar]) -> Any:
    """Return the same of lines, whose strain is |F d| − 1 + z d·Λ d.

    Args:
        families: Line families, whose `stretching` is times the offset, in N.
        e, Lambda: As for `coupling_energy`.
    """
    xx, yy, xy = Lambda
    return total(
        f.stretching
        * (stretch_along(f, e.C) - 1)
        * ((1 + f.cosine) / 2 * xx + (1 - f.cosine) / 2 * yy + f.sine * xy)
        for f in families
    )
