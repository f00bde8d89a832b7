"""The documentation site in a browser, from files and without network; ``POSTURE_OPT_SITE`` names its folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.helpers.browser import Browser, browser

SITE = os.environ.get("POSTURE_OPT_SITE", "")
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(not SITE, reason="no site was built: sphinx-build docs SITE, then POSTURE_OPT_SITE=SITE"),
]


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    yield from browser(tmp_path_factory.mktemp("profile"))


@pytest.mark.parametrize(
    ("words", "page"), [("backlash", "effects"), ("recheck", "what-changed"), ("ball bar", "distance")]
)
def test_the_search_finds_pages_without_network(tab: Browser, words: str, page: str) -> None:
    tab.driver.get(f"{(Path(SITE) / 'search.html').resolve().as_uri()}?q={words.replace(' ', '+')}")
    found = "return [...document.querySelectorAll('#search-results li a')].map(a => a.href)"
    tab.wait(f"return (() => {{ {found} }})().some(href => href.includes('{page}'))")
    assert not [url for url in tab.requests() if url.startswith("http")]


def test_formulas_are_drawn_without_network(tab: Browser) -> None:
    tab.driver.get((Path(SITE) / "reference" / "effects.html").resolve().as_uri())
    tab.wait("return document.querySelectorAll('mjx-container, math, img.math').length > 20")
    assert not [url for url in tab.requests() if url.startswith("http")]
