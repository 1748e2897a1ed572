"""The benchmarks run from the command line and write their rows."""

import itertools
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import discovery
import pytest
from helpers.scenes import ROOT
from mpi4py import MPI

# Under mpirun a child process would act as one of its ranks.
ALONE = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts processes of its own")


def run(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(("OMPI_COMM", "PMIX", "PRTE"))
    }
    return subprocess.run(
        [sys.executable, str(ROOT / "benchmarks" / name), *arguments],
        env=environment,
        capture_output=True,
        text=True,
    )


def written(folder: Path, name: str, *arguments: str) -> tuple[Any, str]:
    """Return what a benchmark writes to `rows.json`, and what it prints."""
    file = folder / "rows.json"
    done = run(name, *arguments, "--json", str(file))
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(file.read_text(encoding="utf-8")), done.stdout


@pytest.mark.slow
@ALONE
@pytest.mark.parametrize("scene", ["half_tube", "tile_40", "pillow"])
def test_stability_of_one_scene(tmp_path: Path, scene: str) -> None:
    """Every case converges to an equilibrium that an independent check finds stable."""
    found, _ = written(
        tmp_path, "stability.py", "--quick", "--only", scene, "--output", str(tmp_path)
    )
    assert found["wrong"] == found["failed_although_solvable"] == 0
    assert len(found["rows"]) == 4
    for row in found["rows"]:
        assert set(row) == {
            "scene", "design", "contrast", "load", "start", "result", "reason",
            "newton_steps", "residual", "min_pivot_sign", "seconds",
        }  # fmt: skip
        assert row["scene"] == scene
        assert row["result"] == "converged"
        assert row["residual"] <= 1e-8
        assert row["min_pivot_sign"] == 1
        assert row["newton_steps"] > 0
    assert (tmp_path / "stability.png").stat().st_size > 10_000


@ALONE
def test_stability_is_taken_up_again(tmp_path: Path) -> None:
    """Drawn cases are kept; more of the same seed play only the new ones; the page gets tables."""
    page = tmp_path / "page.md"
    page.write_text("<!-- the matrix -->\n<!-- end of the matrix -->\n", encoding="utf-8")
    kept = ["--only", "tile", "--rows", str(tmp_path / "kept.jsonl"), "--output", str(tmp_path)]
    one, _ = written(tmp_path, "stability.py", *kept, "--cases", "1", "--seed", "3")
    two, _ = written(
        tmp_path,
        "stability.py",
        *kept,
        "--cases",
        "2",
        "--seed",
        "3",
        "--docs",
        "--page",
        str(page),
    )
    assert two["rows"][:1] == one["rows"], "seconds too: it was not played again"
    assert two["cases"] == 2
    assert two["bending"]["curvature"] == "midedge"
    assert "| all | 2 | 2 | 0 | 0 | 0 |" in page.read_text(encoding="utf-8")


@ALONE
def test_random_scenes_write_rows_and_tables(tmp_path: Path) -> None:
    found, printed = written(tmp_path, "random_scenes.py", "--scenes", "2", "--seed", "11")
    assert [row["seed"] for row in found["rows"]] == [11, 12]
    assert found["wrong"] == found["failed_although_solvable"] == 0
    assert "| all | 2 |" in printed


@pytest.mark.slow
@ALONE
def test_cost_of_a_newton_step(tmp_path: Path) -> None:
    rows, printed = written(tmp_path, "newton_cost.py", "--quick", "--rounds", "1")
    assert [(row["bending"], row["ranks"], row["threads"]) for row in rows] == [
        (True, 2, 1), (False, 1, 1), (False, 1, 2),
    ]  # fmt: skip
    for row in rows:
        assert set(row) == {
            "triangles", "dofs", "ranks", "threads", "bending", "assembly_s", "force_s",
            "factor_s", "solve_s", "step_s", "bare_factor_solve_s", "step_ratio", "assembly_ratio",
        }  # fmt: skip
        assert 800 < row["triangles"] < 1200
        # Positions of the vertices; with bending a rotation of each edge too.
        each = 3.0 if row["bending"] else 1.5
        assert row["dofs"] == pytest.approx(each * row["triangles"], rel=0.02)
        assert all(row[key] > 0 for key in row if key.endswith(("_s", "_ratio")))
    # Only the forms that a scene needs are compiled: energy, force, tangent; volume and load.
    assert "no bending             5 forms" in printed
    assert "neither                3 forms" in printed


@pytest.mark.slow
@ALONE
def test_scale_of_a_design(tmp_path: Path) -> None:
    """Each phase has its seconds, and the table a column for each size."""
    rows, printed = written(tmp_path, "scale.py", "--quick")
    assert [row["triangles"] for row in rows] == pytest.approx([1000, 3000], rel=0.05)
    phases = (
        "mesh_s", "setup_s", "analysis_s", "filter_s", "widths_s", "perimeter_s", "objective_s",
        "metrics_s", "mma_s", "energy_s", "force_s", "assembly_s", "factor_s", "solve_s",
        "sensitivity_s", "print_s", "files_s",
    )  # fmt: skip
    for row in rows:
        assert set(row) == {
            "triangles", "unknowns", "radius_mm", *phases, "setup_gib", "step_gib", "peak_gib",
            "pattern_bytes",
        }  # fmt: skip
        assert row["unknowns"] == pytest.approx(3 * row["triangles"], rel=0.05)
        assert all(row[name] > 0 for name in phases)
        assert 0 < row["setup_gib"] <= row["step_gib"] <= row["peak_gib"] < 1
        assert 200 < row["pattern_bytes"] < 1000
    (fine,) = (line for line in printed.splitlines() if line.startswith("| unknowns |"))
    assert fine.count("|") == 5


@pytest.mark.slow
@ALONE
def test_whole_designs(tmp_path: Path) -> None:
    """Both ways end in a printed pattern; the documentation is written from their rows."""
    found, printed = written(tmp_path, "design_loop.py", "--quick")
    rows = found["rows"]
    assert [(row["way"], row["levels"]) for row in rows] == [("levels", 2), ("before", 1)]
    for row in rows:
        assert set(row) >= {
            "case", "scene", "triangles", "radius_mm", "ranks", "threads", "levels", "seconds",
            "steps", "rejected", "factorisations", "median_factorisations", "mean_factorisations",
            "newton_steps", "gradient_over_forward", "peak_gib", "printed", "asked",
            "printed_objective", "history",
        }  # fmt: skip
        assert (row["scene"], row["ranks"], row["threads"]) == ("bend", 1, 1)
        assert row["triangles"] == pytest.approx(4400, rel=0.05)
        assert row["asked"] == {"angle_deg": 60.0}
        assert row["printed"]["angle_deg"] > 30
        in_steps = row["finest_steps"] * row["mean_factorisations"]
        assert row["factorisations"] >= row["finest_factorisations"] > in_steps > 0
        assert 0 < row["gradient_over_forward"] < 1
        assert 0.1 < row["peak_gib"] < 2
        seconds, _, level = zip(*row["history"], strict=True)
        assert sorted(seconds) == list(seconds)
        assert seconds[-1] <= row["seconds"]
        assert sorted(set(level)) == list(range(row["levels"]))
    assert [row["parts_by_symmetry"] for row in rows] == [2, 1]
    assert rows[0]["finest_steps"] < rows[0]["steps"]
    assert rows[1]["finest_steps"] == rows[1]["steps"]
    assert "bend_quick, before" in printed
    # --quick has a case of its own.
    assert run("design_loop.py", "--quick", "--only", "twist").returncode == 2
    done = run("design_loop.py", "--report", str(tmp_path / "rows.json"), "--docs", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "performance.png").stat().st_size > 10_000
    assert "bend, R = 2.6 mm" in (tmp_path / "performance.md").read_text(encoding="utf-8")


@pytest.mark.slow
@ALONE
def test_discovery_from_a_random_start(tmp_path: Path) -> None:
    """All stages of a run; a known run is not repeated; the tables go into a page."""
    found, printed = written(tmp_path, "discovery.py", "--quick")
    (row,) = found["rows"]
    assert row["task"] == {
        "scene": "contract", "seed": 0, "size": "quick", "start": None, "ranks": 1, "threads": 2
    }  # fmt: skip
    for stage in discovery.STAGES:
        if row[stage] is not None:
            assert set(row[stage]) == {"shortening_percent", "twist_deg", "length_ratio"}
    length = 1 - row["printed"]["shortening_percent"] / 100
    assert row["printed"]["length_ratio"] == pytest.approx(length)
    assert "**shorten by 8 % at 10 kPa** (quick)" in printed
    again, _ = written(tmp_path, "discovery.py", "--quick")
    assert again == found, "it is not run again"
    page = tmp_path / "page.md"
    page.write_text(f"{discovery.BEGIN}\n{discovery.END}\n", encoding="utf-8")
    file = tmp_path / "rows.json"
    done = run("discovery.py", "--from", str(file), "--docs", "--page", str(page))
    assert done.returncode == 0, done.stderr
    assert discovery.tables(found["rows"]) in page.read_text(encoding="utf-8")


@pytest.mark.slow
@ALONE
def test_mma_beside_other_codes(tmp_path: Path) -> None:
    """Ours, mmapy and pyMOTO take the same step to the same point."""
    rows, _ = written(tmp_path, "mma.py", "--quick", "--rounds", "1")
    assert [(row["constraints"], row["code"]) for row in rows] == [
        (m, code) for m in (1, 2, 5) for code in ("toros_fem", "mmapy", "pymoto")
    ]
    for row in rows:
        assert set(row) == {
            "variables", "constraints", "code", "seconds", "ratio_to_fastest_peer",
        }  # fmt: skip
        assert row["variables"] == 2000
        assert row["seconds"] > 0
    for first in (0, 3, 6):
        ours, *peers = rows[first : first + 3]
        fastest = min(row["seconds"] for row in peers)
        for row in (ours, *peers):
            assert row["ratio_to_fastest_peer"] == pytest.approx(row["seconds"] / fastest)


@pytest.mark.slow
@ALONE
def test_length_scale_of_lines(tmp_path: Path) -> None:
    """With the default c thin lines have far larger values than wide ones, at any alignment."""
    rows, _ = written(tmp_path, "length_scale.py", "--quick")
    studies = {name: [row for row in rows if row["study"] == name]
               for name in ("widths", "constants", "perimeter")}  # fmt: skip
    assert {row["filter"] for row in studies["widths"]} == {"cone", "helmholtz"}
    checked = 0
    for row in studies["widths"]:
        thin = row["width_over_requested"] == 0.85
        if thin and row["filter"] == "cone" and row["c_over_R2"] > 16:
            (wide,) = (
                other
                for other in studies["widths"]
                if other["width_over_requested"] == 1.15
                and all(
                    other[key] == row[key] for key in ("filter", "radius_over_edge", "c_over_R2")
                )
            )
            assert row["least"] > 20 * wide["largest"]
            checked += 1
    assert checked == 6
    # Our constants detect lines of 0.85 of the width and pass those of 1.15; the paper's pass all.
    assert len(studies["constants"]) == 16
    for row in studies["constants"]:
        if row["constants"] == "paper":
            assert row["epsilon"] == 1e-3
            assert row["largest"] < 1
        elif row["width_over_requested"] < 1:
            assert row["least"] > 5
        else:
            assert row["largest"] < 0.2
    # Our perimeter is the length of the border; the paper's sum grows with the mesh.
    sums = [row["papers_sum"] for row in studies["perimeter"]]
    for coarse, fine in itertools.pairwise(sums):
        assert fine == pytest.approx(4 * coarse, rel=0.05)
    for row in studies["perimeter"]:
        assert row["ratio_to_length"] == pytest.approx(1, abs=0.03)


@pytest.mark.slow
@ALONE
def test_profiles_of_tiles_converge(tmp_path: Path) -> None:
    """Stripes are exact on every mesh; of lines on mesh lines each refinement halves the error."""
    rows, _ = written(tmp_path, "tiles.py", "--quick")
    assert [(row["pattern"], row["edges"]) for row in rows] == [
        (pattern, edges) for pattern in ("stripes", "lines", "rings") for edges in (10, 20, 40)
    ]
    stripes = [row["stiffness_n_per_m"] for row in rows[:3]]
    for coarse, fine in itertools.pairwise(stripes):
        assert coarse == pytest.approx(fine, rel=1e-9)
    for coarse, fine in itertools.pairwise(rows[3:6]):
        for before, after in zip(coarse["error"], fine["error"], strict=True):
            assert 0 < after < 0.6 * before
    for row in rows:
        assert row["steps"] > row["steps_near"] > 0


@pytest.mark.slow
@ALONE
def test_paths_through_limit_points(tmp_path: Path) -> None:
    """The roof snaps at the published load, the tube bulges as its closed form, the lid pops."""
    picture = tmp_path / "paths.png"
    found, _ = written(tmp_path, "limit_points.py", "--quick", "--picture", str(picture))
    thick, thin = found["roof"]
    assert thick["largest_error_of_load"] < 0.05
    assert len(thick["limits"]) == len(thin["limits"]) == 2
    assert thick["limits"][0] == pytest.approx(0.743, rel=0.02)
    assert thin["limits"][1] < 0
    (tube,) = found["tube"]
    assert 0 < tube["limit_error"] < 0.01
    assert tube["largest_error_of_bulge"] < 0.005
    assert min(tube["load_factor"][-5:]) == 1.2
    (lid,) = found["lid"]
    pops, stays = lid["limits"]
    assert stays < 0 < pops
    assert max(lid["negative_eigenvalues"]) > 0 == lid["negative_eigenvalues"][-1]
    assert picture.stat().st_size > 10_000


@pytest.mark.slow
@ALONE
def test_crossed_lines_beside_the_relaxed_material(tmp_path: Path) -> None:
    """The relaxed material is near simulated nets, and exact for one family of stiff lines."""
    picture = tmp_path / "lines.png"
    found, _ = written(tmp_path, "crossed_lines.py", "--quick", "--picture", str(picture))
    assert list(found) == ["nets", "widths", "one_family", "fits", "width_fit", "pulls"]
    assert [row["angle_deg"] for row in found["nets"]] == [30, 45]
    for row in found["nets"]:
        coarse, middle, fine = row["factors"]
        assert coarse > middle > fine > row["factor"] > 1 / 0.6
        assert abs(row["error"]) < 0.12
        assert max(map(abs, row["moduli_errors"])) < 0.12
    assert 1 < found["width_fit"]["exponent"] < 2
    (wide,) = found["widths"]
    assert wide["width_ratio"] == 2
    assert wide["factor"] < 0.8 * found["nets"][1]["factor"], "wide and thin lines stiffen less"
    assert abs(wide["error"]) < 0.05
    # Where the print is not rigid, its own shear in the net's soft mode is 1/260 of the fabric's.
    (one,) = found["one_family"]
    exact = 1 / (0.8 + 0.2 / 260)
    assert one["factors"] == pytest.approx(3 * [exact], rel=1e-4)
    fits = {row["power"]: row for row in found["fits"]}
    assert list(fits) == [2, 3, 4, 5, 6]
    assert fits[4]["rms"] < fits[2]["rms"] / 2
    assert 0.6 < fits[4]["crossing"] < 0.85
    (pull,) = found["pulls"]
    assert abs(pull["stress_error"]) < 0.1
    assert pull["relaxed_contraction"] == pytest.approx(pull["contraction"], abs=0.02)
    assert picture.stat().st_size > 10_000


@pytest.mark.slow
@ALONE
def test_accuracy_writes_rows_and_pictures(tmp_path: Path) -> None:
    rows, _ = written(
        tmp_path, "accuracy.py", "--quick", "--case", "uniaxial-stress",
        "--case", "pulled-cylinder", "--output", str(tmp_path),
    )  # fmt: skip
    for row in rows:
        assert set(row) == {
            "case", "formulation", "mesh", "triangles", "value", "reference", "relative_error",
            "observed_order", "seconds",
        }  # fmt: skip
        gap = abs(row["value"] - row["reference"]) / row["reference"]
        assert row["relative_error"] == pytest.approx(gap)
    assert {row["case"] for row in rows} == {"uniaxial-stress", "pulled-cylinder"}
    assert {row["formulation"] for row in rows} == {"membrane", "average", "quadratic", "midedge"}
    assert (tmp_path / "pulled-cylinder.png").stat().st_size > 10_000
    file = tmp_path / "rows.json"
    again = run("accuracy.py", "--from", str(file), "--output", str(tmp_path / "again"))
    assert again.returncode == 0, again.stderr
    assert (tmp_path / "again" / "pulled-cylinder.png").exists()
    unknown = run("accuracy.py", "--case", "nothing")
    assert unknown.returncode == 2
    part = run("accuracy.py", "--from", str(file), "--output", str(tmp_path / "again"), "--docs")
    assert part.returncode == 2
    assert "lacks some" in part.stderr


@pytest.mark.slow
@ALONE
def test_contact_of_one_scene(tmp_path: Path) -> None:
    """With contact nothing is penetrated; without it something is."""
    found, text = written(tmp_path, "contact.py", "--quick", "--only", "pressed tube")
    (row,) = found["rows"]
    assert set(row) >= {
        "scene", "triangles", "pairs", "seconds_with", "seconds_without", "steps",
        "smallest_distance_mm", "penetrated",
    }  # fmt: skip
    assert row["penetrated_without"]
    assert not row["penetrated"]
    assert found["penetrated"] == 0
    assert row["pairs"] > 0
    assert 0 < row["smallest_distance_mm"] < 0.25
    assert "| pressed tube |" in text


@pytest.mark.slow
@ALONE
def test_random_contacts(tmp_path: Path) -> None:
    found, _ = written(tmp_path, "contact.py", "--random", "3", "--seed", "11")
    assert [row["seed"] for row in found["rows"]] == [11, 12, 13]
    assert found["penetrated"] == 0
    assert any(row["pairs"] for row in found["rows"])
