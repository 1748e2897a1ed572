"""One call designs a skin: from a case that is a function of the mesh to print, verdict, files."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from mpi4py import MPI
from pydantic import InstanceOf

from toros_fem.base.errors import ParameterError
from toros_fem.base.files import guarded, if_plotting
from toros_fem.base.keys import Length, Table, key
from toros_fem.base.mpi import on_first_rank, require_comm
from toros_fem.base.scene import NO_TABLE
from toros_fem.base.validation import require_callable, require_flag, require_kind
from toros_fem.design.loop.case import Case
from toros_fem.products.actuators.cost import require_affordable_meshes
from toros_fem.products.actuators.result import SkinDesign
from toros_fem.products.actuators.scene import DesignScene, Level
from toros_fem.results.report.page_file import write_report
from toros_fem.results.runs.open_run import FREE, open_run

# Filter radius over the edge length, where none is given.
FILTER_EDGES = 1.5


def design_skin(
    comm: MPI.Comm,
    case_of: Callable[..., Case],
    edge_length: float,
    output: Path | str,
    *,
    start_from: Path | str | None = None,
    resume: bool = False,
    overwrite: bool = False,
    verbose: bool = False,
    **settings: Any,
) -> SkinDesign:
    """Design a skin: optimise, print, trim, correct, judge, and write all files (collective).

    It is what `toros design` does with a scene: densities from coarse to fine, or with `start` =
    "relaxed" line families that are laid as lines; the print on its exact borders, at the pressure
    that suits it best, and again for what it misses; intervals from coarser meshes, the curve over
    the pressure, machine files, pictures and report. `print` of the result tells the verdict.

    Args:
        case_of: The case on a mesh, as a function of its edge length in m. A pressure without
            bounds is held. Where it has further parameters with the keys of metrics, such as
            `twist_deg`, lines are asked for other targets by these.
        edge_length: Edge length in m of the finest mesh, that of the print of lines.
        output: Folder of the files.
        start_from: Output folder of a design whose print the densities start from; None for none.
        resume: Whether to go on with a run in the folder that was stopped.
        overwrite: Whether to replace a run in the folder.
        verbose: Whether to print every Newton step.
        settings: Values of the tables [design], [lines], [print] and [results] of scene files by
            their keys, `seed = 1` for instance (docs/reference/scene_keys.md). The defaults are
            theirs, but for one mesh and a `filter_radius` of 1.5 edges.

    Raises:
        ParameterError: A key is unknown, or a number is out of its bounds or does not fit.
        OutputError: The folder is not empty, or cannot be written to.
        NoEquilibriumError: The start has no equilibrium.
    """
    require_comm(comm)
    require_callable("case_of", case_of, "a function of an edge length in m that returns a Case")
    require_kind("output", output, (str, Path), "the path of a folder")
    require_flag(resume=resume, overwrite=overwrite, verbose=verbose)
    folder = Path(output)
    scene = scene_of(case_of, edge_length, settings).of_first_rank(comm)
    files = {} if start_from is None else {"start_from": Path(start_from)}
    first = scene.from_print() if files else scene
    case = require_affordable_meshes(comm, first)  # told before a folder is touched
    inputs = on_first_rank(comm, lambda: _inputs(scene, case, files))
    again = "the same script, with resume=True in design_skin"
    with open_run(comm, folder, inputs, resume=resume, overwrite=overwrite, again=again):
        found = scene.run_design(comm, folder, files, verbose=verbose)

    def report() -> None:
        write_report(folder)

    guarded(comm, folder, lambda: if_plotting(report))
    return found


class MeshSize(Table):
    """Mesh."""

    edge_length: Length | None = key(
        None, "edge length of the finest mesh of densities; none where lines are laid"
    )


class CaseScene(DesignScene):
    """A skin whose case is a function of the edge length, for `design_skin`."""

    skin: MeshSize = MeshSize()

    case_of: InstanceOf[Callable[..., Case]] | None = field(  # type: ignore[type-var]
        default=None, repr=False, compare=False, metadata=NO_TABLE
    )

    def of_first_rank(self, comm: MPI.Comm) -> Self:
        """Return the settings of the first rank with the rank's own function (collective)."""
        tables = replace(self, case_of=None) if comm.rank == 0 else None
        return replace(comm.bcast(tables), case_of=self.case_of)

    @property
    def coarsest_edge(self) -> float | None:
        """Edge length in m of the coarsest of the meshes that are asked for."""
        edge, levels = self.skin.edge_length, self.design.levels or 1
        return None if edge is None else edge * 2.0 ** (levels - 1)

    @property
    def edges(self) -> Mapping[str, float]:
        """Edge lengths in m of the finest meshes of the design, by key."""
        if self.design.start == "relaxed":
            lines = self.lines
            return {
                "relaxed_edge_length": lines.relaxed_edge_length,
                "edge_length": lines.print_edge_length,
            }
        return super().edges

    def targets(self) -> Mapping[str, str]:
        """Return the further parameters of the function of the case, by the metrics' keys."""
        assert self.case_of is not None
        _, *more = inspect.signature(self.case_of).parameters
        return {name: name for name in more}

    def asked(self, targets: Mapping[str, float]) -> Self:
        """Return the scene of other targets of some metrics, by the keys of these."""
        assert self.case_of is not None
        return replace(self, case_of=partial(self.case_of, **targets))

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return what the function returns on the mesh of a level (collective).

        Raises:
            ParameterError: It is no case.
        """
        del comm  # the function has its own
        assert self.case_of is not None
        made = self.case_of(level.edge_length)
        require_kind("case_of(…)", made, Case, "a Case")
        return made


def scene_of(
    case_of: Callable[..., Case], edge_length: float, settings: Mapping[str, Any]
) -> CaseScene:
    """Return the scene of a case and its settings."""
    if "print_edge_length" in settings:
        raise ParameterError(
            "print_edge_length is given as edge_length, the third argument.", "print_edge_length"
        )
    if settings.get("start") == "relaxed":
        sizes = {"print_edge_length": edge_length}
    else:
        sizes = {"edge_length": edge_length, "filter_radius": FILTER_EDGES * edge_length}
    return replace(CaseScene.of(**{**sizes, **settings}), case_of=case_of)


def _inputs(scene: CaseScene, case: Case | None, files: Mapping[str, Path]) -> dict[str, Any]:
    """Return what tells this run from others, as JSON has it (one rank)."""
    values, free = scene.fixed_and_free()
    digest = hashlib.sha256()
    if case is not None:
        pattern = case.pattern
        for array in (pattern.points, pattern.flat_points, case.goal, case.supports.fixed):
            digest.update(np.ascontiguousarray(array).tobytes())
    return {
        "command": "design_skin",
        "config": values,
        "case": digest.hexdigest(),
        FREE: free,
        "files": {name: str(path.resolve()) for name, path in files.items()},
    }
