"""The figures of a campaign: kept in a file, and summed over processes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz.case import Case
from tests.fuzz.run import Run
from tests.fuzz.tally import Hit, Tally

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
