"""A base that is off for all robots of a type, each measured in a few rows: named and fitted, and the type is found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.hidden.draw import draw
from tests.hidden.files import write


@pytest.mark.long
def test_a_base_that_is_off_does_not_hide_how_lengths_vary(tmp_path: Path) -> None:
    case = draw(61, "batch")
    base, tool = (np.array([f.value for f in part]) for part in (case.nominal.base, case.nominal.tool))
    base[:2] += [4e-3, -3e-3]
    problem = po.load_problem(write(replace(case, nominal=case.nominal.with_frames(base, tool)), tmp_path))
    lines = (tmp_path / "data.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "ten.csv").write_text("\n".join(lines[:101]), encoding="utf-8")  # the first ten robots
    found = po.diagnose_batch(problem, po.read_measurements(tmp_path / "ten.csv", problem))
    assert len(found.batch.calibrations) == 10
    refuted = [[c.cause.kind for c in calibration.contradictions] for calibration in found.batch.calibrations]
    assert np.mean([kinds == ["base_frame"] for kinds in refuted]) > 0.9
    assert ("correlated_lengths", "joint1.a, joint2.a") in [(f.kind, f.target) for f in found.effects]
    assert "batch.refuted" in {one.id for one in found.batch.statements}
