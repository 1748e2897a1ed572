"""The top level of a checkout holds what is listed here, and tests leave nothing behind."""

import subprocess

import pytest
from helpers.scenes import ROOT
from helpers.top_level import files_on_disk

LISTED = {
    ".ci", ".gitignore", "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "COPYING",
    "COPYING.LESSER", "Makefile", "README.md", "benchmarks", "demos", "docs", "examples", "forms",
    "meshes", "packaging", "pyproject.toml", "scripts", "tests", "toros_fem",
}  # fmt: skip


def test_top_level_is_as_listed() -> None:
    """What .gitignore names may be there too: caches, builds and the output of runs."""
    assert files_on_disk() - {".git"} == LISTED


OUTPUT = ("output/", "benchmarks/output/")


def test_no_output_is_committed() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("not a checkout")
    done = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert [name for name in done.stdout.splitlines() if name.startswith(OUTPUT)] == []
