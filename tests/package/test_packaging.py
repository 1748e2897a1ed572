"""Packaging: one version everywhere, pins of all that is asked for, a wheel."""

import os
import re
import subprocess
import sys
import tomllib
from datetime import date
from typing import Any

import pytest
from helpers.scenes import ROOT
from packaging.requirements import Requirement

import toros_fem

PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_version_is_the_same_everywhere() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    found = {
        "CITATION.cff": re.search(r"^version: (.+)$", citation, re.MULTILINE),
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


def test_every_package_is_pinned_within_its_bounds() -> None:
    """In one of the two locks: what a distribution brings along with FEniCSx is in its own."""
    pins: dict[str, dict[str, str]] = {}
    for name in ("fenicsx", "extras"):
        lines = (ROOT / "scripts" / "lock" / f"{name}.txt").read_text(encoding="utf-8").splitlines()
        pins[name] = dict(line.split("==") for line in lines if not line.startswith("#"))
    assert not pins["fenicsx"].keys() & pins["extras"].keys()
    groups = PROJECT["optional-dependencies"]
    for group, entries in {"": PROJECT["dependencies"], **groups}.items():
        for entry in map(Requirement, entries):
            version = (pins["fenicsx"] | pins["extras"])[entry.name]
            assert entry.specifier.contains(version), f"{entry} of {group!r}"
    assert {"numpy", "scipy", "mpi4py", "dolfinx-solver-real", "mpich"} <= pins["fenicsx"].keys()


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
