"""The numbers of a design that do not depend on what is designed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from toros_fem._types import Floats
from toros_fem._validate import require_between, require_count, require_positive
from toros_fem.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.density.perimeter import Perimeter
from toros_fem.design.problem import DesignProblem
from toros_fem.errors import ParameterError
from toros_fem.materials import Composite, Material


@dataclass(frozen=True)
class DesignConfig:
    """Materials, filter, penalties and loop; SI units.

    Attributes:
        fabric_young, reinforcement_young: Young's moduli in Pa.
        poisson, thickness: Of both sheets; the thickness in m.
        c1, c2: Stretch bounds.
        filter: "cone" or "helmholtz".
        radius: R of the filter in m.
        beta, eta: Of the projection.
        line, gap: Widths in m that the constraints ask for; 0 takes R.
        perimeter: Weight of the perimeter term; 0 leaves it out.
        window, sharpness: Its window's radius over R, and w.
        move: MMA's move limit.
        iterations: Steps before the width constraints are switched on.
        constrained: Steps with them; 0 leaves them out.
        island_area: Free islands smaller than this, in m², are not printed.
        print_width: Thinnest line and gap in m that the printer makes: below, they are marked.
        seed: Of the random start.
    """

    fabric_young: float = 0.1e6
    reinforcement_young: float = 26e6
    poisson: float = 0.3
    thickness: float = 0.5e-3
    c1: float = 1.9
    c2: float = 2.6
    filter: str = "cone"
    radius: float = 2.15e-3
    beta: float = 20.0
    eta: float = 0.5
    line: float = 0.0
    gap: float = 0.0
    perimeter: float = 0.0
    window: float = 1.0
    sharpness: float = 0.5
    move: float = 0.2
    iterations: int = 60
    constrained: int = 40
    island_area: float = 20e-6
    print_width: float = 0.6e-3
    seed: int = 2

    def __post_init__(self) -> None:
        require_count(1, iterations=self.iterations)
        require_count(0, constrained=self.constrained, seed=self.seed)
        require_positive(print_width=self.print_width, window=self.window)
        require_between(0.0, np.inf, line=self.line, gap=self.gap, perimeter=self.perimeter)
        require_between(0.0, np.inf, island_area=self.island_area)

    @property
    def composite(self) -> Composite:
        """Fabric and reinforcement, which do not bend."""
        sheet = {"poisson": self.poisson, "thickness": self.thickness}
        return Composite(
            fabric=Material(young=self.fabric_young, **sheet),
            reinforcement=Material(young=self.reinforcement_young, **sheet),
            c1=self.c1,
            c2=self.c2,
            bending=None,
        )

    def penalise(self, problem: DesignProblem[Any], lattice: Floats | None = None) -> None:
        """Give a problem the perimeter term and the width constraints asked for (collective).

        Args:
            problem: The problem, its filter and projection made.
            lattice: The two vectors, (2, 2), in m, by which a tile repeats.
        """
        skin = problem.skin
        if self.perimeter > 0:
            problem.perimeter = Perimeter(
                skin,
                self.window * self.radius,
                self.sharpness,
                lattice=lattice,
                whole=problem.whole,
            )
        if self.constrained > 0:
            problem.length_scale = LengthScaleConstraints(
                skin,
                problem.filter,
                LengthScale(line=self.line or None, gap=self.gap or None),
                problem.designed,
                problem.projection,
            )


def known_inputs(
    settings: DesignConfig | None, defaults: dict[str, Any], inputs: dict[str, Any]
) -> dict[str, Any]:
    """Settings and defaults, with what differs from them put in.

    Raises:
        ParameterError: An input is none of them.
    """
    known = {**({} if settings is None else asdict(settings)), **defaults}
    unknown = sorted(set(inputs) - set(known))
    if unknown:
        raise ParameterError(f"{unknown[0]!r} is no parameter; there are {', '.join(known)}.")
    return {**known, **inputs}
