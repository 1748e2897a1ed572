"""`toros check`, `design`, `simulate`, `resume` and `study`: what is done with a scene."""

from __future__ import annotations

import logging
import math
import os
from contextlib import AbstractContextManager
from dataclasses import MISSING, asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from mpi4py import MPI

from toros_fem.base.keys import Count, File, Flag, Text, key
from toros_fem.base.mpi import on_first_rank
from toros_fem.cli.command import Answer, Command
from toros_fem.cli.commands.doctor import memory_gib
from toros_fem.cli.process import DONE, NO_EQUILIBRIUM, UsageError
from toros_fem.measures.figures import formatted
from toros_fem.mechanics.readings.bare_tube import tube_pressure, tube_strains
from toros_fem.products.kinds import ABOUT

if TYPE_CHECKING:
    from toros_fem.cli.scene_files import SceneFile
    from toros_fem.products.actuators.cost import Cost
    from toros_fem.products.common.plausibility import Inflated

log = logging.getLogger(__name__)

BED = (
    "After the design, make the machine files by `toros export RUN` with --bed-width and "
    "--bed-depth:"
)
# Part of the machine's memory above which a run is warned of.
CROWDED = 0.8


class Progress(Command, kw_only=True):
    """What is reported and stored while it runs."""

    every: Count = key(2, "iterations between two writes of the state")
    verbose: Flag = key(False, "print every Newton step")
    petsc: Text = key(
        "",
        "options of PETSc for the equilibrium solver, each with the prefix -toros_, as in the "
        "variable PETSC_OPTIONS: '-toros_snes_monitor -toros_snes_rtol 1e-8'",
    )

    TAKES: ClassVar = {"petsc": "OPTIONS"}

    def petsc_given(self) -> AbstractContextManager[None]:
        """Let PETSc have these options in a `with` block."""
        from toros_fem.mechanics.equilibrium.newton import given_options

        return given_options(self.petsc)


class Changes(Command, kw_only=True):
    """Changes of a scene's values."""

    set: tuple[Text, ...] = key(
        (),
        "another value of a key of the scene file, as it would stand there, in its unit or in SI "
        "units; may be given several times",
    )

    TAKES: ClassVar = {"set": "KEY=VALUE"}


class Meshes(Command, kw_only=True):
    """Large meshes."""

    allow_large: Flag = key(False, "also allow meshes of more than 2000000 triangles")

    def meshes_allowed(self) -> AbstractContextManager[None]:
        """Lift the limit on triangles inside a `with` block, if the options ask for it."""
        from toros_fem.meshes.triangles import MOST_TRIANGLES, triangle_limit

        return triangle_limit(None if self.allow_large else MOST_TRIANGLES)


class SceneCommand(Changes, Meshes, kw_only=True):
    """The scene and its quick variant."""

    file: File = key(MISSING, "scene file, by `toros new`")
    coarse: Flag = key(False, "the scene's quick variant: a coarse mesh and few steps")

    WORDS: ClassVar[tuple[str, ...]] = ("file",)

    def scene(self, comm: MPI.Comm) -> SceneFile:
        """Read the scene that the options name, and look for its files (collective)."""
        from toros_fem.cli.scene_files import read_scene

        scene = read_scene(self.file, comm=comm, coarse=self.coarse, changes=self.set)
        scene.require_files(comm)
        if self.coarse and comm.rank == 0:
            known = scene.config.described()
            told = [
                f"{name} = {known[name].written(scene.config.value(name))} (not "
                f"{known[name].written(value)})"
                for name, value in scene.instead.items()
            ]
            log.info("--coarse takes %s", ", ".join(told) or "what stands there")
        return scene


class RunCommand(SceneCommand, Progress, kw_only=True):
    """The run's folder."""

    output: File | None = key(
        None,
        "folder of the run, made if missing, and refused if it is not empty; none: named after the "
        'file, for a simulation with "-simulated"',
    )
    overwrite: Flag = key(
        False, "replace the run in the folder: its own files are removed, all others stay"
    )
    metric: tuple[Text, ...] = key(
        (),
        'a number more to judge an own mesh by: "bend of z > 70 mm against z < 5 mm", as in the '
        "tables [[metric]] of its file; measures are bend, turn, twist, length, x, y, z, lean, and "
        "tip for the last four; may be given several times",
    )
    TAKES: ClassVar = {**SceneCommand.TAKES, **Progress.TAKES, "output": "RUN", "metric": "WORDS"}

    def scene(self, comm: MPI.Comm) -> SceneFile:
        """Read the scene that the options name, with the metrics that they add (collective)."""
        scene = super().scene(comm)
        if not self.metric:
            return scene
        from toros_fem.products.own_mesh import OwnMeshScene
        from toros_fem.products.own_metrics import MetricTable

        if not isinstance(scene.config, OwnMeshScene):
            raise UsageError(
                f"--metric is for own meshes; scenes of the kind {scene.kind.KIND!r} have "
                "metrics of their own."
            )
        metrics = (*scene.config.metric, *map(MetricTable.from_words, self.metric))
        return replace(scene, config=scene.config.updated(metric=metrics))

    def run(self, comm: MPI.Comm, scene: SceneFile, name: str, **files: Path | None) -> Answer:
        """Design or simulate a scene, with files given by options, in its folder (collective)."""
        from toros_fem.cli.running import files_of, run_scene

        given = {one: path for one, path in files.items() if path is not None}
        for one in given.keys() - files_of(scene, name):
            option = "--" + one.replace("_", "-")
            raise UsageError(
                f"toros {name}: scenes of the kind {scene.kind.KIND!r} take no {option}."
            )
        scene = replace(scene, files={**scene.files, **given})
        scene.require_files(comm)
        with self.meshes_allowed(), self.petsc_given():
            own = f"{self.file.stem}-simulated" if name == "simulate" else self.file.stem
            folder = self.output or Path(own)
            return run_scene(
                comm,
                scene,
                name,
                folder,
                overwrite=self.overwrite,
                every=self.every,
                verbose=self.verbose,
            )


class Check(SceneCommand, kw_only=True):
    """Reads a scene file and says what is wrong, or how large the design will be.

    An error names file, line and key, and the nearest right key. A warning ("doubt") means that
    numbers do not fit each other, a pressure and a fabric for instance; what no skin can do is an
    error. The command also estimates the mesh size and the memory. Meshes of too many triangles
    are refused before they are made.
    """

    drawing: File | None = key(
        None,
        "also write the panels to this .svg, .dxf or .geojson file, to draw a print in for "
        "`toros simulate --drawing`; a file that is there stays",
    )

    EXAMPLES: ClassVar = (
        "toros check mine.toml",
        "toros check mine.toml --drawing stripes.svg",
        'toros check mine.toml --coarse --set edge_length="2 mm"',
        "toros check mine.toml --json",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Read the scene, and find its cost (collective)."""
        from toros_fem.products.common.plausibility import doubts

        scene = self.scene(comm)
        figures: dict[str, Any] = {
            "file": scene.path,
            "kind": scene.kind.KIND,
            "coarse": self.coarse,
            "inputs": scene.config.as_dict(),
            "materials": {role: entry.name for role, entry in scene.materials.items()},
        }
        with self.meshes_allowed(), scene.located():
            read: Any = scene.config.with_files(comm, scene.files)
            doubtful = doubts(read)
            more = {"from_print": True} if "start_from" in scene.files else {}
            cost = read.expected_cost(comm, **more)
        doubtful += cost.doubts
        figures |= {**asdict(cost), "memory_gib": cost.memory / 2**30, "doubts": doubtful}
        state = "is in order" if not doubtful else "can be read, but is doubtful"
        lines = [f"{scene.path} {state}: {ABOUT[scene.kind.KIND]}."]
        lines += [f"doubt       {one}" for one in doubtful]
        for role, entry in scene.materials.items():
            lines.append(f"{role:15s}{entry.name}: {entry.title} ({entry.trust})")
        if (skin := getattr(read, "inflated", None)) is not None:
            lines.append(_pressure(skin, getattr(read, "needed_strain", None)))
        if cost.placing:
            lines.append(f"bed         {BED} {cost.placing}")
        lines += cost_lines(comm, cost)
        if self.drawing is not None:
            _write_template(comm, read, self.drawing)
            figures["drawing"] = self.drawing
            lines.append(f"drawing     {self.drawing}: print in the panels, and simulate it")
        return Answer("\n".join(lines), figures)


def _write_template(comm: MPI.Comm, scene: Any, path: Path) -> None:
    """Write the panels of an actuator, to draw a print in (collective)."""
    from toros_fem.making.drawing import write_template
    from toros_fem.products.actuators.scene import ActuatorScene

    if not isinstance(scene, ActuatorScene):
        raise UsageError(f"toros check: prints on scenes of {scene.KIND!r} cannot be drawn.")
    if on_first_rank(comm, lambda: os.path.lexists(path)):
        raise UsageError(f"toros check: {path} is there already, and stays; give another name.")
    write_template(comm, path, scene.case(comm, scene.finest_level).whole.pattern)


def _pressure(skin: Inflated, needed: float | None) -> str:
    """Return what the pressure does to the bare fabric, and which one the target wants."""
    load, (around, along) = (
        skin.load("pressure", skin.pressure),
        tube_strains(skin.sheet, skin.radius, skin.pressure),
    )
    told = (
        f"pressure    {formatted(skin.pressure, 'pa')} makes the bare skin {around:.0%} wider and "
        f"{along:.0%} longer (p r/(E h) = {load.value:.2g}); its bound is "
        f"{skin.sheet.fabric_bounds[0] - 1:.0%}"
    )
    if not needed:
        return told
    enough = tube_pressure(skin.sheet, skin.radius, needed)
    gives = f"from {formatted(enough, 'pa', 2)} on" if math.isfinite(enough) else "at no pressure"
    more = ", more than is given" if enough > skin.pressure else ""
    return f"{told}. The target needs {needed:.0%}; the bare skin has that {gives}{more}"


def cost_lines(comm: MPI.Comm, found: Cost) -> list[str]:
    """Return a cost in lines; all ranks may ask."""
    memory, machine = found.memory / 2**30, memory_gib()
    if machine is not None and memory > CROWDED * machine and comm.rank == 0:
        log.warning(
            "about %.1f GiB are needed, and this machine has %.1f GiB: take longer edges",
            memory,
            machine,
        )
    there = "" if machine is None else f"; this machine has {machine:.1f} GiB"
    more = f", {found.largest} on a refined one" * (found.largest > found.triangles)
    return [
        f"triangles   about {found.triangles} on the finest mesh{more}",
        f"unknowns    about {found.unknowns} on the finest mesh",
        f"memory      about {memory:.1f} GiB (± 25 %){there}",
    ]


class Design(RunCommand, kw_only=True):
    """Designs the pattern of a scene.

    The pattern is designed, cleaned so that it can be printed, simulated again and written,
    with pictures and all figures in summary.json. The state is written while it runs: a run
    that was stopped goes on by `toros resume`.
    """

    start_from: File | None = key(
        None,
        "folder of a finished design: the densities start from its print, which may have another "
        "size, target or pressure, on the finest mesh; none: the scene's start",
    )

    final: Flag = key(
        False,
        "the design to trust: fine meshes, figures from a finer one, and up to three seeds until a "
        "print certainly reaches its targets; what it costs is told first",
    )

    TAKES: ClassVar = {**RunCommand.TAKES, "start_from": "DESIGN"}
    EXAMPLES: ClassVar = (
        "toros design mine.toml --output run",
        "toros design mine.toml --output quick --coarse",
        "toros design mine.toml --output best --final",
        "toros design mine.toml --output other --set angle=90",
        "toros design mine.toml --output more --set angle=120 --start-from other",
        "mpirun -n 2 toros design mine.toml --output run",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Design in the run's folder (collective)."""
        scene = self.scene(comm)
        if self.final:
            scene = self._finally(comm, scene)
        return self.run(comm, scene, "design", start_from=self.start_from)

    def _finally(self, comm: MPI.Comm, scene: SceneFile) -> SceneFile:
        """Return the final variant of a scene, and tell its cost (collective)."""
        from toros_fem.base.keys import duration
        from toros_fem.products.actuators.cost import expected_time
        from toros_fem.products.actuators.scene import ActuatorScene
        from toros_fem.results.reporter import print_line

        if self.coarse:
            raise UsageError("--coarse is a preview, and --final is not: leave one of them out.")
        if not isinstance(scene.config, ActuatorScene):
            raise UsageError(f"scenes of the kind {scene.kind.KIND!r} have no --final.")
        config = scene.config.final()
        scene = replace(scene, config=config)
        with self.meshes_allowed(), scene.located():
            read = config.with_files(comm, scene.files)
            cost = read.expected_cost(comm)
            low, high = map(duration, expected_time(comm, read, cost))
        if comm.rank == 0:
            ranks = f"{comm.size} rank{'s' * (comm.size > 1)}"
            lines = [*cost_lines(comm, cost), f"time        {low} to {high} on {ranks}"]
            print_line("\n".join(lines))
        return scene


class Simulate(RunCommand, kw_only=True):
    """Inflates a plain skin or a given pattern.

    The pressure rises to the scene's in curve_steps equal steps. The run's folder gets
    summary.json, curve.csv, skin.vtu and pictures.
    """

    pattern: File | None = key(
        None,
        "folder of a finished design whose print is simulated; none: the skin where only what the "
        "scene prescribes is printed",
    )
    drawing: File | None = key(
        None,
        "your own print, drawn in SVG, DXF or GeoJSON in a template by `toros check --drawing`; "
        "without a target",
    )

    TAKES: ClassVar = {**RunCommand.TAKES, "pattern": "DESIGN"}
    EXAMPLES: ClassVar = (
        "toros simulate mine.toml --output plain",
        'toros simulate mine.toml --output other --pattern designed --set pressure="8 kPa"',
        "toros simulate mine.toml --output stripes --drawing stripes.svg",
        "mpirun -n 2 toros simulate mine.toml --output plain --coarse",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Simulate in the run's folder (collective)."""
        if None not in (self.pattern, self.drawing):
            raise UsageError("toros simulate: --pattern and --drawing both give a print; take one.")
        pattern = self.drawing if self.pattern is None else self.pattern
        return self.run(comm, self.scene(comm), "simulate", pattern=pattern)


class Resume(Changes, Meshes, Progress, kw_only=True):
    """Continues a run that was stopped, or one that should go further.

    The run continues from its last state, with the inputs that it began with (RUN/scene.toml), on
    any number of ranks. On the same number its result is the same to the last digit. By --set it
    takes other numbers of steps and corrections, another curve, other tolerances or a check on a
    finer mesh, by which other lines may be printed; a finished run then goes on too. For other
    changes start a new run.
    """

    run: File = key(MISSING, "folder of the run")

    WORDS: ClassVar = ("run",)
    TAKES: ClassVar = {**Changes.TAKES, **Progress.TAKES}
    EXAMPLES: ClassVar = (
        "toros resume run",
        "toros resume run --set corrections=3 --set curve_pressure='30 kPa'",
        "mpirun -n 2 toros resume run",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Go on with the run (collective)."""
        from toros_fem.cli.running import resume_scene
        from toros_fem.meshes.triangles import triangle_limit

        # What the run began with was allowed.
        allowed = self.meshes_allowed() if self.set else triangle_limit(None)
        with self.petsc_given(), allowed:
            return resume_scene(comm, self.run, self.set, every=self.every, verbose=self.verbose)


class Study(SceneCommand, kw_only=True):
    """Runs a scene with all combinations of some values, and tabulates the results.

    Each run has its own folder in that of the study. study.csv has a row for each run, with its
    values and all results; study.png draws them. The same command continues a study that was
    stopped: finished runs are kept, stopped ones continue, and you may give more values.
    """

    over: tuple[Text, ...] = key(
        MISSING,
        "values of a key: a list with commas, LOW..HIGH:COUNT for even steps, LOW..HIGH for whole "
        "numbers; may be given several times",
    )
    output: File = key(MISSING, "folder of the study, made if missing")
    simulate: Flag = key(False, "simulate each scene, and design nothing")

    TAKES: ClassVar = {**SceneCommand.TAKES, "over": "KEY=VALUES", "output": "STUDY"}
    EXAMPLES: ClassVar = (
        "toros study mine.toml --over pressure=2..10kPa:5 --over seed=1..4 --output study",
        "toros study mine.toml --over fabric=jersey-light,stockinette-course --coarse --output s",
        "mpirun -n 2 toros study mine.toml --over seed=1..4 --output study",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Run all of them, one after the other (collective)."""
        from toros_fem.cli.running import TABLE, run_study

        command = "simulate" if self.simulate else "design"
        with self.meshes_allowed():
            rows = run_study(
                comm,
                self.file,
                self.over,
                self.output,
                command=command,
                coarse=self.coarse,
                changes=self.set,
            )
        failed = sum(bool(row["failure"]) for row in rows)
        text = f"{self.output / TABLE}: {len(rows)} runs"
        if failed:
            text += f", {failed} of them without a result (see the column failure)"
        code = NO_EQUILIBRIUM if failed else DONE
        return Answer(text, {"table": self.output / TABLE, "rows": rows}, code)
