"""Random input, always the same: exit 0, 2, 3 or 4, a message, and nothing left behind.

Each share runs in a process of its own: cases are forked, which a process with threads must not do.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

SHARES = [("yaml", "1/2"), ("yaml", "2/2"), ("csv", "1/1"), ("urdf cli calibrate diagnose", "1/1")]


@pytest.mark.skipif(sys.platform != "linux", reason="limits and forked children as Linux has them")
@pytest.mark.parametrize(("kinds", "share"), SHARES)
def test_random_input_ends_with_an_answer_or_a_message(kinds: str, share: str) -> None:
    words = ["-m", "tests.fuzz", "--only", *kinds.split(), "--share", share]
    run = subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=600, check=False)
    assert run.returncode == 0, f"python -m tests.fuzz --case NAME shows one of them\n{run.stdout}{run.stderr}"
