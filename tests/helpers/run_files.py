"""What a run leaves in its folder, but for times."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any


def content(folder: Path) -> tuple[list[dict[str, Any]], dict[str, Any], bytes]:
    """History and summary without times, and the drawing."""
    with (folder / "history.csv").open(encoding="utf-8") as file:
        rows = [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(file)]
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return rows, timeless(summary), (folder / "pattern.svg").read_bytes()


def timeless(value: Any) -> Any:
    """Return a value of JSON without its entries on times."""
    if isinstance(value, dict):
        return {k: timeless(v) for k, v in value.items() if "seconds" not in k}
    return [timeless(v) for v in value] if isinstance(value, list) else value
