"""The animations of the live page, taken from the running program: `python docs/figures/make_animations.py [NAME ...]`.

A headless Chromium shows the page; the target moves from state to state, and a picture is taken once the page shows the
answer to each. Pillow puts the pictures together. Takes about a minute for each.
"""

from __future__ import annotations

import io
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from selenium import webdriver
from selenium.webdriver.common.by import By

import posture_opt as po
from posture_opt.output import write_file

FOLDER = Path(__file__).parent
SIZE = 900, 600  # pixels
MOST_BYTES = 1_500_000
FLAGS = ("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
SETTLES_S = 0.35  # from the answer to the pixels
PATIENCE_S = 300.0  # with one answer: a busy machine takes its time
PLAYED_MS, LAST_MS = 3600, 1500


class Tab:
    """A live page in a browser, and the pictures that were taken of it."""

    def __init__(self, driver: Any, page: Any) -> None:
        self.driver, self.page = driver, page
        self.frames: list[Image.Image] = []

    def move(self, place: np.ndarray) -> None:
        """Has the target at a place (3,) [m], and takes a picture of the answer to it."""
        self.page.target = place
        asked = np.round(place, 4)
        self.until(lambda: self._answers(asked))
        self.take()

    def _answers(self, place: np.ndarray) -> bool:
        found = self.page.solution
        return found is not None and np.allclose(found.target.lower, place, atol=1e-9)

    def change(self, group: str, values: dict[str, Any]) -> None:
        """Changes keys of the problem, and takes a picture of the answer."""
        self.page.change(group, values)
        asked = self.page.problem.to_dict()
        self.until(lambda: (found := self.page.solution) is not None and found.problem.to_dict() == asked)
        self.take()

    def turn(self, q: tuple[float, ...]) -> None:
        """Has the arm in a posture of its own, and takes a picture of it."""
        self.page.turn(q)
        self.take()

    def rest(self) -> None:
        """Waits for the full search, and takes a picture."""
        self.until(lambda: "full search." in self.words or "Full search:" in self.words)
        self.take()

    def take(self) -> None:
        time.sleep(SETTLES_S)
        picture = Image.open(io.BytesIO(self.driver.get_screenshot_as_png()))
        self.frames.append(picture.convert("RGB"))

    def click(self, text: str) -> None:
        """Clicks what has a text."""
        self.driver.find_element(By.XPATH, f"//*[normalize-space(text())='{text}']").click()

    @property
    def words(self) -> str:
        return str(self.driver.execute_script("return document.body.innerText"))

    def until(self, met: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not met():
            if time.monotonic() > end:
                raise TimeoutError("the page does not get there")
            time.sleep(0.05)

    def save(self, name: str) -> None:
        """The pictures as one endless animation; the file is the old one until the new one is whole."""
        times = [PLAYED_MS // len(self.frames)] * (len(self.frames) - 1) + [LAST_MS]
        whole = io.BytesIO()
        self.frames[0].save(
            whole, "webp", save_all=True, append_images=self.frames[1:], duration=times, loop=0, quality=60, method=6
        )
        size = whole.getbuffer().nbytes
        if size > MOST_BYTES:
            raise ValueError(f"{name}.webp would be larger than {MOST_BYTES} bytes: {size}")
        write_file(FOLDER / f"{name}.webp", whole.getvalue())
        print(f"{name}.webp: {len(self.frames)} pictures, {size / 1e6:.2f} MB", flush=True)


@contextmanager
def shown(problem: str) -> Iterator[Tab]:
    """A page of a problem in a browser."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    for flag in FLAGS:
        options.add_argument(flag)
    service = webdriver.ChromeService(executable_path=shutil.which("chromedriver"))
    with po.load_problem(problem).explore(port=18400) as page, webdriver.Chrome(options, service) as driver:
        size = {"width": SIZE[0], "height": SIZE[1], "deviceScaleFactor": 1, "mobile": False}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        driver.get(page.url)
        tab = Tab(driver, page)
        tab.until(lambda: "Software WebGL" in tab.words and "full search." in tab.words)
        driver.find_element(By.CSS_SELECTOR, ".mantine-Notification-closeButton").click()  # that there is no GPU
        time.sleep(2.0)
        yield tab


def explore_target() -> None:
    """A hole is moved about the bench of a UR10, and the arm follows."""
    with shown("insert_ur10_cell") as tab:
        start = np.array(tab.page.target)
        tab.take()
        for angle in np.linspace(0.0, 2.0 * np.pi, 29)[1:]:
            tab.move(start + np.array([0.12 * np.sin(angle), 0.22 * (np.cos(angle) - 1.0), 0.0]))
        tab.rest()
        tab.save("explore_target")


def explore_planar() -> None:
    """The lecture's arm: its ellipse by the full model, by first order, and a cloud of draws, over its postures."""
    with shown("insert_planar_2r_fixed_hole") as tab:
        tab.click("Monte Carlo cloud")
        tab.click("First order")
        tab.take()
        best = np.array(tab.page.solution.q)
        for part in np.linspace(0.0, 2.0 * np.pi, 29)[1:]:
            tab.turn(tuple(best + np.array([0.5 * np.sin(part), 1.1 * np.sin(part / 2.0) ** 2])))
        tab.save("explore_planar")


def explore_obstacle() -> None:
    """A lamp is dragged down beside the arm, which keeps clear of it; the narrowest gap is shown."""
    with shown("insert_ur10_cell") as tab:
        obstacles = tab.page.problem.to_dict()["cell"]["obstacles"]
        tab.take()
        for part in np.linspace(0.0, 1.0, 25)[1:]:
            height = 650.0 - 400.0 * part
            lamp = {**obstacles[-1], "xyz": ["500.0 mm", f"{50.0 + 60.0 * part:.1f} mm", f"{height:.1f} mm"]}
            tab.change("obstacles", {"cell__obstacles": [*obstacles[:-1], lamp]})
        tab.rest()
        tab.save("explore_obstacle")


SCENES = {scene.__name__: scene for scene in (explore_target, explore_planar, explore_obstacle)}


def main() -> None:
    for name in sys.argv[1:] or SCENES:
        SCENES[name]()


if __name__ == "__main__":
    main()
