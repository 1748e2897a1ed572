"""The published figures: what is compared, and that the documentation publishes the same."""

import json
import re

import headline
import pytest
from demo_runs import DEMOS
from helpers.scenes import ROOT

ENTRIES = json.loads(headline.FILE.read_text(encoding="utf-8"))
# The line of demos/README.md of each run, and how it writes the first figure.
ROWS = {
    "inflate": ("`inflate.py`", "radius 181 %"),
    "bend": ("`bend.py`", "180.8°"),
    "contract": ("`contract.py`", "8.1 %"),
    "twist": ("`twist.py`", "298.9°"),
    "bend_twist": ("`bend_twist.py`", "91.2° and 60.0°"),
    "walker": ("`walker.py`", "92.0°"),
    "walker_crawl": ("`walker.py --motion crawl`", "61.1° of 60°"),
    "gripper": ("`gripper.py`", "mean gap 1.5 mm"),
    "gripper_box": ("`gripper.py --shape box`", "gap 0.8 mm"),
}


def test_every_demo_under_pressure_has_an_entry() -> None:
    assert {entry["demo"] for entry in ENTRIES.values()} == set(DEMOS)
    for entry in ENTRIES.values():
        config = DEMOS[entry["demo"]].config.updated(**entry["inputs"])
        assert config.as_dict().items() >= entry["inputs"].items()


@pytest.mark.parametrize("name", list(ENTRIES))
def test_documentation_publishes_the_same(name: str) -> None:
    lines = (ROOT / "demos" / "README.md").read_text(encoding="utf-8").splitlines()
    script, shown = ROWS[name]
    (line,) = (line for line in lines if line.startswith(f"| {script}"))
    assert shown in line
    figures = ENTRIES[name]["long"]
    numbers = [float(n) for n in re.findall(r"[-+]?\d+\.?\d*", line)]
    for key, (published, _) in figures.items():
        if key.startswith(("load.", "gait.")):
            continue  # in the text below the table
        scale = {"growth_above_over_below": 100, "pressure_pa": 1e-3}.get(key, 1)
        assert published * scale in [pytest.approx(n) for n in numbers], key


def test_deviations_are_found() -> None:
    figures = {"angle_deg": [180.0, 2.0], "design.angle_deg": [170.0, 1.0], "islands": [0.0, 0.0]}
    near = {"angle_deg": 181.9, "design": {"angle_deg": 169.1}, "islands": 0}
    assert not any(row["deviates"] for row in headline.compare(figures, near))
    far = {"angle_deg": 182.1, "design": {"angle_deg": 168.9}, "islands": 1}
    assert all(row["deviates"] for row in headline.compare(figures, far))
    missing = {"angle_deg": None, "design": {"angle_deg": float("nan")}, "islands": 0}
    rows = headline.compare(figures, missing)
    assert [row["deviates"] for row in rows] == [True, True, False]
