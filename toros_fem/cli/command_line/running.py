"""A scene is designed or simulated in a run folder, from the start or from where it stopped."""

from __future__ import annotations

import hashlib
import json
import logging
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

from toros_fem.base.errors import CheckpointError, FileError
from toros_fem.base.files import if_plotting
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.program import program
from toros_fem.cli.command_line.command import Answer
from toros_fem.cli.command_line.exit_codes import UsageError
from toros_fem.cli.scene_files.reading import SceneFile, read_scene
from toros_fem.cli.scene_files.writing import scene_text
from toros_fem.measures.figures import State
from toros_fem.products.kinds import KINDS
from toros_fem.products.plausibility import doubts, warn_of_doubts
from toros_fem.results.open_run import FREE, open_run, read_record
from toros_fem.results.report.page_file import write_report
from toros_fem.results.report.tables import as_text
from toros_fem.results.stored_run import SCENE, files_of_run, read_content, summary_of

log = logging.getLogger(__name__)


# The method of a scene that does what a command asks for, and its table of files that it can take.
_ACTIONS = {
    "design": ("run_design", "DESIGN_FILES"),
    "simulate": ("run_simulation", "SIMULATION_FILES"),
}


def files_of(scene: SceneFile, name: str) -> tuple[str, ...]:
    """Return the names of the files that a "design" or "simulate" of a scene can take.

    A UsageError says that its kind has no such action.
    """
    run, files = _ACTIONS[name]
    if not hasattr(scene.kind, run):
        known = ", ".join(kind for kind, of in KINDS.items() if hasattr(of, run))
        raise UsageError(
            f"toros {name}: scenes of the kind {scene.kind.KIND!r} have no {name}; those of these "
            f"kinds have one: {known}."
        )
    return tuple(getattr(scene.kind, files))


def run_scene(
    comm: MPI.Comm,
    scene: SceneFile,
    name: str,
    folder: Path,
    *,
    every: int,
    verbose: bool,
    resume: bool = False,
    overwrite: bool = False,
) -> Answer:
    """Design or simulate a scene in a run folder, by the name of the action (collective).

    Raises:
        UsageError: The kind of the scene has no such action, or its run would remove a file that it
            reads.
        TorosError: As of `open_run` and of the action.
    """
    files = _taken(scene, name)
    action = getattr(scene.config, _ACTIONS[name][0])
    if overwrite:
        on_first_rank(comm, lambda: _require_apart(folder, files))
    inputs = on_first_rank(comm, lambda: inputs_of(scene, name))
    text = scene_text(scene.config, files, scene.materials)
    with scene.located():  # what is impossible is refused before a folder is touched
        doubtful = doubts(scene.config, simulated=name == "simulate")
        if overwrite:
            _require_meshes(comm, scene, name, files)
    with (
        scene.located(),
        open_run(comm, folder, inputs, scene=text, resume=resume, overwrite=overwrite, every=every),
    ):
        if resume:
            log.info("the run in %s goes on", folder)
        if name == "simulate":  # a design warns by itself
            warn_of_doubts(comm, doubtful)
        action(comm, folder, files, verbose=verbose)
    told, summary = on_first_rank(comm, lambda: (_told(folder), read_content(folder)))
    return Answer("\n".join([told, *narrower(scene, folder, summary)]), summary)


def _told(folder: Path) -> str:
    """Write the report of a run, and return what a terminal tells of it (one rank)."""
    place = folder

    def write() -> None:
        nonlocal place
        place = write_report(folder)

    if_plotting(write)
    return f"{as_text(summary_of(folder))}\nSee {place}"


def narrower(scene: SceneFile, folder: Path, summary: Mapping[str, Any]) -> list[str]:
    """Return how to go on with a run that is not certain; empty if it cannot be narrower."""
    key, state = "check_refinement", summary["verdict"]["state"]
    possible = key in scene.kind.described() and scene.config.value(key) is None
    if state != State.NOT_CERTAIN or not possible:
        return []
    lines = "start" in scene.kind.described() and scene.config.value("start") == "relaxed"
    also = ", and perhaps other lines" if lines else ""
    told = summary.get("errors", {}).get("meshes", {})
    finer = round(2 / min(1.0, *map(float, told)) if told else 2)
    return [
        f"For narrower intervals{also}:",
        f"  {program()} resume {shlex.quote(str(folder))} --set {key}={finer}",
    ]


def resume_scene(
    comm: MPI.Comm, folder: Path, changes: Sequence[str] = (), *, every: int, verbose: bool
) -> Answer:
    """Go on with the run in a folder, with the inputs that it began with (collective).

    Args:
        changes: Other values of keys that are `free`, as "KEY=VALUE".

    Raises:
        UsageError: A key may not change.
        OutputError: The run in the folder is finished or in use.
        CheckpointError: The run cannot go on: it is no run of a scene, or its scene was changed.
        FileError: The folder holds no run, or a file that it began with has gone.
    """
    record, text = read_record(comm, folder)
    name = record.inputs.get("command")
    if text is None and name in _ACTIONS:
        raise CheckpointError(
            f"{folder / SCENE} is missing. Start the run anew by toros {name} --overwrite."
        )
    if text is None or name not in _ACTIONS:
        raise CheckpointError(
            f"the run in {folder} was not made by `toros design` or `toros simulate`. Resume it "
            "by the script that made it."
        )
    try:
        scene = read_scene(folder / SCENE, comm=comm, changes=changes)
    except FileError as error:
        if changes:
            raise
        raise CheckpointError(
            f"the scene of the run in {folder} cannot be read any more: {error}"
        ) from None
    scene.require_files(comm)
    if changes:
        inputs, then = on_first_rank(comm, lambda: inputs_of(scene, name)), record.inputs
        values, before = inputs["config"], then.get("config", {})
        if fixed := [key for key in values if values[key] != before.get(key)]:
            raise UsageError(
                f"toros resume: {fixed[0]} tells another problem. A run that goes on may change "
                f"{', '.join(inputs[FREE])}; for all else start a new run by toros design."
            )
    return run_scene(comm, scene, name, folder, every=every, verbose=verbose, resume=True)


def _require_apart(folder: Path, files: Mapping[str, Path]) -> None:
    """Check that no file of a scene belongs to the run that is overwritten (one rank)."""
    own = {folder.resolve(), *(path.resolve() for path in files_of_run(folder))}
    for name, path in files.items():
        if path in own:
            raise UsageError(
                f"{name} = {path} belongs to the run in {folder}, which would be removed. "
                "Choose another --output."
            )


def _require_meshes(comm: MPI.Comm, scene: SceneFile, name: str, files: Mapping[str, Path]) -> None:
    """Check the files and meshes of an action before it removes a run (collective)."""
    from toros_fem.products.actuators.cost import require_affordable_meshes
    from toros_fem.products.actuators.scene import ActuatorScene
    from toros_fem.products.actuators.simulate import case_to_simulate
    from toros_fem.products.tubes.inflate import InflateScene

    config = scene.config
    if isinstance(config, InflateScene):
        config.expected_cost(comm)
    elif isinstance(config, ActuatorScene):
        read = config.with_files(comm, files)
        if name == "design":
            require_affordable_meshes(comm, read)
        else:
            case_to_simulate(comm, read, files.get("pattern"))


def _taken(scene: SceneFile, name: str) -> dict[str, Path]:
    """Return the files of a scene that an action takes."""
    names = files_of(scene, name)
    return {key: scene.files[key].resolve() for key in names if key in scene.files}


def inputs_of(scene: SceneFile, name: str) -> dict[str, Any]:
    """Return all inputs of an action, as JSON has them (one rank).

    Files are told by their content, folders by their place.
    """
    values, free = scene.config.fixed_and_free()
    found: dict[str, Any] = {
        "command": name,
        "kind": scene.kind.KIND,
        "config": values,
        FREE: free,
        "files": {key: _content(path) for key, path in _taken(scene, name).items()},
    }
    return dict(json.loads(json.dumps(found)))


def _content(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:  # a folder; what is missing is told where it is read
        return str(path)
