"""A fabric with designed stiffness: a tile that repeats (paper section 4.3, Fig. 7).

    python demos/tile.py --target tetragonal --coarse
    python demos/tile.py --target orthotropic

A square tile of 1 cm is printed so that the fabric, pulled by 10 % in any direction and free
across, is as stiff as asked. Several random starts are tried and the best is gone on with; what
counts is the printed pattern, simulated again on a mesh of half the edge length.

Targets: "orthotropic" (2000 N/m along x, 500 along y and at 45°), "tetragonal" (2000 along x and y,
400 at 45°), "isotropic" (700 everywhere), "anisotropic" (as stiff along x over y as it gets),
"auxetic" (widens when pulled along x or y). `demos/sample.py` makes a sheet of what is found.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem._validate import require_between, require_choice, require_count, require_positive
from toros_fem.command_line import command_line
from toros_fem.design.config import known_inputs
from toros_fem.meshes import tile
from toros_fem.output.console import print_step
from toros_fem.tiles.as_printed import measure_print
from toros_fem.tiles.case import TileCase, TileConfig
from toros_fem.tiles.objectives import Contrast, ProfileTarget
from toros_fem.tiles.printed_tile import PrintedTile
from toros_fem.tiles.report import TileReporter, write_tile_design
from toros_fem.tiles.search import design_tile

DEFAULTS: dict[str, Any] = {
    "target": "tetragonal",  # or "orthotropic", "isotropic", "anisotropic", "auxetic"
    "size": 0.01,  # m
    "edge_length": 0.125e-3,  # m; twice as long for the starts, half as long for the print
    "mesh": "crossed",
    "directions": 3,  # parts of 45° (tetragonal) or of 90° (orthotropic), twice as many there
    "stiffness_0": 0.0,  # N/m along x; 0 takes the target's own, as for the two below
    "stiffness_45": 0.0,
    "stiffness_90": 0.0,
    "contraction": -0.2,  # of the auxetic target
}
COARSE = {
    "edge_length": 0.2e-3,
    "radius": 0.8e-3,
    "starts": 5,
    "trial": 12,
    "iterations": 16,
    "correct": 3,
}
# Symmetry of the design, and stiffness along x, at 45° and along y, in N/m.
TARGETS: dict[str, tuple[str, tuple[float, float, float]]] = {
    "orthotropic": ("orthotropic", (2000.0, 500.0, 500.0)),
    "tetragonal": ("tetragonal", (2000.0, 400.0, 2000.0)),
    "isotropic": ("tetragonal", (700.0, 700.0, 700.0)),
    "anisotropic": ("orthotropic", (0.0, 0.0, 0.0)),
    "auxetic": ("chiral", (0.0, 0.0, 0.0)),
}


def linear_profile(angles: np.ndarray, along: float, diagonal: float, across: float) -> np.ndarray:
    """Stiffness of a linear orthotropic sheet over directions, from that at 0°, 45° and 90°.

    1/s = cos⁴/s₀ + sin⁴/s₉₀ + (4/s₄₅ − 1/s₀ − 1/s₉₀) sin² cos².
    """
    c, s = np.cos(angles) ** 2, np.sin(angles) ** 2
    mixed = 4 / diagonal - 1 / along - 1 / across
    return np.asarray(1 / (c**2 / along + s**2 / across + mixed * c * s))


def scene(comm: MPI.Comm, inputs: dict[str, Any]) -> TileCase:
    """The tile, on three meshes, and what it is to do."""
    o = inputs
    require_choice("target", o["target"], tuple(TARGETS))
    require_count(1, directions=o["directions"])
    symmetry, usual = TARGETS[o["target"]]
    reach = np.pi / 4 if symmetry == "tetragonal" else np.pi / 2
    count = o["directions"] * (1 if symmetry == "tetragonal" else 2)
    angles = np.asarray(np.linspace(0, reach, count + 1), dtype=np.float64)
    objective: ProfileTarget | Contrast
    if o["target"] == "anisotropic":
        angles = angles[[0, -1]]
        objective = Contrast(soft=angles > 0, stiff=angles == 0)
    elif o["target"] == "auxetic":
        require_between(-1.0, 1.0, contraction=o["contraction"])
        angles = angles[:1]
        objective = ProfileTarget(contraction=np.array([o["contraction"]]))
    else:
        given = [o[f"stiffness_{angle}"] for angle in (0, 45, 90)]
        along, diagonal, across = (g or s for g, s in zip(given, usual, strict=True))
        if symmetry == "tetragonal":
            across = along
        require_positive(stiffness_0=along, stiffness_45=diagonal, stiffness_90=across)
        objective = ProfileTarget(linear_profile(angles, along, diagonal, across))
    require_positive(edge_length=o["edge_length"], at_most=o["size"] / 5)
    coarse, own, fine = (
        tile(comm, o["size"], k * o["edge_length"], o["mesh"], symmetry) for k in (2, 1, 0.5)
    )
    return TileCase(own, angles, objective, symmetry, coarse, fine)


def run(comm: MPI.Comm, output: Path, *, verbose: bool = False, **inputs: Any) -> dict[str, Any]:
    """Design the tile; returns the summary.

    Args:
        comm: Communicator; its ranks share the directions.
        output: Folder for summary, history, profile, pattern, `tile.npz`, fields and pictures.
        verbose: Whether to print every step of the equilibrium solver.
        inputs: What differs from `DEFAULTS` and `toros_fem.tile_scene.TileConfig`.
    """
    begin = time.perf_counter()
    o = known_inputs(TileConfig(), DEFAULTS, inputs)
    settings = TileConfig(**{k: o[k] for k in TileConfig.__dataclass_fields__})
    wanted = scene(comm, o)
    target = wanted.objective if isinstance(wanted.objective, ProfileTarget) else None
    reporter = TileReporter(comm, output, target)
    done = design_tile(comm, wanted, settings, reporter, log=print_step(comm) if verbose else None)
    findings = measure_print(comm, wanted, settings, done)
    assert done.printed is not None
    made = PrintedTile(
        printed=done.printed.cells,
        size=(o["size"], o["size"]),
        symmetry=wanted.symmetry,
        **{k: o[k] for k in ("edge_length", "mesh", "fabric_young", "reinforcement_young",
                             "poisson", "thickness", "c1", "c2")},
    )  # fmt: skip
    return write_tile_design(comm, output, wanted, done, findings, made, o, begin)


def sentence(summary: dict[str, Any]) -> str:
    """The result in words."""
    worst, islands = summary["worst_percent"], summary["islands"]
    seconds = summary["seconds"]["total"]
    if summary["printed"] is None:
        return f"the print has no equilibrium: {summary['printed_failure']}; {seconds:.0f} s"
    stiffness = ", ".join(f"{s:.0f}" for s in summary["printed"]["stiffness_n_per_m"])
    off = "" if worst is None or not worst else f", at most {worst:.1f} % off what is asked"
    contraction = summary["printed"]["contraction"][0]
    angles = zip(summary["angles_deg"], summary["buckling"] or [], strict=False)
    leaning = ", ".join(f"{angle:.0f}°" for angle, buckles in angles if buckles)
    wrinkles = f"; kept flat: a free sheet buckles when pulled at {leaning}" if leaning else ""
    return (
        f"stiffness {stiffness} N/m as printed{off}; contraction {contraction:.2f} along x; "
        f"{islands} islands{wrinkles}; {seconds:.0f} s"
    )


if __name__ == "__main__":
    sys.exit(
        command_line(
            MPI.COMM_WORLD,
            __doc__,
            run,
            DEFAULTS,
            COARSE,
            Path("output/tile"),
            sentence,
            TileConfig(),
        )
    )
