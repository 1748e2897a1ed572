"""What runs write: their files, and what stands in each, by the runs that have it."""

from __future__ import annotations

import csv
import json
import re
from collections import defaultdict
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
import pytest
from helpers.command_runs import SMALL
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.cli.commands.main import run

# Two ranks write the same, and take minutes for it.
pytestmark = [pytest.mark.slow]

ALONE = MPI.COMM_SELF
STEPS = {
    "iterations": "1", "constrained_iterations": "1", "polish_iterations": "0",
    "corrections": "0", "estimate_error": "false", "curve_pressure": "none", "levels": "1",
}  # fmt: skip
# Command and changes of a short run of each kind of scene. Bending and twisting at once writes
# what shortening does, and a mesh of one's own what bending does.
SCENES: dict[str, tuple[str, dict[str, str]]] = {
    "bend": ("design", {**SMALL, "estimate_error": "true"}),
    "contract": (
        "design",
        {
            "relaxed_edge_length": "6 mm", "relaxed_iterations": "3", "laid_width": "3 mm",
            "second_laid_width": "3 mm", "print_edge_length": "3 mm", "corrections": "0",
            "estimate_error": "false", "curve_pressure": "none",
        },
    ),
    "walker": (
        "design",
        {**STEPS, "edge_length": "3.6 mm", "filter_radius": "5.5 mm", "gait_steps": "1"},
    ),
    "gripper": (
        "design",
        {**STEPS, "edge_length": "3 mm", "filter_radius": "4.6 mm", "lift_distance": "10 mm"},
    ),
    "tile": (
        "design",
        {
            "edge_length": "0.8 mm", "filter_radius": "2 mm", "starts": "1",
            "trial_iterations": "1", "draft_iterations": "1", "finish_iterations": "1",
            "corrections": "0",
        },
    ),
    "inflate": ("simulate", {"edge_length": "5 mm", "levels": "4"}),
    "tile-sheet": (
        "simulate",
        {"along": "3", "across": "1", "strain_steps": "2", "edge_length": "0.7143 mm"},
    ),
}  # fmt: skip
# Further commands, with what a run of `bend` left.
OTHERS: dict[str, list[str]] = {
    "simulate": ["simulate", "bend/scene.toml", "--pattern", "bend", "--output", "simulate"],
    "export": ["export", "bend", "--output", "export"],
    "tolerance": ["tolerance", "bend", "--output", "tolerance", "--modulus", "none"],
    "fit": ["fit", str(ROOT / "examples" / "stockinette.csv"), "--thickness", "0.5 mm",
            "--intervals", "hessian", "--output", "fit"],
    "unwrap": ["unwrap", str(ROOT / "demos" / "surfaces" / "finger.stl"), "--scale", "1e-3",
               "--output", "unwrap"],
}  # fmt: skip
# Entries of a summary whose keys are those of a scene, of its panels, or of a drawing.
OPEN = ("inputs", "panels", "ends")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Generator[Path]:
    """A folder with a folder for each run; pictures are empty files."""
    folder = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(
            matplotlib.figure.Figure, "savefig", lambda self, path, **how: Path(path).touch()
        )
        for kind, (command, values) in SCENES.items():
            assert run(ALONE, ["new", kind, f"{kind}.toml", "--quiet"]) == 0
            words = [word for key, value in values.items() for word in ("--set", f"{key}={value}")]
            assert run(ALONE, [command, f"{kind}.toml", "--output", kind, "--quiet", *words]) == 0
        for words in OTHERS.values():
            assert run(ALONE, [*words, "--quiet"]) == 0
        assert run(ALONE, ["view", "bend", "--quiet"]) == 0
        yield folder


def keys(content: Any, name: str = "") -> Iterator[str]:
    """Yield the keys of JSON, with dots; entries of lists are taken together."""
    if isinstance(content, dict) and name.rpartition(".")[2] not in OPEN:
        for key, value in content.items():
            yield from keys(value, f"{name}.{key}" if name else key)
    elif isinstance(content, list) and content:
        for value in content:
            yield from keys(value, name)
    else:
        yield name


def heads(path: Path) -> Iterator[str]:
    """Yield the names in a file."""
    if path.suffix == ".csv":
        with path.open(encoding="utf-8", newline="") as file:
            yield ", ".join(next(csv.reader(file)))
    elif path.suffix == ".json":
        yield from sorted(set(keys(json.loads(path.read_text(encoding="utf-8")))))
    elif path.suffix == ".npz" and path.parent.name != "state":
        yield from np.load(path, allow_pickle=False).files
    elif path.suffix == ".vtu":
        yield from re.findall(r'Name="([^"]+)"', path.read_bytes().decode("utf-8", "ignore"))


def test_file_heads(runs: Path, pinned: Callable[..., None]) -> None:
    """Columns of tables, keys of JSON, names of arrays and fields."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in runs.glob("*/**/*"):
        if not path.is_file() or path.name.startswith("."):
            continue
        name, *inside = path.relative_to(runs).parts
        # Numbers of steps, and the name that a skin has by its content.
        file = re.sub(r"(?<=skin-)[0-9a-f]+|\d{3,}", "N", "/".join(inside))
        found[file].add(name)
        for head in heads(path):
            found[f"{file}: {head}"].add(name)
    order = [*SCENES, *OTHERS].index
    pinned(
        "file_heads",
        {key: ", ".join(sorted(where, key=order)) for key, where in sorted(found.items())},
    )
