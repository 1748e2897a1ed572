"""Every scene of the demos in few steps: its figures, fields, drawings and files.

Figures and names of files are pinned, figures of the scenes in `ON_RANKS` on several ranks too.
What must hold of any run is checked by itself.
"""

from __future__ import annotations

import csv
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
import pytest
from helpers.scenes import shared
from kit.scene_runs import (
    AFTER_BEND,
    ALONE,
    SCENES,
    figures,
    heads,
    pinned_heads,
    run_scene,
    summary_of,
    value_of,
)
from mpi4py import MPI

from toros_fem.cli.commands.main import run

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("kept_meshes")]
ON_RANKS = ("bend", "contract", "inflate", "tile")
# Where friction holds feet once an emptied leg has snapped flat. In one step a phase rounding
# decides: the same print walked 14.3 and 17.5 mm with two builds of FEniCSx.
GAIT = re.compile(r"(stride|slip)_mm$")
SPACE = "{http://www.w3.org/2000/svg}"


@dataclass
class Run:
    """A finished run, and the commands that followed it, in folders beside it."""

    name: str
    folder: Path
    names: list[str]


@pytest.fixture(
    scope="module",
    params=[*SCENES, *ALONE],
)
def done(
    request: pytest.FixtureRequest,
    alone: MPI.Comm,
    few_pictures: None,
    kept_meshes: None,
    tmp_path_factory: pytest.TempPathFactory,
) -> Run:
    name, folder = request.param, tmp_path_factory.mktemp("runs")
    if name in SCENES:
        run_scene(alone, name, folder)
    commands = {name: ALONE[name]} if name in ALONE else AFTER_BEND if name == "bend" else {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for words in commands.values():
            assert run(alone, [*words, "--quiet"]) == 0
    return Run(name, folder, sorted({name, *commands} - {"view"}))


def test_figures(done: Run, pinned: Callable[..., None]) -> None:
    if done.name in SCENES:
        found = dict(figures(summary_of(done.folder / done.name)))
        walks = done.name == "walker"
        gait = {key: found.pop(key) for key in [*found] if walks and GAIT.search(key)}
        pinned(f"figures/{done.name}", found, rel=1e-4)
        if gait:
            pinned(f"figures/{done.name}_gait", gait, rel=0.5)
            with (done.folder / "walker" / "gait.csv").open(encoding="utf-8", newline="") as file:
                rows = [*csv.DictReader(file)][:-1]  # until the legs are emptied
            feet = [[float(v) for k, v in row.items() if k.startswith("foot_")] for row in rows]
            pinned("figures/walker_feet", {"feet_m": feet}, rel=1e-4)


@pytest.mark.parametrize("name", ON_RANKS)
def test_figures_on_ranks(
    comm: MPI.Comm, few_pictures: None, tmp_path: Path, name: str, pinned: Callable[..., None]
) -> None:
    if comm.size > 1:  # on one rank they are those of `test_figures`
        summary = run_scene(comm, name, shared(comm, tmp_path))
        assert summary["ranks"] == comm.size
        pinned(f"figures/{name}", dict(figures(summary)), rel=1e-4)


def test_files(done: Run, request: pytest.FixtureRequest) -> None:
    """Names of files, columns of tables, keys of JSON, names of arrays and fields."""
    found = {name: heads(done.folder / name) for name in done.names}
    known = pinned_heads(found if request.config.getoption("--write-pins") else None)
    for name in done.names:
        assert found[name] == known[name], found[name] ^ known[name]


def test_fields(done: Run) -> None:
    """Densities are shares, a print is all or nothing, and a closed skin holds its volume."""
    for path in done.folder.glob("*/skin.vtu"):
        mesh, summary = meshio.read(path), summary_of(path.parent)
        for field in set(mesh.cell_data) & {"rho", "rho_filtered", "rho_projected", "printed"}:
            values = mesh.cell_data[field][0]
            assert -1e-9 <= values.min() <= values.max() <= 1 + 1e-9
            assert field != "printed" or set(np.unique(values)) == {0.0, 1.0}
        a, b, c = np.moveaxis(mesh.points[mesh.cells_dict["triangle"]], 1, 0)
        volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
        if done.name != "unwrap":
            assert volume == pytest.approx(value_of(summary, "volume_m3"), rel=1e-6)


def test_drawings_are_true_to_scale(done: Run) -> None:
    """A unit is a millimetre, a print lies inside its panel, a panel on the page."""
    for path in done.folder.glob("*/pattern.svg"):
        root = ET.parse(path).getroot()
        box = np.array([float(number) for number in root.get("viewBox", "").split()])
        assert [root.get("width"), root.get("height")] == [f"{size:.3f}mm" for size in box[2:]]
        for group in root.iter(SPACE + "g"):
            corners = {}
            for shape in group.iter(SPACE + "path"):
                pairs = re.findall(r"-?[\d.]+,-?[\d.]+", shape.get("d", ""))
                corners[shape.get("class")] = np.array([p.split(",") for p in pairs], dtype=float)
            if corners.get("print", np.zeros(0)).size:
                low, high = corners["cut"].min(axis=0), corners["cut"].max(axis=0)
                assert np.all(corners["print"] >= low - 1e-3)
                assert np.all(corners["print"] <= high + 1e-3)
                assert np.all(high <= box[:2] + box[2:])


def test_a_simulation_finds_the_print_again(done: Run) -> None:
    """Along another path, from the files of a run."""
    if "simulate" in done.names:
        designed, again = (summary_of(done.folder / name) for name in ("bend", "simulate"))
        for key, off in (("angle_deg", 0.01), ("length_ratio", 1e-4)):
            assert value_of(again, key) == pytest.approx(value_of(designed, key), abs=off)
