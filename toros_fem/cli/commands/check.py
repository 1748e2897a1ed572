"""`toros check`: what is wrong with a scene file, and what the run will cost."""

from __future__ import annotations

import logging
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, ClassVar

from mpi4py import MPI

from toros_fem.cli.command_line.command import Answer
from toros_fem.cli.command_line.scene_options import SceneCommand
from toros_fem.cli.commands.doctor import memory_gib
from toros_fem.measures.figures import formatted
from toros_fem.mechanics.readings.bare_tube import tube_pressure, tube_strains
from toros_fem.products.kinds import ABOUT

if TYPE_CHECKING:
    from toros_fem.products.actuators.cost import Cost
    from toros_fem.products.plausibility import Inflated

log = logging.getLogger(__name__)
BED = (
    "After the design, make the machine files by `toros export RUN` with --bed-width and "
    "--bed-depth:"
)
# Part of the machine's memory above which a run is warned of.
CROWDED = 0.8


class Check(SceneCommand, kw_only=True):
    """Reads a scene file and says what is wrong, or how large the design will be.

    An error names file, line and key, and the nearest right key. A warning ("doubt") means that
    numbers do not fit each other, a pressure and a fabric for instance; what no skin can do is an
    error. The command also estimates the mesh size and the memory. Meshes of too many triangles
    are refused before they are made.
    """

    EXAMPLES: ClassVar = (
        "toros check mine.toml",
        'toros check mine.toml --coarse --set edge_length="2 mm"',
        "toros check mine.toml --json",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Read the scene, and find its cost (collective)."""
        from toros_fem.products.plausibility import doubts

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
        return Answer("\n".join(lines), figures)


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
