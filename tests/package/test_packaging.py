"""Packaging: one version everywhere, a recipe that asks for what the package needs, a wheel."""

import os
import re
import subprocess
import sys
import tomllib
from datetime import date
from typing import Any

import pytest
from helpers.scenes import ROOT

import toros_fem

PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
RECIPE = (ROOT / "packaging" / "recipe.yaml").read_text(encoding="utf-8")
# Packages that conda-forge has by another name.
CONDA_NAMES = {"matplotlib": "matplotlib-base"}


def required() -> dict[str, str]:
    """Packages that the recipe needs to run, with their bounds."""
    listed = re.search(r"^  run:\n((?:    - .*\n)+)", RECIPE, re.MULTILINE)
    entries = [line.split("#")[0].strip(" -") for line in listed[1].splitlines()]
    return {name: bounds.strip() for name, _, bounds in (entry.partition(" ") for entry in entries)}


def test_version_is_the_same_everywhere() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    found = {
        "CITATION.cff": re.search(r"^version: (.+)$", citation, re.MULTILINE),
        "recipe.yaml": re.search(r'^  version: "(.+)"$', RECIPE, re.MULTILINE),
        "CHANGELOG.md": re.search(r"^## (\S+) \(", changelog, re.MULTILINE),
    }
    assert {name: match and match[1] for name, match in found.items()} == dict.fromkeys(
        found, toros_fem.__version__
    )


def test_changelog_and_citation_agree_on_the_day_of_a_release() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    heading = re.search(r"^## \S+ \((.+)\)$", changelog, re.MULTILINE)
    released = re.search(r"^date-released: (.+)$", citation, re.MULTILINE)
    if heading[1] == "unreleased":
        assert released is None
    else:
        assert date.fromisoformat(heading[1]) == date.fromisoformat(released[1])


def test_recipe_needs_what_the_package_needs() -> None:
    run = required()
    for entry in PROJECT["dependencies"] + PROJECT["optional-dependencies"]["plot"]:
        match = re.fullmatch(r"([\w-]+)(.*)", entry)
        name = CONDA_NAMES.get(match[1], match[1])
        assert run[name] == match[2], entry
    assert {"fenics-dolfinx", "petsc4py", "python-gmsh"} <= run.keys()
    for name, target in PROJECT["scripts"].items():
        assert f"- {name} = {target}\n" in RECIPE


@pytest.mark.slow
def test_wheel_works_where_nothing_else_is() -> None:
    """Source archive, wheel from it, import, a solve, and the command `toros`."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMIX"))}
    done = subprocess.run(
        [sys.executable, ROOT / "packaging" / "check_wheel.py"], env=environment, text=True,
        capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "times its radius" in done.stdout
