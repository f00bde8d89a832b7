"""The door of the project: a README that is short, whose links lead somewhere, and facts that are stated alike."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
LINK = re.compile(r"\]\(([^)#:]+?)(?:#[^)]*)?\)")


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_links_lead_to_files(name: str) -> None:
    linked = LINK.findall((ROOT / name).read_text(encoding="utf-8"))
    assert [link for link in linked if not (ROOT / link).exists()] == []


def test_license_and_authors_are_stated_alike() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert project["license"] == citation["license"] == "BSD-3-Clause"
    assert [author["name"] for author in project["authors"]] == [author["name"] for author in citation["authors"]]
