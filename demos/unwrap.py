"""Your own surface as a sewing pattern: read, repaired, cut, laid flat.

    python demos/unwrap.py my.stl --scale 1e-3
    python demos/unwrap.py my.msh --method lscm --max-stretch 0.1 --output output/my

The file is an STL, OBJ, PLY, MSH or XDMF triangle mesh. Line elements in it and the borders between
its groups of triangles become seams. Without them the seams are found: along creases, and wherever
a panel would be stretched too far. The demo prints how far the panels are from the surface. It
writes the pattern, which scenes read (pattern.npz), a drawing in true scale (pattern.svg), a
picture (unwrap.png) and fields for ParaView (surface.vtu). Without a file it unwraps a capsule.
`toros unwrap` does the same.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.cli.command_line.scripts import run_from_command_line
from toros_fem.cli.commands.unwrap import UnwrapConfig, unwrap_sentence, unwrap_surface
from toros_fem.meshes import Surface, read_surface


def capsule(around: int = 36, radius: float = 0.02, length: float = 0.06) -> Surface:
    """Return a closed tube along z with round ends."""
    quarter = np.linspace(0, np.pi / 2, around // 4 + 1)[1:]
    rows = round(length / (2 * np.pi * radius / around))
    r = radius * np.concatenate([np.sin(quarter), np.ones(rows - 1), np.sin(quarter[::-1])])
    z = np.concatenate([-radius * np.cos(quarter), length * np.arange(1, rows) / rows,
                        length + radius * np.cos(quarter[::-1])])  # fmt: skip
    turn = 2 * np.pi * np.arange(around) / around
    rings = np.stack([np.outer(r, np.cos(turn)), np.outer(r, np.sin(turn)),
                      np.repeat(z[:, None], around, axis=1)], axis=2)  # fmt: skip
    count = len(r) * around
    node = np.arange(count).reshape(-1, around)
    a, b = node[:-1], np.roll(node[:-1], -1, axis=1)
    c, d = node[1:], np.roll(node[1:], -1, axis=1)
    first, last = node[0], node[-1]
    triangles = np.concatenate([
        np.stack([a, b, c], axis=2).reshape(-1, 3), np.stack([b, d, c], axis=2).reshape(-1, 3),
        np.stack([np.roll(first, -1), first, np.full(around, count)], axis=1),
        np.stack([last, np.roll(last, -1), np.full(around, count + 1)], axis=1),
    ])  # fmt: skip
    poles = [[0, 0, -radius], [0, 0, length + radius]]
    return Surface(np.vstack([rings.reshape(-1, 3), poles]), triangles)


def run(
    comm: MPI.Comm,
    output: Path,
    config: UnwrapConfig,
    *,
    file: Path | None = None,
    verbose: bool = False,
) -> dict[str, Any]:
    """Unwrap a surface, and return the summary that is also written to `output`.

    Args:
        comm: Communicator.
        output: Folder for pattern, picture, fields and summary.
        config: How the surface is read, cut and laid flat.
        file: The mesh file; None takes a capsule.
        verbose: Whether to print the distortion of each panel.
    """
    surface = (
        capsule() if file is None else read_surface(comm, file, config.scale, config.component)
    )
    return unwrap_surface(comm, output, surface, config, file=file, verbose=verbose)


def main(comm: MPI.Comm) -> int:
    """Run with the values that the command line gives; return the exit code."""
    return run_from_command_line(
        comm,
        __doc__ or "",
        UnwrapConfig(),
        run,
        Path("output/unwrap"),
        sentence=unwrap_sentence,
        arguments={"file": "triangle mesh; none: a capsule"},
    )


if __name__ == "__main__":
    sys.exit(main(MPI.COMM_WORLD))
