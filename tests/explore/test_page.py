"""The live page in headless Chromium: what moves the target moves the arm, and what it says is what was solved."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.browser import Browser, browser

pytest.importorskip("viser", reason="viser is not installed")
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


def picture(tab: Browser) -> Any:
    """The pixels of the window, as numbers."""
    from io import BytesIO

    import matplotlib.image

    return matplotlib.image.imread(BytesIO(tab.driver.get_screenshot_as_png()))


def test_the_arm_on_the_screen_follows_the_target(tab: Browser, page: Any) -> None:
    """A target set by the program changes pixels and numbers; those are the numbers of the solution."""
    tab.resize(800)
    tab.driver.get(page.url)
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
