"""The catalogue: every sentence is short and well formed, every id that code states has one, and none is left over."""

from __future__ import annotations

import ast
import json
import re
import string
from pathlib import Path

import posture_opt as po
from posture_opt.statements import SEVERITIES, Quantity, every_entry, state
from tests.helpers.command_line import invoke
from tests.helpers.source import modules_of

SOURCE = "\n".join(path.read_text(encoding="utf-8") for path in Path(po.__file__).parent.rglob("*.py"))
ENTRIES = every_entry()
STATED = re.compile(r'state\(\s*f?"([a-z_]+\.[a-z{}_\[\]"\'. -]+?)"')


def test_a_sentence_is_short_and_well_formed() -> None:
    for id, entry in ENTRIES.items():
        assert re.fullmatch(r"[a-z]+\.[a-z0-9-]+", id)
        assert entry.severity in SEVERITIES, id
        assert all(len(words.split()) <= 25 for words in re.split(r"[.?:;] ", entry.text)), id
        fields = {name: spec or "" for _, name, spec, _ in string.Formatter().parse(entry.text) if name}
        named = {k: 1.5 if spec and "|" not in spec else ("a", "b") for k, spec in fields.items() if k != "about"}
        one = state(id, "elbow", **named)
        assert set(one.to_json()) == {"id", "severity", "about", "values", "text"}, id
        assert one.text.count("{") == entry.text.count("{{"), id


PATTERNS = [re.sub(r"\\\{.*?\\\}", "(.+)", re.escape(id)) for id in STATED.findall(SOURCE)]
"""Of the ids that code states; what is computed of one is a group."""


def test_every_id_that_code_states_has_a_sentence() -> None:
    assert len(PATTERNS) > 200
    assert [pattern for pattern in PATTERNS if not any(re.fullmatch(pattern, id) for id in ENTRIES)] == []


def test_a_statement_gets_all_values_of_its_sentence() -> None:
    """Of calls with an id as a constant; the others are made by tests of what they are about."""
    nodes = [node for module in modules_of(Path(po.__file__).parent).values() for node in module.nodes]
    calls = [node for node in nodes if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "state"]
    stated = [(node.args[0].value, node.keywords) for node in calls if isinstance(node.args[0], ast.Constant)]
    assert len(stated) > 150
    for id, keywords in stated:
        needed = {name for _, name, _, _ in string.Formatter().parse(ENTRIES[id].text) if name}
        values = {keyword.arg for keyword in keywords}  # None is that of **values
        assert None in values or needed <= {"about", *values}, id


def test_no_sentence_is_left_over() -> None:
    """It is in the code: as a part of an id that is stated, whole, or in two parts that are joined at a hyphen."""
    parts = [pattern.replace(".+", ".*") for pattern in PATTERNS if not pattern.endswith(r"\.(.+)")]
    rest = [id for id in ENTRIES if not any(re.fullmatch(pattern, id) for pattern in parts)]
    assert [id for id in rest if not in_code(id.partition(".")[2])] == []


def in_code(name: str) -> bool:
    cuts = [match.start() for match in re.finditer("-", name)]
    joined = any(f"{name[: k + 1]}{{" in SOURCE and f'"{name[k + 1 :]}"' in SOURCE for k in cuts)
    added = any(f'"{name[:k]}"' in SOURCE and f'"{name[k:]}"' in SOURCE for k in cuts)
    return f'.{name}"' in SOURCE or f'"{name}"' in SOURCE or joined or added


def test_statements_are_listed_with_their_sentences() -> None:
    rows = json.loads(_printed("list", "--statements", "--json"))["statements"]
    assert {row["id"] for row in rows} == set(ENTRIES)
    assert "diagnosis.plan-outside-measured-range" in _printed("list", "--statements")


def _printed(*words: str) -> str:
    result = invoke(*words)
    assert result.exit_code == 0
    return result.stdout


def test_an_error_is_a_document_under_json() -> None:
    for words, code, id in (
        (("--task", "inser", "--json"), 2, "input.unknown-value"),
        (("--problem", "nothing.yaml", "--json"), 2, "input.invalid"),
        (("diagnose", "--json"), 2, "input.usage"),
    ):
        result = invoke(*words)
        document = json.loads(result.stdout)["error"]
        assert (result.exit_code, document["code"]) == (code, code)
        assert document["issues"][0]["id"] == id
        assert set(document["issues"][0]) == {"id", "file", "line", "key", "value", "message", "hint"}


def test_a_quantity_writes_itself() -> None:
    assert str(Quantity(2.61e-4, "angle", 1.2e-5)) == "0.261 ± 0.012 mrad"
    assert str(Quantity(1.23e-4)) == "0.123 mm"
    assert str(Quantity(0.99995, "probability")) == "> 99.9 %"
    assert Quantity(8e-6, "angle per torque", 1e-7).to_json() == {"value": 8e-6, "std": 1e-7, "unit": "rad/(N m)"}
