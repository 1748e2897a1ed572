"""Short runs of every scene of the demos, and of the commands that follow a design."""

from __future__ import annotations

import csv
import json
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from helpers.command_runs import SMALL
from helpers.scenes import ROOT
from mpi4py import MPI

from kit.pin import GOLDEN, table_of
from toros_fem.cli.commands.main import run

STEPS = {
    "iterations": "1", "constrained_iterations": "1", "polish_iterations": "0",
    "corrections": "0", "estimate_error": "false", "curve_pressure": "none",
}  # fmt: skip
LINES = {
    "relaxed_edge_length": "8 mm", "relaxed_iterations": "2", "laid_width": "4 mm",
    "second_laid_width": "4 mm", "print_edge_length": "4 mm", "corrections": "0",
    "estimate_error": "false", "curve_pressure": "none",
}  # fmt: skip
# Command and changes of a short run of each scene in demos/scenes.
SCENES: dict[str, tuple[str, dict[str, str]]] = {
    "bend": (
        "design",
        {**SMALL, "estimate_error": "true", "pressure": "5 kPa", "hold_pressure": "true"},
    ),
    "contract": ("design", LINES),
    "twist": ("design", LINES),
    "bend_twist": ("design", LINES),
    "walker": (
        "design",
        {**STEPS, "levels": "1", "edge_length": "3.6 mm", "filter_radius": "5.5 mm",
         "gait_steps": "1"},
    ),
    "gripper": (
        "design",
        {**STEPS, "levels": "1", "edge_length": "3 mm", "filter_radius": "4.6 mm",
         "lift_distance": "10 mm", "estimate_error": "true"},
    ),
    "own_design": ("design", STEPS),
    "tile": (
        "design",
        {"edge_length": "0.8 mm", "filter_radius": "2 mm", "starts": "1", "trial_iterations": "1",
         "draft_iterations": "1", "finish_iterations": "1", "corrections": "0"},
    ),
    "inflate": ("simulate", {"edge_length": "5 mm", "levels": "4"}),
}  # fmt: skip


def changes_of(name: str) -> list[str]:
    """Return the options that make a scene's run short."""
    return [word for key, value in SCENES[name][1].items() for word in ("--set", f"{key}={value}")]


BEND = str(ROOT / "demos" / "scenes" / "bend.toml")
# Commands that look at the run of `bend` beside them, and those that need none.
AFTER_BEND: dict[str, list[str]] = {
    "simulate": ["simulate", BEND, "--output", "simulate", "--pattern", "bend",
                 *changes_of("bend")],
    "export": ["export", "bend", "--output", "export"],
    "tolerance": ["tolerance", "bend", "--output", "tolerance", "--modulus", "none",
                  "--thickness", "none"],
    "force": ["force", "bend", "--output", "force", "--steps", "2", "--without-intervals"],
    "view": ["view", "bend"],
}  # fmt: skip
ALONE: dict[str, list[str]] = {
    "fit": ["fit", str(ROOT / "examples" / "stockinette.csv"), "--thickness", "0.5 mm",
            "--output", "fit"],
    "fit_skin": ["fit", str(ROOT / "tests" / "data" / "inflated.csv"), "--scene",
                 str(ROOT / "demos" / "scenes" / "inflate.toml"), "--coarse",
                 "--output", "fit_skin"],
    "unwrap": ["unwrap", str(ROOT / "demos" / "surfaces" / "finger.stl"),
               "--output", "unwrap"],
}  # fmt: skip
# Folders, in the order of the table of their files.
NAMES = [name for name in (*SCENES, *AFTER_BEND, *ALONE) if name != "view"]
# Entries of a summary whose keys are those of a scene, of its panels, or of a drawing.
OPEN = ("inputs", "panels", "ends")
# Endings of the keys that are figures of a skin: those of machines and of rounds are none.
UNITS = re.compile(
    r"(_deg|_mm|_mm2|_percent|_pa|_kpa|_m|_m2|_m3|_n|_n_per_m|_kg|_ratio|_use|_fraction|_share"
    r"|objective_\w+|contraction)(: \d+)?$"
)


def run_scene(comm: MPI.Comm, name: str, folder: Path) -> dict[str, Any]:
    """Run a scene into folder/name and return its summary."""
    command, words = SCENES[name][0], changes_of(name)
    scene = str(ROOT / "demos" / "scenes" / f"{name}.toml")
    assert run(comm, [command, scene, "--output", str(folder / name), "--quiet", *words]) == 0
    comm.barrier()
    return summary_of(folder / name)


def summary_of(folder: Path) -> dict[str, Any]:
    """Return the summary that a run wrote."""
    return dict(json.loads((folder / "summary.json").read_text(encoding="utf-8")))


def value_of(summary: dict[str, Any], key: str) -> float | None:
    """Return the value of a figure of a summary."""
    found = {f"{row['name']}_{row['unit']}": row["value"] for row in summary["figures"]}
    return None if found[key] is None else float(found[key])


def figures(content: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield the figures of a summary with their places."""
    if isinstance(content, dict):
        for row in content.get("figures", ()):
            for word, of in (("", "value"), ("_target", "target"), ("_error", "interval")):
                yield from figures(row[of], f"{row['name']}{word}_{row['unit']}")
        for key, value in content.items():
            if key not in ("inputs", "curve", "trials", "figures"):
                yield from figures(value, f"{name}: {key}" if name else key)
    elif isinstance(content, list):
        for k, value in enumerate(content):
            yield from figures(value, f"{name}: {k}")
    elif isinstance(content, float) and UNITS.search(name):
        nothing = name.endswith("_mm") and abs(content) < 1e-3  # a skin that stays where it was
        yield name, 0.0 if nothing else content


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


def heads_of(path: Path) -> Iterator[str]:
    """Yield the names in a file."""
    if path.suffix == ".csv":
        with path.open(encoding="utf-8", newline="") as file:
            yield ", ".join(next(csv.reader(file)))
    elif path.suffix == ".json":
        yield from sorted(set(keys(json.loads(path.read_text(encoding="utf-8")))))
    elif path.suffix == ".npz" and path.parent.name != "state":
        with np.load(path, allow_pickle=False) as archive:
            header = json.loads(archive["header"].tobytes())
        yield from [*header["arrays"], *header["numbers"]]
    elif path.suffix == ".vtu":
        yield from re.findall(r'Name="([^"]+)"', path.read_bytes().decode("utf-8", "ignore"))


def heads(folder: Path) -> set[str]:
    """Return the files of a run and the names in each."""
    found = set()
    for path in folder.glob("**/*"):
        if path.is_file() and not path.name.startswith("."):
            # Numbers of steps, and the name that a skin has by its content.
            inside = path.relative_to(folder).as_posix()
            file = re.sub(r"(?<=skin-)[0-9a-f]+|\d{3,}", "N", inside)
            found |= {file, *(f"{file}: {head}" for head in heads_of(path))}
    return found


def pinned_heads(write: dict[str, set[str]] | None = None) -> dict[str, set[str]]:
    """Return what golden/file_heads.csv says of each run, after writing some anew."""
    path = GOLDEN / "file_heads.csv"
    known: dict[str, set[str]] = defaultdict(set)
    for head, runs in table_of(path).items():
        for name in runs.split(", "):
            known[name].add(head)
    if write:
        known |= write
        rows = sorted(set().union(*known.values()))
        lines = ((head, ", ".join(name for name in NAMES if head in known[name])) for head in rows)
        _write(path, lines)
    return known


def _write(path: Path, rows: Iterable[tuple[str, str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)
