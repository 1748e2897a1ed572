"""Cases of `accuracy.py`: a quantity with a reference, on meshes that are refined."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")
GROUPS = ("membrane", "bending", "contact", "patterns", "gradients")


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
class Case:
    """Quantity that is known by other means.

    Attributes:
        name: On the command line and in tables; words joined by hyphens.
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

    def __post_init__(self) -> None:
        if self.group not in GROUPS or len(self.sizes) < 4:
            raise ValueError(f"{self.name}: group {self.group}, sizes {self.sizes}")


@dataclass(frozen=True)
class Row:
    """One line of the results."""

    case: str
    formulation: str
    mesh: str
    triangles: int
    value: float
    reference: float
    relative_error: float
    observed_order: float | None
    seconds: float
    length: float | None = None


def rows_of(case: Case, *, quick: bool = False) -> Iterator[Row]:
    """Run a case over its formulations, meshes and refinements."""
    sizes = case.sizes[:2] if quick else case.sizes
    for formulation in case.formulations:
        for mesh in case.meshes:
            last: Row | None = None
            for size in sizes:
                found = case.run(formulation, mesh, size)
                error = abs(found.value - case.reference) / (abs(case.reference) or 1.0)
                last = Row(
                    case=case.name,
                    formulation=formulation,
                    mesh=mesh,
                    triangles=found.triangles,
                    value=found.value,
                    reference=case.reference,
                    relative_error=error,
                    observed_order=_order(last, error, found),
                    seconds=found.seconds,
                    length=found.length,
                )
                yield last


def _order(last: Row | None, error: float, found: Measured) -> float | None:
    """Return the order in what is refined, mostly the edge length; None below rounding."""
    if last is None or min(error, last.relative_error) < 1e-12:
        return None
    finer = (found.triangles / last.triangles) ** 0.5
    if found.length is not None and last.length is not None:
        finer = last.length / found.length
    return float(np.log(last.relative_error / error) / np.log(finer)) if finer != 1 else None


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """Return the result of a call and its time in s."""
    begin = time.perf_counter()
    result = work()
    return result, time.perf_counter() - begin


def as_dicts(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return rows for a JSON file, with a length only where that is what is refined."""
    return [
        {key: value for key, value in asdict(row).items() if key != "length" or value is not None}
        for row in rows
    ]
