"""A scene that is designed, and who follows its steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mpi4py import MPI

from toros_fem.design.loop.case import Case
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.loop import Callback
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed.as_printed import PrintedDesign
from toros_fem.products.actuators.trim import trimmed

if TYPE_CHECKING:  # a scene is designed by what imports this
    from toros_fem.products.actuators.scene import DesignScene, Level


@dataclass(frozen=True, eq=False)
class Job:
    """A scene that is designed, and who follows its steps.

    Attributes:
        reporter: Called after each step of the design, on every rank; None reports nothing.
        journal: Keeps the state of the run; None keeps nothing.
        verbose: Whether to print every Newton step.
    """

    comm: MPI.Comm
    scene: DesignScene
    reporter: Callback | None = None
    journal: Journal | None = None
    verbose: bool = False

    def branch(self, name: str) -> Journal | None:
        """Return the branch of its journal for a part of the run; None keeps nothing."""
        return None if self.journal is None else self.journal.branch(name)

    def trimmed(self, printed: PrintedDesign) -> PrintedDesign:
        """Return a print at the pressure that suits it best, or at the one that is held."""
        if is_held(printed):
            return printed
        return trimmed(printed, tolerances=self.scene.results.tolerances)

    def problem(self, case: Case, level: Level) -> ShapeDesign:
        """Return the design problem of a case on the mesh of a level (collective)."""
        return self.scene.problem(self.comm, case, level, verbose=self.verbose)


def is_held(printed: PrintedDesign) -> bool:
    """Return whether the pressure of a print is given, and not designed."""
    made = printed.evaluation
    return made is not None and not any(made.problem.physics.pressure_ranges)
