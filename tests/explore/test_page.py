"""The live page in headless Chromium: what moves the target moves the arm, and what it says is what was solved."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.explore.explorer import Explorer
from tests.helpers.browser import Browser, browser

pytest.importorskip("viser", reason="viser is not installed")
Keys = pytest.importorskip("selenium.webdriver.common.keys", reason="selenium is not installed").Keys
pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    yield from browser(tmp_path_factory.mktemp("browser"))


@pytest.fixture
def page() -> Iterator[Any]:
    explorer = po.load_problem("insert_planar_2r_fixed_hole").explore(port=18100)
    yield explorer
    explorer.close()


def words(tab: Browser) -> str:
    return re.sub(r"\s+", " ", str(tab.run("return document.body.innerText")))


def until(met: Any, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not met():
        assert time.monotonic() < end, "it never was"
        time.sleep(0.1)


def opened(tab: Browser, url: str) -> None:
    """Opens a page; what a page before it logged is forgotten."""
    tab.driver.get("about:blank")
    tab.errors(), tab.requests()
    tab.driver.get(url)


def picture(tab: Browser) -> Any:
    """The pixels of the window, as numbers."""
    from io import BytesIO

    import matplotlib.image

    return matplotlib.image.imread(BytesIO(tab.driver.get_screenshot_as_png()))


def test_the_arm_on_the_screen_follows_the_target(tab: Browser, page: Any) -> None:
    """A target set by the program changes pixels and numbers; those are the numbers of the solution."""
    tab.resize(800)
    opened(tab, page.url)
    until(lambda: "full search" in words(tab) and "Best posture of" in words(tab))
    before, said = picture(tab), words(tab)
    page.target = (0.4, 0.8, 0.0)
    until(lambda: "(400.00, 800.00, 0.00) mm" in words(tab) and "Best posture of the full search" in words(tab))
    assert words(tab) != said
    deviation = re.search(r"Standard deviation ([\d.]+) mm", words(tab))
    assert deviation is not None
    assert float(deviation[1]) == pytest.approx(1e3 * page.solution.sigma_max, rel=5e-3)
    after = picture(tab)
    assert before.shape == after.shape
    assert np.mean(np.any(np.abs(before - after) > 0.1, axis=2)) > 0.005  # an arm is a thin thing
    assert not tab.errors()
    elsewhere = [url for url in tab.requests() if not re.match(r"chrome:|(http|ws)://127\.0\.0\.1:", url)]
    assert not elsewhere


def says_alert(tab: Browser, text: str) -> bool:
    return text in str(tab.run("return (document.getElementById('posture-opt-says') || {}).textContent || ''"))


def test_two_browsers_see_the_same_and_are_told_of_the_end(tab: Browser) -> None:
    """With a token in the address; what is typed in one is in both. When the program ends, the page says so."""
    explorer = Explorer(po.load_problem("insert_planar_2r_fixed_hole"), "0.0.0.0", 18105)
    url = re.sub(r"//[^/:]+:", "//127.0.0.1:", explorer.url)
    try:
        tab.resize(1400)
        opened(tab, url)
        until(lambda: "full search." in words(tab))
        first = tab.driver.current_window_handle
        tab.driver.switch_to.new_window("tab")
        tab.driver.get(url)
        until(lambda: "(900.00, 400.00, 0.00) mm" in words(tab))
        field = tab.driver.find_element("css selector", "input[value='900']")
        field.send_keys(Keys.CONTROL, "a")
        field.send_keys("700", Keys.TAB)
        until(lambda: "(700.00, 400.00, 0.00) mm" in words(tab))
        second = tab.driver.current_window_handle
        tab.driver.switch_to.window(first)
        until(lambda: "(700.00, 400.00, 0.00) mm" in words(tab))
        assert explorer.target == pytest.approx((0.7, 0.4, 0.0))
        tab.driver.switch_to.window(second)
        tab.driver.close()
        tab.driver.switch_to.window(first)
        assert not tab.errors()
    finally:
        explorer.close()
    until(lambda: says_alert(tab, "has ended"))
    tab.errors()


def test_sliders_and_buttons_are_worked_by_keys(tab: Browser, page: Any, tmp_path: Path) -> None:
    """A joint is turned by an arrow key, and a problem saved by Enter."""
    page._away.folder = tmp_path
    opened(tab, page.url)
    until(lambda: "full search." in words(tab))
    tab.driver.find_element("xpath", "//*[normalize-space(text())='Joints']").click()
    until(lambda: "joint1 [deg]" in words(tab))
    slider = tab.run("return [...document.querySelectorAll('[role=slider]')].filter(e => e.offsetParent)[0]")
    slider.send_keys(Keys.ARROW_RIGHT)
    until(lambda: "Posture of your own" in words(tab))
    button = tab.driver.find_element("xpath", "//button[normalize-space(.)='Save problem']")
    button.send_keys(Keys.ENTER)
    until(lambda: "_explored.yaml written" in words(tab))
    assert list(tmp_path.glob("*.yaml"))
    assert not tab.errors()


def test_without_webgl_the_page_says_so(page: Any, tmp_path: Path) -> None:
    for tab in browser(tmp_path, "--disable-3d-apis"):
        opened(tab, page.url)
        until(lambda tab=tab: says_alert(tab, "no WebGL"))
