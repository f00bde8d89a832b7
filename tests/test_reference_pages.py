"""Reference pages that are made of the program: nothing in them is empty, and what they quote is what it says."""

from __future__ import annotations

import re
import sys
from itertools import pairwise
from pathlib import Path

import pytest
import yaml

import posture_opt as po
from posture_opt.model.effects import CATALOGUE
from posture_opt.selection.tasks import KINDS
from posture_opt.selection.terms import TERMS
from tests.helpers.shipped import json_schema

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
sys.path.append(str(DOCS / "extensions"))  # pages are written by scripts beside them

from effect_formulas import effects_page  # noqa: E402
from effect_pictures import EXAMPLES as EFFECT_PICTURES  # noqa: E402
from noise_pictures import PICTURES as NOISE_PICTURES  # noqa: E402
from problem_file import problem_file_page  # noqa: E402
from term_formulas import FORMULAS, terms_page  # noqa: E402
from term_pictures import PICTURES as TERM_PICTURES  # noqa: E402

TERM_NAMES = [term.model_fields["kind"].annotation.__args__[0] for term in TERMS]
QUOTED = re.compile(r"`([^`]+)`")


def test_every_key_of_the_problem_file_has_a_value_and_a_meaning() -> None:
    rows = [line for line in problem_file_page().splitlines() if line.startswith("| `")]
    assert len(rows) > 200
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]] for row in rows]
    assert [row for row, (_, value, _, meaning) in zip(rows, cells, strict=True) if not (value and meaning)] == []


def test_every_key_of_the_schema_is_on_the_page_and_every_section_that_it_names() -> None:
    page = problem_file_page()
    for name, part in json_schema()["$defs"].items():
        for key in {*part.get("properties", ())} - {"kind"}:
            assert f"| `{key}` |" in page, f"{name}: {key}"
    sections = {*re.findall(r"^##+ `(\w+)`", page, re.MULTILINE)}
    assert {*re.findall(r"see `(\w+)`", page)} <= sections


def test_every_effect_has_formula_picture_size_and_use() -> None:
    sections = effects_page().split("\n## ")[1:]
    assert EFFECT_PICTURES.keys() | NOISE_PICTURES.keys() == {kind.kind_name() for kind in CATALOGUE}
    assert len(sections) == len(CATALOGUE)
    for section in sections:
        assert all(part in section for part in ("$$", "![", "**When to use**", "**Typical size**")), section


def test_every_term_has_formula_picture_and_an_entry_that_is_read() -> None:
    assert TERM_PICTURES.keys() == FORMULAS.keys() == {*TERM_NAMES}
    assert terms_page().count("$$") == 2 * len(TERMS)
    problem = po.load_problem("insert_ur10_extended")
    for kind, (*_, entry) in FORMULAS.items():
        ((key, (stated,)),) = yaml.safe_load(entry).items()
        (read,) = getattr(problem.replace(**{f"task__{key}": [stated]}).task, key)
        assert read.kind == kind


@pytest.mark.parametrize("kind", sorted({*KINDS} - {"custom"}))
def test_every_task_has_a_page_with_formula_picture_and_use(kind: str) -> None:
    page = DOCS / "how-to" / "tasks" / f"{kind}.md"
    text = (page if page.exists() else page.with_name("path.md")).read_text(encoding="utf-8")
    assert all(part in text for part in ("$$", "![", "**When to use.**", f"`{kind}`" if "path" in text else kind))


def test_messages_that_troubleshooting_quotes_are_those_of_the_program() -> None:
    lines = (DOCS / "how-to" / "troubleshooting.md").read_text(encoding="utf-8").splitlines()
    heads = [line for line, after in pairwise(lines) if after.startswith(": ")]
    quoted = [text for head in heads for text in QUOTED.findall(head)]
    assert len(quoted) >= 12
    files = (path for ending in ("*.py", "*.toml") for path in (ROOT / "posture_opt").rglob(ending))
    source = "\n".join(path.read_text(encoding="utf-8") for path in files)
    said = re.sub(r'"\n\s+f?"', "", source)
    for text in quoted:
        for part in re.split(r"…( %)?|\(here .*\)|\bangle\b", text):
            assert (part or "").strip(" :") in said, text
