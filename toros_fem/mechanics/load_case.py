"""What acts on a skin: pressures, dead forces, weight and moved supports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem._types import Floats


@dataclass(frozen=True, eq=False)
class LoadCase:
    """What acts on a skin.

    Attributes:
        pressure: In Pa, of all chambers or of each, (k,).
        force: Dead forces in N on all assembled vertices, (n, 3); None for none.
        displacement: Way in m of held components of all assembled vertices, (n, 3); None for none.
        weight: Share of the skin's own weight.
    """

    pressure: float | Floats
    force: Floats | None
    displacement: Floats | None = None
    weight: float = 0.0

    def __bool__(self) -> bool:
        dead = self.force is not None or self.weight > 0
        return self.largest > 0 or dead or self.displacement is not None

    def __str__(self) -> str:
        parts = []
        if self.largest > 0 or not self:
            parts.append(" and ".join(f"{p:g}" for p in np.atleast_1d(self.pressure)) + " Pa")
        if self.force is not None:
            total = np.linalg.norm(self.force, axis=1).sum()
            parts.append(f"forces of {total:.4g} N in all")
        if self.weight > 0:
            share = "" if self.weight == 1 else f"{100 * self.weight:.3g} % of "
            parts.append(f"{share}its own weight")
        if self.displacement is not None:
            way = np.linalg.norm(self.displacement, axis=1).max()
            parts.append(f"supports moved by up to {way:.4g} m")
        return " and ".join(parts)

    @property
    def largest(self) -> float:
        """Largest pressure in Pa."""
        return float(np.max(self.pressure))

    def scaled(self, factor: float) -> LoadCase:
        """Return the load times a load factor."""
        return LoadCase(0.0, None).towards(self, factor)

    def towards(self, other: LoadCase, share: float) -> LoadCase:
        """What lies between, share of the way to another."""
        return LoadCase(
            self.pressure + share * (other.pressure - self.pressure),
            _between(self.force, other.force, share),
            _between(self.displacement, other.displacement, share),
            self.weight + share * (other.weight - self.weight),
        )


def _between(one: Floats | None, other: Floats | None, share: float) -> Floats | None:
    """Share of the way from one to the other, None standing for zero."""
    if one is None and other is None:
        return None
    begin, end = (np.zeros(1) if values is None else values for values in (one, other))
    return np.asarray(begin + share * (end - begin))
