"""A small design by the command line, shared by the tests of the commands."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.commands.main import run

# Half a short tube of some 200 triangles that bends a little, without what only takes time.
SMALL = {
    "length": "6 cm",
    "edge_length": "5 mm",
    "filter_radius": "8 mm",
    "angle": "45",
    "levels": "1",
    "iterations": "2",
    "constrained_iterations": "1",
    "corrections": "0",
    "polish_iterations": "0",
    "estimate_error": "false",
    "curve_steps": "2",
    "curve_pressure": "10 kPa",
}


def changes(**others: str) -> list[str]:
    """Options that make a scene small."""
    values = {**SMALL, **others}
    return [word for key, value in values.items() for word in ("--set", f"{key}={value}")]


def small_scene(comm: MPI.Comm, folder: Path) -> Path:
    """A new scene file in a folder."""
    path = folder / "small.toml"
    assert run(comm, ["new", "bend", str(path), "--force"]) == 0
    return path
