"""Every file of the corpus gets its answer from the real command line, within limits of time and memory."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.helpers.command_server import CPU, ROOT, CommandServer

HERE = Path(__file__).parent
CASES: list[dict[str, Any]] = yaml.safe_load((HERE / "cases.yaml").read_text(encoding="utf-8"))
COLD = ("pint_bomb.yaml",)
"""Asked of a fresh interpreter too."""


def words_of(case: dict[str, Any]) -> list[str]:
    stands_for = {"FILE": str(HERE / case["file"]), "OUT": "out"}
    return [stands_for.get(word, word) for word in shlex.split(case["command"])]


def name_of(case: dict[str, Any]) -> str:
    return re.sub(r"\W+", "_", f"{case['file']}_{case['command']}".replace("FILE", ""))[:80]


LIMITED = [pytest.param(case, marks=pytest.mark.long) if "cpu" in case else case for case in CASES]
"""A limit of its own has what takes seconds, or shall take fewer."""


@pytest.mark.parametrize("case", LIMITED, ids=name_of)
def test_it_gets_its_answer(case: dict[str, Any], server: CommandServer, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    answer = server.call(words_of(case), folder)
    assert not answer.defects(folder), answer.err
    assert answer.code == case["code"], answer.err
    assert answer.cpu < case.get("cpu", CPU)
    said = answer.err if answer.code else answer.out
    assert not [text for text in case["says"] if text not in said], said


@pytest.mark.parametrize("case", [case for case in CASES if case["file"] in COLD], ids=name_of)
def test_a_fresh_interpreter_answers_alike(case: dict[str, Any], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "posture_opt", *words_of(case)]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}, timeout=60, check=False
    )
    assert done.returncode == case["code"]
    assert not [text for text in case["says"] if text not in done.stderr], done.stderr


def test_every_file_is_asked_about() -> None:
    there = {path.name for path in HERE.iterdir() if path.suffix in (".yaml", ".csv", ".urdf")} - {"cases.yaml"}
    assert there == {case["file"] for case in CASES}
