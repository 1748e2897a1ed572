"""A headless Chromium, where there is one."""

from __future__ import annotations

import io
import json
import re
import shutil
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars",
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
)  # fmt: skip
# Time in s after which a page that is not drawn has failed.
PATIENCE = 120.0


@contextmanager
def opened(
    page: Path,
    width: int = 960,
    height: int = 640,
    *,
    dark: bool = False,
    ready: str = "document.documentElement.dataset.state",
) -> Generator[Page]:
    """Open a page until it tells that it is ready; skip the test where there is no browser."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    places = [
        shutil.which("chromium") or shutil.which("google-chrome"),
        shutil.which("chromedriver"),
    ]
    if None in places:
        pytest.skip("no Chromium with chromedriver on this machine")
    options = webdriver.ChromeOptions()
    options.binary_location = places[0]
    for flag in (*FLAGS, f"--window-size={width},{height}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    service = webdriver.ChromeService(executable_path=places[1])
    driver = webdriver.Chrome(options=options, service=service)
    try:
        if dark:
            wanted = {"features": [{"name": "prefers-color-scheme", "value": "dark"}]}
            driver.execute_cdp_cmd("Emulation.setEmulatedMedia", wanted)
        found = Page(driver)
        driver.get(page.as_uri())
        found.wait_for(f"return {ready}")
        yield found
    finally:
        driver.quit()


class Page:
    """An open report.

    Attributes:
        driver: The browser.
    """

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def colour(self, selector: str, name: str) -> np.ndarray:
        """Return red, green and blue of a property of an element."""
        text = self.run(
            "return getComputedStyle(document.querySelector(arguments[0]))[arguments[1]]",
            selector,
            name,
        )
        return np.array([int(part) for part in re.findall(r"\d+", text)[:3]])

    def run(self, script: str, *arguments: Any) -> Any:
        """Return what a script returns."""
        return self.driver.execute_script(script, *arguments)

    def wait_for(self, script: str) -> Any:
        """Return what a script returns, as soon as this is true."""
        end = time.monotonic() + PATIENCE
        while not (found := self.run(script)):
            assert time.monotonic() < end, f"never true: {script}"
            time.sleep(0.05)
        return found

    def settle(self) -> None:
        """Wait until what was changed is drawn."""
        self.driver.execute_async_script(
            "const done = arguments[0];"
            "requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )

    def slide(self, name: str, place: int) -> None:
        """Move a slider."""
        self.run(
            "const s = document.getElementById(arguments[0]); s.value = arguments[1];"
            "s.dispatchEvent(new Event('input'))",
            f"slider-{name}",
            place,
        )
        self.settle()

    def click(self, selector: str) -> None:
        """Click on an element."""
        self.run("document.querySelector(arguments[0]).click()", selector)
        self.settle()

    def picture(self) -> np.ndarray:
        """Return the pixels of the view in space, (h, w, 3), without what is written on it."""
        image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
        from selenium.webdriver.common.by import By

        hidden = (
            "for (const id of ['caption', 'bar', 'scale']) document.getElementById(id).style.{}"
        )
        self.run(hidden.format("visibility = 'hidden'"))
        self.settle()
        shot = self.driver.find_element(By.ID, "canvas").screenshot_as_png
        self.run(hidden.format("visibility = ''"))
        return np.asarray(image.open(io.BytesIO(shot)).convert("RGB")).astype(int)

    @property
    def complaints(self) -> list[str]:
        """What the console says since it was asked last."""
        return [entry["message"] for entry in self.driver.get_log("browser")]

    @property
    def requests(self) -> list[str]:
        """Addresses that were requested since this was asked last."""
        events = (json.loads(e["message"])["message"] for e in self.driver.get_log("performance"))
        return [
            event["params"]["request"]["url"]
            for event in events
            if event["method"] == "Network.requestWillBeSent"
        ]
