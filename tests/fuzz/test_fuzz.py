"""Random input, always the same: exit 0, 2, 3 or 4, a message, and nothing left behind.

Each share runs in a process of its own: cases are forked, which a process with threads must not do.
"""

from __future__ import annotations

import copy
import subprocess
import sys

import pytest

from tests.fuzz.bases import bases
from tests.fuzz.kinds import COUNTS, case

SHARES = [
    # In every run of the tests: of each kind every 331st case; a prime, so that no turn of what is drawn is left out.
    (" ".join(COUNTS), "1/331"),
    pytest.param("yaml", "1/2", marks=pytest.mark.fuzz),
    pytest.param("yaml", "2/2", marks=pytest.mark.fuzz),
    pytest.param("csv", "1/1", marks=pytest.mark.fuzz),
    pytest.param("urdf cli calibrate diagnose", "1/1", marks=pytest.mark.fuzz),
    pytest.param("schema instrument batch relation", "1/2", marks=pytest.mark.fuzz),
]


@pytest.mark.skipif(sys.platform != "linux", reason="limits and forked children as Linux has them")
@pytest.mark.parametrize(("kinds", "share"), SHARES)
def test_random_input_ends_with_an_answer_or_a_message(kinds: str, share: str) -> None:
    words = ["-m", "tests.fuzz", "--only", *kinds.split(), "--share", share]
    run = subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=600, check=False)
    assert run.returncode == 0, f"python -m tests.fuzz --case NAME shows one of them\n{run.stdout}{run.stderr}"


def test_a_case_is_the_same_whichever_were_made_before() -> None:
    before = [copy.deepcopy(base.data) for base in bases()]
    for number in range(150):
        case("yaml", number, 2701)
    assert [base.data for base in bases()] == before
