"""Standard output that is full, closed, limited or cut off: an exit code of its own and one line, never a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.variants import conformance

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a shell and /dev/full")
SOLVE = "uncertainty --problem insert_planar_2r --posture '90 deg, -180 deg'"


def shell(command: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """What bash answers, where ``optimize-posture`` is this program."""
    function = f"set -o pipefail; optimize-posture() {{ '{sys.executable}' -m posture_opt \"$@\"; }}; {command}"
    known = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "", **environment}
    return subprocess.run(["bash", "-c", function], capture_output=True, text=True, env=known, timeout=60)


@pytest.mark.parametrize(
    ("words", "to", "why"),
    conformance(
        [
            (words, *to)
            for words in (f"{SOLVE} --json", "new ur10e", "--help")
            for to in ((">/dev/full", "No space left on device"), (">&-", "it is closed"))
        ],
        [(f"{SOLVE} --json", ">/dev/full", "No space left on device"), ("--help", ">&-", "it is closed")],
    ),
)
def test_standard_output_that_takes_nothing_is_exit_code_2(words: str, to: str, why: str) -> None:
    found = shell(f"optimize-posture {words} {to}")
    assert found.stderr == f"error: cannot write to standard output: {why}\n"
    assert found.returncode == 2


@pytest.mark.parametrize("unbuffered", conformance(["", "1"], [""]))
def test_a_file_that_may_not_grow_is_exit_code_2(unbuffered: str, tmp_path: Path) -> None:
    found = shell(f"ulimit -f 1; optimize-posture schema > '{tmp_path}/schema'", PYTHONUNBUFFERED=unbuffered)
    assert found.stderr == "error: cannot write to standard output: File too large\n"
    assert found.returncode == 2


@pytest.mark.parametrize("words", conformance(["schema", SOLVE, "--version"], ["schema"]))
def test_a_reader_that_has_seen_enough_is_no_error(words: str) -> None:
    found = shell(f"optimize-posture {words} | true")
    assert (found.returncode, found.stderr) == (0, "")


def test_where_nothing_is_to_be_written_nothing_has_to_be_open(tmp_path: Path) -> None:
    found = shell(f"optimize-posture {SOLVE} --quiet --no-plots --out '{tmp_path}/out' >&- 2>&- <&-")
    assert found.returncode == 0
    assert (tmp_path / "out" / "spread.json").is_file()
