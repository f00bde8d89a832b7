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
    """The pixels of the scene, left of the panel, as numbers."""
    from io import BytesIO

    import matplotlib.image

    seen = matplotlib.image.imread(BytesIO(tab.driver.get_screenshot_as_png()))
    return seen[:, : seen.shape[1] // 2]


def drawn(tab: Browser) -> Any:
    """The scene once it stands still."""
    found = picture(tab)
    while not np.array_equal(found, now := picture(tab)):
        found = now
    return found


def canvas(tab: Browser) -> tuple[float, float, float, float]:
    """Left, top, width and height of the scene in the window."""
    found = tab.run(
        "const r = document.querySelector('canvas').getBoundingClientRect(); return [r.left, r.top, r.width, r.height]"
    )
    return tuple(found)


def pixel(tab: Browser, page: Any, place: Any) -> tuple[float, float]:
    """Where a place (3,) [m] is in the window, by the camera of the page."""
    until(lambda: page._server.get_clients())
    camera = next(iter(page._server.get_clients().values())).camera
    left, top, width, height = canvas(tab)
    ahead = np.array(camera.look_at) - camera.position
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, camera.up_direction)
    right /= np.linalg.norm(right)
    v, focal = np.array(place) - camera.position, height / 2 / np.tan(camera.fov / 2)
    x, y = focal * (v @ right) / (v @ ahead), focal * (v @ np.cross(right, ahead)) / (v @ ahead)
    return left + width / 2 + x, top + height / 2 - y


def test_the_arm_on_the_screen_follows_the_target(tab: Browser, page: Any) -> None:
    """A target set by the program changes pixels and numbers; those are the numbers of the solution."""
    tab.resize(800)
    opened(tab, page.url)
    until(lambda: "full search" in words(tab) and "Best posture of" in words(tab))
    left, top, width, height = canvas(tab)
    for corner in ((-0.4, -0.4, 0.0), (1.3, 1.3, 0.0)):  # the arm and room to move, in a window this narrow
        until(lambda corner=corner: 0 < pixel(tab, page, corner)[0] - left < width)
        assert 0 < pixel(tab, page, corner)[1] - top < height
    before, said = drawn(tab), words(tab)
    page.target = (0.4, 0.8, 0.0)
    until(lambda: "(400.00, 800.00, 0.00) mm" in words(tab) and "Best posture of the full search" in words(tab))
    assert words(tab) != said
    deviation = re.search(r"Standard deviation ([\d.]+) mm", words(tab))
    assert deviation is not None
    assert float(deviation[1]) == pytest.approx(1e3 * page.solution.sigma_max, rel=5e-3)
    until(lambda: np.mean(np.any(np.abs(before - picture(tab)) > 0.1, axis=2)) > 0.005)  # an arm is a thin thing
    assert not tab.errors()
    elsewhere = [url for url in tab.requests() if not re.match(r"chrome:|(http|ws)://127\.0\.0\.1:", url)]
    assert not elsewhere


def test_in_a_narrow_window_the_panel_starts_closed(tab: Browser, page: Any) -> None:
    tab.resize(600)
    opened(tab, page.url)
    until(lambda: "Vertical insertion" in words(tab))
    time.sleep(2)  # it is drawn open first, and the scene is as wide as the window before that
    until(lambda: canvas(tab)[2] > 500 and "Error budget" not in words(tab))


def finger(tab: Browser, kind: str, x: float, y: float) -> None:
    points = [] if kind == "end" else [{"x": x, "y": y}]
    event = {"start": "touchStart", "move": "touchMove", "end": "touchEnd"}[kind]
    tab.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": event, "touchPoints": points})


def mouse(tab: Browser, kind: str, x: float, y: float) -> None:
    event = {"start": "mousePressed", "move": "mouseMoved", "end": "mouseReleased"}[kind]
    asked = {"type": event, "x": x, "y": y, "button": "left", "buttons": int(kind != "end"), "clickCount": 1}
    tab.driver.execute_cdp_cmd("Input.dispatchMouseEvent", asked)


def test_the_target_is_dragged_by_mouse_and_by_touch(tab: Browser, page: Any) -> None:
    """Along the arrow that is grasped, ten pixels beside its middle; the camera stays, and the arm follows."""
    tab.resize(1400)
    tab.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True})
    try:
        opened(tab, page.url)
        until(lambda: "full search." in words(tab))
        drawn(tab)
        for drag in (mouse, finger):
            before = page.target
            x, y = (float(v) for v in pixel(tab, page, before))
            x, y = x + 60, y + 10
            drag(tab, "start", x, y)
            for step in range(1, 40):
                drag(tab, "move", x - min(10 * step, 100), y)
                if step > 10 and page.target[0] < before[0] - 0.2:
                    break
                time.sleep(0.1)
            drag(tab, "end", x - 100, y)
            until(lambda before=before: page.target[0] < before[0] - 0.2)
            assert page.target[1:] == before[1:]
            until(lambda: page._shown.request is page._request and page._shown.whole)
            assert page.solution.target.lower == pytest.approx(page.target)
            until(lambda: "times the standard deviation at the first target" in words(tab))
        assert not tab.errors()
    finally:
        tab.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})


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
    until(slider.is_displayed)
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
