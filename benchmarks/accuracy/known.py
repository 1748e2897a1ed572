"""Quantities with a reference, on meshes that are refined."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.bench import Row, timed

__all__ = ["GROUPS", "Known", "Measured", "Refinement", "refinements", "rows_of", "timed"]
GROUPS = {
    "membrane": "Membrane",
    "bending": "Bending",
    "contact": "Contact",
    "patterns": "Kinematics of patterns",
}


@dataclass(frozen=True)
class Measured:
    """Result of one run.

    Attributes:
        value: The quantity, in the unit of the reference.
        triangles: Of the mesh.
        seconds: Wall time of the solve: what a user waits for once the forms are compiled.
        length: What is refined where that is not the mesh, in m; None for the mesh.
    """

    value: float
    triangles: int
    seconds: float
    length: float | None = None


@dataclass(frozen=True)
class Known:
    """Quantity that is known by other means.

    Attributes:
        name: In tables; words joined by hyphens.
        group: One of `GROUPS`.
        about: What is computed and compared, for the report: one or two sentences.
        quantity: Of the value, with its unit.
        reference: The known value.
        source: Where the reference comes from.
        formulations: Names handed to `run`: of the bending terms, or "membrane".
        meshes: Names handed to `run`.
        sizes: Refinements handed to `run`, coarse to fine, at least four; `--quick` takes the
            first two.
        run: `run(formulation, mesh, size)`.
        within: Relative error that the finest mesh must reach, by formulations that converge;
            None where the reference is no limit of refinement (a bound, a trend).
        note: What explains the observed order, or what to beware of.
        default: The size nearest to the default mesh of the demos, 14 edges to 2 cm; None takes
            the second one, where sizes mean something else.
    """

    name: str
    group: str
    about: str
    quantity: str
    reference: float
    source: str
    formulations: tuple[str, ...]
    meshes: tuple[str, ...]
    sizes: tuple[int, ...]
    run: Callable[[str, str, int], Measured]
    within: float | None = None
    note: str = ""
    default: int | None = None

    def __post_init__(self) -> None:
        if self.group not in GROUPS or len(self.sizes) < 4:
            raise ValueError(f"{self.name}: group {self.group}, sizes {self.sizes}")

    @property
    def default_size(self) -> int:
        """The size that stands for a mesh which nobody has refined."""
        return self.sizes[1] if self.default is None else self.default


@dataclass(frozen=True)
class Refinement:
    """One size of a case; its error is relative but where the reference is 0."""

    formulation: str
    mesh: str
    size: int
    triangles: int
    value: float
    relative_error: float
    observed_order: float | None
    seconds: float


def refinements(known: Known, *, quick: bool = False) -> Iterator[Refinement]:
    """Run a case over its formulations, meshes and sizes."""
    for formulation in known.formulations:
        for mesh in known.meshes:
            last: tuple[float, Measured] | None = None
            for size in known.sizes[:2] if quick else known.sizes:
                found = known.run(formulation, mesh, size)
                error = abs(found.value - known.reference) / (abs(known.reference) or 1.0)
                yield Refinement(
                    formulation, mesh, size, found.triangles, found.value, error,
                    None if last is None else _order(*last, error, found), found.seconds,
                )  # fmt: skip
                last = error, found


def _order(before: float, last: Measured, error: float, found: Measured) -> float | None:
    """Return the order in what is refined, mostly the edge length; None below rounding."""
    if min(error, before) < 1e-12:
        return None
    finer = (found.triangles / last.triangles) ** 0.5
    if found.length is not None and last.length is not None:
        finer = last.length / found.length
    return float(np.log(before / error) / np.log(finer)) if finer != 1 else None


def rows_of(known: Known, *, quick: bool = False) -> Iterator[Row]:
    """Return the rows of a case."""
    for found in refinements(known, quick=quick):
        place = (known.name, f"{found.formulation} {found.mesh}", f"{found.size}")
        yield Row(*place, "error", found.relative_error, "", known.reference, found.seconds)
        yield Row(*place, "value", found.value, known.quantity, known.reference, found.seconds)
        yield Row(*place, "triangles", found.triangles)
        yield Row(*place, "order", found.observed_order)
