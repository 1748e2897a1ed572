"""A report in a real browser: it draws, it reacts, it fetches nothing."""

from pathlib import Path

import numpy as np
import pytest
from helpers.browser import Page, opened
from helpers.runs import change_summary, tube, write_run

from toros_fem.results.report.page_file import write_report

pytestmark = [
    pytest.mark.slow,
]
DARK, FABRIC = np.array([31, 58, 95]), np.array([235, 223, 200])
ACCENT = np.array([213, 94, 0])


def near(picture: np.ndarray, colour: np.ndarray) -> float:
    """Return the part of the pixels that have a colour, in any light."""
    brightness = picture.sum(axis=2, keepdims=True) / colour.sum()
    close = np.abs(picture - brightness * colour).max(axis=2) < 12
    return float((close & (brightness[..., 0] > 0.5) & (brightness[..., 0] < 1.2)).mean())


def differ(one: np.ndarray, other: np.ndarray) -> float:
    """Return the part of the pixels that differ."""
    return float((np.abs(one - other).max(axis=2) > 8).mean())


def fits(page: Page) -> bool:
    return bool(page.run("return document.documentElement.scrollWidth <= window.innerWidth"))


def test_sliders_switches_and_colours_change_the_picture(run: Path) -> None:
    with opened(write_report(run)) as page:
        assert page.run("return document.documentElement.dataset.state") == "ready"
        first = page.picture()
        assert near(first, FABRIC) > 0.01, "the fabric is seen"
        assert near(first, DARK) > 0.01, "the print is seen"
        assert page.run("return document.getElementById('caption').textContent") == "5 kPa"
        page.slide("pressure", 0)
        low = page.picture()
        assert differ(first, low) > 0.02
        page.slide("iteration", 1)
        early = page.picture()
        page.slide("iteration", 11)
        late = page.picture()
        assert differ(early, late) > 0.02
        assert differ(early, low) > 0.005
        page.slide("pressure", 4)
        pictures = [page.picture()]
        for switch in ("#target", "#mesh", "input[value=stretch]", "input[value=distance]"):
            page.click(switch)
            pictures.append(page.picture())
            assert differ(pictures[-1], pictures[-2]) > 0.003, switch
        marks = page.run("return document.getElementById('bar-marks').innerText")
        assert "mm" in marks
        page.click("button[data-from='0,-0.001,1']")
        before = page.picture()
        assert differ(before, pictures[-1]) > 0.02
        turn(page)
        assert differ(before, page.picture()) > 0.02
        page.slide("iteration", 0)
        page.click("#slider-iteration + button")
        page.wait_for("return Number(document.getElementById('slider-iteration').value) > 0")
        assert page.complaints == []
        assert page.requests == [(run / "report.html").as_uri()]
        assert fits(page)


def turn(page: Page) -> None:
    """Drag the skin."""
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

    canvas = page.driver.find_element(By.ID, "canvas")
    ActionChains(page.driver).drag_and_drop_by_offset(canvas, 120, 30).perform()
    page.settle()


def test_a_narrow_window_shows_all(run: Path) -> None:
    with opened(write_report(run), 500, 900) as page:
        assert fits(page)
        assert near(page.picture(), FABRIC) > 0.01
        places = page.run(
            "return ['stage', 'controls', 'figures', 'pattern'].map("
            "id => document.getElementById(id).getBoundingClientRect().top)"
        )
        assert places == sorted(places), "one below the other"


def test_markup_in_names_and_messages_stays_text(run: Path) -> None:
    change_summary(run, printed_failure="<img src=x onerror=alert(1)></script>")
    odd = run.rename(run.parent / "<b>run & more")
    with opened(write_report(odd)) as page:
        assert page.run("return document.querySelector('h1').textContent") == "<b>run & more"
        assert page.run("return document.querySelectorAll('img').length") == 0
        assert "<img src=x" in page.run("return document.getElementById('warnings').innerText")
        assert page.complaints == []


def test_a_stopped_run_shows_its_design(run: Path) -> None:
    for name in ("summary.json", "curve.csv", "pattern.svg"):
        (run / name).unlink()
    for path in (run / "frames").glob("pressure-*"):
        path.unlink()
    with opened(write_report(run)) as page:
        assert near(page.picture(), FABRIC) > 0.01
        assert "stopped" in page.run("return document.getElementById('warnings').innerText")
        left_out = "return ['curve', 'pattern', 'inputs'].filter(id => document.getElementById(id))"
        assert page.run(left_out) == []
        assert page.complaints == []


def test_12_000_triangles_are_under_10_mb(tmp_path: Path) -> None:
    pattern = tube(1.28e-3)
    assert 11_000 < len(pattern.triangles) < 14_000
    # Noise of 20 µm: shapes of smooth functions would be compressed better than real ones.
    page = write_report(write_run(tmp_path / "fine", pattern, 61, 26, rough=2e-5))
    assert page.stat().st_size < 10e6
