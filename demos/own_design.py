"""Your own mesh from an STL file to a print: fixed region, target, design, results.

    python demos/own_design.py
    python demos/own_design.py --file my.stl --scale 1e-3 --angle 60 --levels 2

The default file is a finger with an elliptic section, 90 mm high, in millimetres. The script reads
it, cuts it into flat panels, fixes the part below a height, prints the flat end caps all over, and
designs the rest so that the finger bends towards +x. With `--levels 2` the design goes on for a few
steps on a mesh of half the edge length. The results lie in `output/own_design/`. Copy
this script and change what differs in your case: every step is one call. Without any script,
`demos/scenes/own_design.toml` is the same design, and `examples/finger.toml` a fuller one.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from mpi4py import MPI

import toros_fem as tf
from toros_fem.base.keys import Count, Distance, In, Length, Modulus, Number, Table, key
from toros_fem.cli.command_line.scripts import run_from_command_line
from toros_fem.measures.body_axis import body_axis
from toros_fem.results.runs import journal_of

FINGER = Path(__file__).parent / "surfaces" / "finger.stl"


@dataclass(frozen=True)
class OwnDesignConfig(Table):
    """Numbers of this script; SI units."""

    scale: Length = key(1e-3, "length of the file's unit")
    angle: Annotated[float, In("deg", above=-360, below=360)] = key(
        60.0, "bend angle of the target"
    )
    fixed_height: Distance = key(4e-3, "the skin is fixed below this height")
    pressure: Modulus = key(8e3, "first guess of the pressure")
    pressure_max: Modulus = key(20e3, "largest pressure")
    filter_radius: Length = key(3.9e-3, "radius R of the filter on the file's mesh")
    levels: Count = key(1, "number of meshes: the file's own, then each triangle divided into four")
    iterations: Count = key(30, "design steps before the width constraints act")
    constrained_iterations: Count = key(20, "design steps with them")
    level_iterations: Count = key(10, "design steps on each further mesh")
    island_area: Annotated[float, In("m²", at_least=0)] = key(
        50e-6, "free islands smaller than this are not printed"
    )
    seed: Number = key(0, "seed of the random start")


def run(
    comm: MPI.Comm,
    output: Path | str,
    config: OwnDesignConfig | None = None,
    files: Mapping[str, Path] | None = None,
    *,
    verbose: bool = False,
) -> str:
    """Design the skin in a mesh file and write the results; return a sentence.

    Args:
        comm: Communicator.
        output: Folder for the results.
        config: Numbers of this script.
        files: A closed triangle surface whose long axis is z, as "file"; the finger without it.
        verbose: Whether to print every Newton step.
    """
    c = config or OwnDesignConfig()
    reporter, journal = tf.DesignReporter(comm, output), journal_of(output)
    surface = tf.meshes.read_surface(comm, (files or {}).get("file", FINGER), scale=c.scale)
    pattern = tf.meshes.unwrap(comm, surface).pattern
    axis = body_axis(pattern, "z", "x", 0.0, None)
    height = axis.local(pattern.points)[:, 2]
    flat = [
        name
        for name in pattern.panel_names
        if np.ptp(height[pattern.vertices_of(name)]) < 1e-3 * axis.length
    ]
    case = tf.Case(
        pattern,
        # A skin under pressure does not shorten, so the inner side of the bend keeps its length.
        target=axis.deformer(np.radians(c.angle), None, None, neutral=axis.half_width),
        supports=tf.clamp_where(pattern, lambda x: axis.local(x)[:, 2] < c.fixed_height),
        pressure=c.pressure,
        pressure_bounds=(1e3, c.pressure_max),
        printed_panels=flat,
    )
    log = (lambda step: print(step, flush=True)) if verbose and comm.rank == 0 else None
    design = tf.ShapeDesign(comm, case, tf.Regularisation(c.filter_radius), log=log)
    stages = (tf.Stage(c.iterations), tf.Stage(c.constrained_iterations, constrained=True))
    finer = tf.DesignOptions((tf.Stage(c.level_iterations, constrained=True),), pressure_move=0.02)
    options = [tf.DesignOptions(stages), *[finer] * (c.levels - 1)]
    reporter.expect(sum(level.iterations for level in options))
    with reporter:
        problems = tf.refinements(design, c.levels)
        result = tf.optimize_levels(
            problems, options, seed=c.seed, callback=reporter, journal=journal
        )
    limits = tf.PrintLimits(width=0.6e-3, gap=0.6e-3)
    printed = tf.as_printed(
        result.problem, result, limits, island_area=c.island_area, journal=journal
    )
    summary = tf.write_results(output, result, printed, config=c, seconds=reporter.seconds)
    return ", ".join(f"{row['name']} {row['value']} {row['unit']}" for row in summary["figures"])


if __name__ == "__main__":
    sys.exit(
        run_from_command_line(
            MPI.COMM_WORLD,
            __doc__,
            OwnDesignConfig(),
            run,
            Path("output/own_design"),
            files={"file": "closed triangle surface whose long axis is z; default: a finger"},
        )
    )
