"""Standard output that is full, closed, limited or cut off: an exit code of its own and one line, never a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a shell and /dev/full")
SOLVE = "uncertainty --problem insert_planar_2r --posture '90 deg, -180 deg'"


def shell(command: str) -> subprocess.CompletedProcess[str]:
    """What bash answers, where ``optimize-posture`` is this program."""
    function = f"set -o pipefail; optimize-posture() {{ '{sys.executable}' -m posture_opt \"$@\"; }}; {command}"
    known = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": ""}
    return subprocess.run(["bash", "-c", function], capture_output=True, text=True, env=known, timeout=60)


@pytest.mark.parametrize(
    ("words", "to", "why"),
    [(f"{SOLVE} --json", ">/dev/full", "No space left on device"), ("--help", ">&-", "it is closed")],
)
def test_standard_output_that_takes_nothing_is_exit_code_2(words: str, to: str, why: str) -> None:
    found = shell(f"optimize-posture {words} {to}")
    assert found.stderr == f"error: cannot write to standard output: {why}\n"
    assert found.returncode == 2


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    found = shell("optimize-posture schema | true")
    assert (found.returncode, found.stderr) == (0, "")


def test_where_nothing_is_to_be_written_nothing_has_to_be_open(tmp_path: Path) -> None:
    found = shell(f"optimize-posture {SOLVE} --quiet --no-plots --out '{tmp_path}/out' >&- 2>&- <&-")
    assert found.returncode == 0
    assert (tmp_path / "out" / "spread.json").is_file()
