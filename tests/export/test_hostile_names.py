"""Names that are code in some language: every export holds them as text, and independent readers agree."""

from __future__ import annotations

import ast
import csv
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.export import PROGRAM_FORMATS
from posture_opt.export.export_files import export_kinds, program_files
from posture_opt.export.robot_program import program_through
from tests.export.programs import READERS

KINDS = list(export_kinds())
HOSTILE = [
    "=cmd|'/C calc'!A0", "+SUM(A1)", "-2+3", "@SUM(A1)", "'=1", "=a b", 'a"; b', "*/ int evil(){} /*", '""" + evil',
    "a =b", "# a", "- a", "{a}", "&a *a", "!!python/object/x", "null", "1e3", "<a>&amp;", "--> <b/>",
    "\\u0022", "😀 é", ";ENDFOLD", "%", "a\\", "${x}", "' or '",
]  # fmt: skip
LINE_BREAKS = ["\n", "\r", "\r\n", "\v", "\f", "\x1c", "\x85", "\u2028", "\u2029"]
Files = Mapping[str, str]


def arm_of(names: tuple[str, ...]) -> Any:
    """A planar arm whose joints have these names; six of them, so that every language takes it."""
    joints = [{"name": name, "type": "revolute", "a": "0.1 m"} for name in names]
    sigma = {f"{name}.theta": "1 mrad" for name in names}
    task = {"kind": "insert", "direction": [0, -1, 0]}
    return po.problem_from_dict(
        {"name": names[0], "robot": {"kind": "dh", "joints": joints}, "uncertainty": {"sigma": sigma}, "task": task}
    )


def comments_removed(text: str) -> str:
    """C without its comments, as a compiler sees it: a comment ends at the first ``*/``."""
    return re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL)


def named_in(kind: str, files: Files) -> list[str] | None:
    """The names of the joints that a reader of the language finds in an export; None where it holds none."""
    text = "".join(files.values())
    if kind == "dh":
        rows = list(csv.reader(text.splitlines()))
        assert {len(row) for row in rows} == {5}
        assert not any(cell.lstrip()[:1] in "=+@" for row in rows for cell in row[:2] if cell.strip())
        names = [row[0].removeprefix("'") if row[0].lstrip("'")[:1] in tuple("=+-@") else row[0] for row in rows]
        return [name.removesuffix(".theta") for name in names if name.endswith(".theta")]
    if kind == "jointstate":
        return list(yaml.safe_load(text)["name"])
    if kind == "urdf":
        return [joint.attrib["name"] for joint in ET.fromstring(text).iter("joint") if joint.attrib["type"] != "fixed"]
    if kind == "python":
        found = [node for node in ast.parse(text).body if isinstance(node, ast.Assign)]
        return next(list(ast.literal_eval(a.value)) for a in found if getattr(a.targets[0], "id", "") == "JOINTS")
    return None


@pytest.mark.parametrize("kind", KINDS)
def test_every_export_holds_hostile_names_as_text(kind: str) -> None:
    q = [0.3, 0.4, -0.5, 0.6, 0.7, 0.8]
    harmless = po.export_files(arm_of(tuple("abcdef")), kind, posture=q).files
    groups = [tuple((HOSTILE * 2)[k : k + 6]) for k in range(0, len(HOSTILE), 6)]
    for names in groups if kind not in ("python", "c") else groups[:2]:  # a fifth of a second each
        files = po.export_files(arm_of(names), kind, posture=q).files
        found = named_in(kind, files)
        assert found is None or found == list(names)
        if kind in PROGRAM_FORMATS:
            assert np.allclose(READERS[kind](files, ["revolute"] * 6), [q], atol=1e-4)
        if kind == "c":
            assert {f: comments_removed(t) for f, t in files.items()} == {
                f: comments_removed(t) for f, t in harmless.items()
            }


@pytest.mark.parametrize("kind", PROGRAM_FORMATS)
def test_labels_and_titles_stay_in_their_line_of_comment(kind: str) -> None:
    """Also such as no file could have brought: of problems made in Python."""
    problem = arm_of(tuple("abcdef"))
    q = np.array([[0.3, 0.4, -0.5, 0.6, 0.7, 0.8], [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]])
    calm = program_through(problem, "stops", q, ["pin", "pin"])
    lines = {name: text.count("\n") for name, text in program_files(calm, kind, "go").files.items()}
    for end in LINE_BREAKS:
        text = f"x{end}movej([9,9,9,9,9,9]){end}positions: [666]"
        hostile = replace(calm, title=text, labels=(text, text), notes=(text,) * len(calm.notes))
        files = program_files(hostile, kind, "go").files
        assert np.allclose(READERS[kind](files, ["revolute"] * 6), q, atol=1e-4)
        assert {name: len(text.splitlines()) for name, text in files.items()} == lines


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("rapid", ("PROC", "proc", "tool0", "EndModule")),
        ("krl", ("DEF", "def", "Ptp", "BAS")),
        ("urscript", ("def", "end", "movej", "True")),
        ("python", ("class", "lambda", "math", "numpy")),
        ("c", ("while", "class", "sin", "1x")),
    ],
)
def test_words_of_a_language_are_no_names_of_programs(kind: str, names: tuple[str, ...]) -> None:
    problem = arm_of(tuple("abcdef"))
    write: Callable[[str], Any] = lambda name: po.export_files(problem, kind, name=name, posture=[0.1] * 6)  # noqa: E731
    for name in names:
        with pytest.raises(po.errors.InputError, match=name):
            write(name)
    assert write("go").files
