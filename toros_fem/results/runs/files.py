"""The files of a run, by the one table that says what each holds."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from importlib import resources

# Folder of the state inside that of a run, its record, the text of the scene, and the figures.
STATE, RECORD, SCENE, SUMMARY = "state", "run.json", "scene.toml", "summary.json"

_TABLE = resources.files("toros_fem.results").joinpath("files.csv").read_text(encoding="utf-8")
# What each file holds, in the order of lists; of a folder what is in it, or the file to open.
FILES: Mapping[str, str] = {
    row["file"]: row["what it holds"] for row in csv.DictReader(_TABLE.splitlines())
}
