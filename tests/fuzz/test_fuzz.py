"""Random input, always the same: exit 0, 2, 3 or 4, a message, and nothing left behind.

Each share runs in a process of its own: cases are forked, which a process with threads must not do.
"""

from __future__ import annotations

import copy
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.bases import bases
from tests.fuzz.case import Case
from tests.fuzz.kinds import COUNTS, case
from tests.fuzz.run import Run
from tests.fuzz.tally import Hit, Tally

SHARES = [
    # In every run of the tests: of each kind every 997th case; a prime, so that no turn of what is drawn is left out.
    (" ".join(COUNTS), "1/997"),
    pytest.param("yaml", "1/4", marks=pytest.mark.fuzz),
    pytest.param("csv urdf cli calibrate diagnose", "1/4", marks=pytest.mark.fuzz),
    pytest.param("schema instrument batch relation", "1/4", marks=pytest.mark.fuzz),
]


@pytest.mark.skipif(sys.platform != "linux", reason="limits and forked children as Linux has them")
@pytest.mark.parametrize(("kinds", "share"), SHARES)
def test_random_input_ends_with_an_answer_or_a_message(kinds: str, share: str) -> None:
    words = ["-m", "tests.fuzz", "--only", *kinds.split(), "--share", share]
    run = subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=600, check=False)
    assert run.returncode == 0, f"python -m tests.fuzz --case NAME shows one of them\n{run.stdout}{run.stderr}"


def test_a_case_is_the_same_whichever_were_made_before() -> None:
    before = [copy.deepcopy(base.data) for base in bases()]
    for number in range(40):
        case("yaml", number, 2701)
    assert [base.data for base in bases()] == before


CASES = [Case("yaml", 1, ("list",)), Case("yaml", 2, ("--json",)), Case("csv", 1, ("new", "x"))]
RUNS = [Run(0, cpu=0.5, memory=100.0), Run(2, cpu=3.0, memory=90.0), Run(2, cpu=0.25, memory=300.0)]


def counted(*chosen: int) -> Tally:
    tally = Tally()
    for k in chosen:
        tally.add(CASES[k], RUNS[k])
    tally.done = len(chosen)
    return tally


def test_parts_sum_to_the_whole() -> None:
    parts, whole = Tally.total([counted(0, 2), counted(1)]), counted(0, 1, 2)
    assert parts == whole
    assert (whole.cases, whole.slow, whole.slowest, whole.largest) == (3, 1, (3.0, "yaml:2"), (300.0, "csv:1"))


def test_a_file_goes_on_with_its_own_campaign_only(tmp_path: Path) -> None:
    file, tally = tmp_path / "1-of-2.json", counted(0, 1)
    tally.hits.append(Hit.of(CASES[0], RUNS[0], ["exit 0 without a word"]))
    assert Tally.read(file, {"seed": 1}) == Tally()
    tally.write(file, {"seed": 1})
    assert Tally.read(file, {"seed": 1}) == tally
    with pytest.raises(ValueError, match="another campaign"):
        Tally.read(file, {"seed": 2})
