"""A pytest plugin that notes which tests run which of some lines: `-p kit.lines_run`.

The environment names the wanted lines (`LINES_WANTED`, a JSON file of paths and lines) and the
folder that takes what each process found (`LINES_FOUND`). Needs `sys.monitoring` of Python 3.12.
"""

from __future__ import annotations

import collections
import json
import os
import sys
from pathlib import Path
from types import CodeType
from typing import Any

import pytest

WATCH: Any = getattr(sys, "monitoring", None)
TOOL = 3
WANTED = {
    path: set(lines)
    for path, lines in json.loads(Path(os.environ["LINES_WANTED"]).read_text()).items()
}
seen: set[str] = set()
found: dict[str, dict[str, Any]] = collections.defaultdict(lambda: {"seconds": 0.0, "places": []})


def _line(code: CodeType, line: int) -> Any:
    lines = WANTED.get(code.co_filename)
    if lines is not None:
        seen.add(code.co_filename)
        if line in lines:
            seen.add(f"{code.co_filename}:{line}")
    return WATCH.DISABLE


def pytest_configure() -> None:
    WATCH.use_tool_id(TOOL, "lines_run")
    WATCH.register_callback(TOOL, WATCH.events.LINE, _line)
    WATCH.set_events(TOOL, WATCH.events.LINE)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Any:
    seen.clear()
    WATCH.restart_events()
    result = yield
    found[item.nodeid] |= {"places": sorted(seen), "comm": "comm" in item.fixturenames}  # type: ignore
    return result


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    found[report.nodeid]["seconds"] += report.duration
    if report.failed:
        found[report.nodeid]["failed"] = True


def pytest_sessionfinish() -> None:
    tests = {name: entry for name, entry in found.items() if entry["places"]}
    Path(os.environ["LINES_FOUND"], f"{os.getpid()}.json").write_text(json.dumps(tests))
