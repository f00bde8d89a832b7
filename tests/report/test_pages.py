"""Pages of results in a real browser: they are drawn, answer clicks and keys, fit the window, and need no network."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

import posture_opt as po
from posture_opt.report.page import presenter
from posture_opt.report.page.page import Page
from posture_opt.report.text.blocks import Block, Document, Facts, Table
from tests.helpers.browser import Browser, browser

EVIL = "</script><img src=x onerror=alert(1)> \" ' {{ 7*7 }}"


@pytest.fixture(scope="session")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    yield from browser(tmp_path_factory.mktemp("profile"))


@pytest.fixture(scope="session")
def planar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a solution with alternatives."""
    pytest.importorskip("plotly", reason="the extra [viewer] is not installed")
    return saved(po.select_posture(po.load_problem("problems/insert_planar_2r.yaml")), tmp_path_factory)


@pytest.fixture(scope="session")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of an arm among obstacles."""
    pytest.importorskip("plotly", reason="the extra [viewer] is not installed")
    problem = po.load_problem("problems/insert_panda_cell.yaml")
    return saved(po.propagate(problem, [0.1, -0.4, 0.2, -2.0, 0.3, 1.7, 0.5]), tmp_path_factory)


@pytest.fixture(scope="session")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a diagnosis."""
    pytest.importorskip("plotly", reason="the extra [viewer] is not installed")
    data = {"kind": "gear_eccentricity", "joint": "joint2", "estimate": {"sin": "2 mrad", "cos": "0 rad"}}
    stated = po.load_problem("problems/insert_planar_2r.yaml").to_dict()
    stated["uncertainty"] = {**stated["uncertainty"], "measurement": {"position": "0.1 mm"}}
    arm = po.Arm.from_problem(po.problem_from_dict({**stated, "effects": [data]}))
    rng = np.random.default_rng(1)
    Q = rng.uniform(-2.5, 2.5, (60, 2))
    points = [np.asarray(arm.pose(q), dtype=float)[:2, 3] * 1e3 + 0.1 * rng.standard_normal(2) for q in Q]
    rows = [", ".join(f"{v:.6f}" for v in (*np.degrees(q), *point)) for q, point in zip(Q, points, strict=True)]
    file = tmp_path_factory.mktemp("data") / "data.csv"
    file.write_text("\n".join(["joint1 [deg], joint2 [deg], x [mm], y [mm]", *rows]) + "\n")
    problem = po.problem_from_dict(stated)
    return saved(po.diagnose(problem, po.read_measurements(file, problem), plan=False), tmp_path_factory)


def saved(result: Any, folders: pytest.TempPathFactory) -> Path:
    """The page of a result, in a folder of its own."""
    folder = folders.mktemp("page")
    result.save(folder)
    return folder / "report.html"


def arm(tab: Browser) -> np.ndarray:
    """(3, v) corners of the drawn arm [mm]."""
    script = "const {x, y, z} = document.querySelector('.plot').data[0]; return [x, y, z]"
    return np.array(tab.run(script))


def coloured(tab: Browser) -> float:
    """The share of the drawing's pixels that are neither white nor as pale as the grid."""
    picture = tab.driver.find_element("css selector", ".stage .plot").screenshot_as_png
    pixels = matplotlib.image.imread(io.BytesIO(picture))[..., :3]
    return float(np.mean(pixels.min(axis=2) < 0.8))


def overflow(tab: Browser) -> int:
    """By how many pixels the page is wider than the window."""
    return int(tab.run("return document.documentElement.scrollWidth - document.documentElement.clientWidth"))


@pytest.mark.browser
def test_an_arm_is_drawn_and_nothing_is_wider_than_the_window(tab: Browser, cell: Path) -> None:
    tab.open(cell)
    tab.run("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
    for width in (1400, 800, 390):
        tab.resize(width)
        tab.wait(
            "return document.querySelector('.plot svg').clientWidth === document.querySelector('.plot').clientWidth"
        )
        assert overflow(tab) <= 0, width
        assert coloured(tab) > 0.01, width
    assert tab.errors() == []
    assert tab.requests() == [cell.as_uri()]


@pytest.mark.browser
def test_a_row_of_the_alternatives_shows_its_posture(tab: Browser, planar: Path) -> None:
    tab.open(planar)
    before = arm(tab)
    tab.driver.find_element("css selector", "td button[data-view='alternative-2']").click()
    tab.wait("return document.getElementById('arm-view').dataset.shown === 'alternative-2'")
    tab.wait("return document.querySelector('tr[aria-current]').dataset.view === 'alternative-2'")
    tab.wait(f"return Math.abs(document.querySelector('.plot').data[0].x[0] - {before[0, -1]}) > 0")
    told = tab.run("return document.querySelector('.shown').textContent")
    document = json.loads((planar.parent / "solution.json").read_text())
    second = np.degrees(list(document["alternatives"][1]["posture"].values()))
    assert all(f"{value:.2f} deg" in told for value in second)
    tool = np.array(document["alternatives"][1]["position"]) * 1e3
    assert np.linalg.norm(arm(tab) - tool[:, None], axis=0).min() < 60  # the last link ends there
    assert np.linalg.norm(before - tool[:, None], axis=0).min() > 300
    assert tab.errors() == []


@pytest.mark.browser
def test_a_posture_is_chosen_by_keys_and_the_arm_is_turned_by_them(tab: Browser, planar: Path) -> None:
    from selenium.webdriver.common.keys import Keys

    tab.open(planar)
    button = tab.driver.find_element("css selector", "td button[data-view='alternative-3']")
    button.send_keys(Keys.ENTER)
    tab.wait("return document.getElementById('arm-view').dataset.shown === 'alternative-3'")
    eye = "return document.querySelector('.plot')._fullLayout.scene._scene.getCamera().eye"
    before = tab.run(eye)
    tab.driver.find_element("css selector", ".stage").send_keys(Keys.ARROW_LEFT)
    tab.wait(f"const eye = (() => {{ {eye} }})(); return Math.abs(eye.x - {before['x']}) > 1e-3")


@pytest.mark.browser
def test_obstacles_and_the_budget_are_switched_on_and_off(tab: Browser, cell: Path) -> None:
    tab.open(cell)
    count = "return document.querySelector('.plot').data.length"
    notes = "return document.querySelector('.plot').layout.scene.annotations.map((note) => note.text)"
    all_of_it, names = tab.run(count), tab.run(notes)
    obstacles = {obstacle.name for obstacle in po.load_problem("problems/insert_panda_cell.yaml").scene.obstacles}
    region, *seen = names
    assert "ellipsoid" in region
    assert set(seen) <= obstacles
    assert seen
    tab.run("document.querySelector('[data-show=obstacles]').click()")
    tab.wait(f"{count} < {all_of_it}")
    assert tab.run(notes) == [region]
    tab.run("document.querySelector('[data-show=budget]').click()")
    tab.wait(notes.replace("return", "return (") + ").length === 3")  # no more callouts than that
    shares = [float(re.fullmatch(r".* ([\d.]+) %", text).group(1)) for text in tab.run(notes)]  # type: ignore[union-attr]
    assert 50 < sum(shares) <= 100


@pytest.mark.browser
def test_a_cause_is_marked_at_its_joint(tab: Browser, diagnosed: Path) -> None:
    tab.open(diagnosed)
    labels = "return document.querySelector('.plot').layout.scene.annotations.map((note) => note.text)"
    assert any("gear eccentricity (joint2)" in text for text in tab.run(labels))
    tab.driver.find_element("css selector", "button[data-view='cause-1']").click()
    tab.wait("return document.getElementById('arm-view').dataset.shown === 'cause-1'")
    tab.wait(labels.replace("return", "return (") + ").length === 1")
    assert "gear eccentricity (joint2)" in tab.run(labels)[0]
    assert tab.run("return document.querySelector('.plot').data[0].facecolor.includes('#d55e00')")
    tab.open(diagnosed, 390)
    assert overflow(tab) <= 0
    assert set(tab.run(labels)) <= {"1", "2", "3"}  # numbers, whose texts are in the panel
    assert "gear eccentricity (joint2)" in tab.run("return document.querySelector('.callouts').textContent")
    assert tab.errors() == []


@pytest.mark.browser
def test_evil_names_are_text_in_tables_and_in_the_drawing(tab: Browser, tmp_path: Path) -> None:
    pytest.importorskip("plotly", reason="the extra [viewer] is not installed")
    joints = [{"name": f"{EVIL}{k}", "type": "revolute", "a": "1 m"} for k in (1, 2)]
    sigma = {f"{joint['name']}.theta": "1 deg" for joint in joints}
    obstacle = {"name": EVIL, "kind": "sphere", "radius": "50 mm", "xyz": ["0 m", "1.5 m", "0 m"]}
    problem = po.problem_from_dict(
        {
            "name": EVIL,
            "robot": {"kind": "dh", "joints": joints},
            "uncertainty": {"sigma": sigma},
            "cell": {"obstacles": [obstacle]},
        }
    )
    po.propagate(problem, [0.3, 0.5]).save(tmp_path)
    tab.open(tmp_path / "report.html")
    tab.run("document.querySelector('[data-show=budget]').click()")
    tab.wait("return document.querySelector('.plot').layout.scene.annotations.length === 3")
    assert tab.run("return document.title") == EVIL
    assert tab.run("return document.querySelectorAll('img[src=x]').length") == 0
    assert tab.errors() == []
    assert tab.requests() == [(tmp_path / "report.html").as_uri()]


@pytest.mark.browser
def test_a_wide_table_says_that_it_scrolls(tab: Browser, tmp_path: Path) -> None:
    wide = Table(tuple(f"joint_{k} [deg]" for k in range(12)), (tuple("123.45" for _ in range(12)),), 0)
    narrow = Table(("a", "b"), (("1", "2"),), 0)
    facts = Facts((("label", "x" * 200), ("long", "word " * 160)))
    blocks = tuple(Block(f"Part {k}", (wide, narrow, facts)) for k in range(5))
    (tmp_path / "page.html").write_text(Page(Document("Long", (), blocks)).html())
    tab.open(tmp_path / "page.html", 390)
    assert overflow(tab) <= 0
    tab.wait("return document.querySelectorAll('details[open] > .wide.cut').length === 3")  # one in each open section
    folded = tab.run("return [...document.querySelectorAll('section > details')].map((part) => part.open)")
    assert folded == [True, True, True, False, False]
    tab.run("document.querySelector('.contents').open = true; document.querySelector('a[href=\"#part-5\"]').click()")
    tab.wait("return document.querySelector('#part-5 > details').open")


@pytest.mark.usefixtures("coarse")
def test_without_the_library_the_page_says_what_brings_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(presenter, "plotly_js", lambda: "")
    problem = po.load_problem("problems/insert_planar_2r.yaml")
    po.propagate(problem, [0.3, 0.5]).save(tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "pip install &#39;posture_opt[viewer]&#39;" in page
    assert "view-library" not in page
    assert page.count("data:image/png;base64,") == 3


@pytest.mark.browser
def test_without_webgl_the_picture_opens_the_page_all_the_same(tab: Browser, diagnosed: Path) -> None:
    hide = "HTMLCanvasElement.prototype.getContext = () => null"
    script = tab.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": hide})
    try:
        tab.resize(800)
        tab.driver.get(diagnosed.as_uri())
    finally:
        tab.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)
    order = tab.run("return [...document.querySelector('header').children].map((part) => part.tagName)")
    assert order == ["H1", "FIGURE", "DIV"]  # the picture before the lead
    assert tab.run("return document.querySelector('header img').clientHeight > 100")
    assert not tab.run("return document.getElementById('arm-view').classList.contains('drawn')")
    assert tab.errors() == []
