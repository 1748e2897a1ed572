"""A report in a real browser: it draws, it reacts, it fetches nothing."""

from pathlib import Path

import numpy as np
import pytest
from helpers.browser import Page, opened
from helpers.runs import change_summary, regions_of, tube, write_run

from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.meshes import Pattern
from toros_fem.results.report.page_file import read_summary, write_report
from toros_fem.results.runs.frames import Frame, ShownSkin, write_frame, write_skin

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


def painted(picture: np.ndarray, colour: np.ndarray) -> float:
    """Return the part of the pixels that have a colour, which no light changes."""
    return float((np.abs(picture - colour).max(axis=2) < 30).mean())


def fits(page: Page) -> bool:
    return bool(page.run("return document.documentElement.scrollWidth <= window.innerWidth"))


def test_sliders_switches_and_colours_change_the_picture(run: Path) -> None:
    with opened(write_report(run)) as page:
        assert page.run("return document.documentElement.dataset.state") == "ready"
        first = page.picture()
        assert near(first, FABRIC) > 0.01, "the fabric is seen"
        assert painted(first, ACCENT) > 1e-3, "the target's outline is seen at the start"
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


def test_a_lone_chart_is_no_wider_than_two(run: Path) -> None:
    """Its letters would be giant."""
    (run / "history.csv").unlink()
    with opened(write_report(run)) as page:
        widths = page.run(
            "return [...document.querySelectorAll('svg.chart')].map(x => x.clientWidth)"
        )
        assert len(widths) == 1
        assert widths[0] <= 700


def test_a_narrow_dark_window_shows_all(run: Path) -> None:
    """Letters stand out from what they are written on, those of the charts too."""
    with opened(write_report(run), 500, 900, dark=True) as page:
        assert fits(page)
        assert near(page.picture(), FABRIC) > 0.01
        for place in ("#figures th", "svg.chart text", "#caption"):
            ink = page.colour(place, "fill" if "svg" in place else "color")
            assert page.colour("section", "background-color").max() < 60
            assert ink.min() > 130, place
        places = page.run(
            "return ['stage', 'controls', 'figures', 'pattern'].map("
            "id => document.getElementById(id).getBoundingClientRect().top)"
        )
        assert places == sorted(places), "one below the other"


EVIL = "<img src=x onerror=alert(1)></script><script>document.title = 'mine'</script>"


def test_markup_in_names_and_messages_stays_text(tmp_path: Path, pattern: Pattern) -> None:
    """Names of panels, of charts and of the folder, messages and files that a run brings along."""
    odd = write_run(tmp_path / "<b>run & {{ 7 * 7 }}", pattern, panel=EVIL.replace("/", "|"))
    measured = {"metric": "angle_deg", "pressure_pa": 8e3, "measured": 70.0, "source": EVIL}
    change_summary(odd, warnings=[EVIL], inputs={EVIL: EVIL}, curve={"measured": [measured]})
    svg = odd / "pattern.svg"
    svg.write_text(svg.read_text("utf-8").replace("</svg>", f"{EVIL}</svg>"), encoding="utf-8")
    with opened(write_report(odd)) as page:
        assert page.run("return document.querySelector('h1').textContent") == odd.name
        assert page.run("return document.title") == f"{odd.name} – toros_fem"
        assert page.run("return document.querySelectorAll('img').length") == 0
        assert page.run("return document.querySelectorAll('script').length") == 4
        assert EVIL in page.run("return document.getElementById('warnings').innerText")
        assert EVIL in page.run("return document.getElementById('curve').textContent")
        assert "onerror" in page.run("return document.querySelector('svg.flat title').textContent")
        assert page.complaints == []


def test_no_script_but_the_page_s_own_runs(run: Path) -> None:
    """Where a name gets past the template, the page's policy forbids it."""
    path = write_report(run)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("<main>", f"<main>{EVIL}"), encoding="utf-8")
    with opened(path) as page:
        assert page.run("return document.title") == "run – toros_fem"
        assert any("Content Security Policy" in said for said in page.complaints)
        assert page.run("return document.documentElement.dataset.state") == "ready"


def test_a_ground_and_objects_are_seen(run: Path, pattern: Pattern) -> None:
    frames = run / "frames"
    ball = rigid_sphere("ball", 0.02, (0.1, 0.0, 0.02))
    lowest = [[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]
    skin = ShownSkin(
        pattern, regions=regions_of(pattern), body=(ball.points, ball.triangles),
        grounds=np.array(lowest),
    )  # fmt: skip
    write_frame(frames, Frame("load", 0, write_skin(frames, skin), pattern.points, None, {}))
    with opened(write_report(run)) as page:
        page.click("#slider-load + button")
        with_both = page.picture()
        page.click("#body")
        assert differ(with_both, page.picture()) > 0.05
        assert near(with_both, np.array([154, 165, 177])) > 0.01
        assert page.complaints == []


def test_a_notebook_shows_the_view_in_a_frame(run: Path) -> None:
    """The page in the frame runs its own scripts, and no more."""
    view = read_summary(run).show(height=500)
    notebook = run / "notebook.html"
    ready = "<script>document.documentElement.dataset.state = 'ready'</script>"
    notebook.write_text(f"<html><body>{view._repr_html_()}{ready}</body></html>", encoding="utf-8")
    with opened(notebook) as page:
        frame = page.driver.find_element("tag name", "iframe")
        assert frame.size["height"] == 500
        page.driver.switch_to.frame(frame)
        page.wait_for("return document.documentElement.dataset.state === 'ready'")
        assert near(page.picture(), FABRIC) > 0.01
        assert page.run("return document.querySelectorAll('header, #figures').length") == 0
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


def test_12_000_triangles_are_shown_and_under_10_mb(tmp_path: Path) -> None:
    pattern = tube(1.28e-3)
    assert 11_000 < len(pattern.triangles) < 14_000
    # Noise of 20 µm: shapes of smooth functions would be compressed better than real ones.
    path = write_report(write_run(tmp_path / "fine", pattern, 61, 26, rough=2e-5))
    assert path.stat().st_size < 10e6
    with opened(path) as page:
        assert near(page.picture(), FABRIC) > 0.01
        assert page.complaints == []
