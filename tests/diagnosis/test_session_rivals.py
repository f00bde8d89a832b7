"""Causes of the session and lasting ones that explain alike are rivals of each other, whichever is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write
from tests.helpers.variants import conformance

ROWS = 100
LASTING = {"thermal_growth", "thermal_offset"}


def diagnosed(folder: Path, cause: str, reach: float, seed: int) -> po.Diagnosis:
    """An arm that warms up by 8 K with 2500 s: its links grow, or only the place that is measured moves.

    Args:
        reach: half the range of its joints [rad].
    """
    rng = np.random.default_rng(seed)
    q = np.array([0.6, 0.9]) + rng.uniform(-reach, reach, (ROWS, 2))
    t = np.linspace(0, 7200, ROWS)
    rise = 1 - np.exp(-t / 2500)
    warmer = 8 * rise + rng.normal(0, 0.05, ROWS)
    grown = 1 + 20e-6 * warmer * (cause == "growth")
    points = position(q, (grown, grown))
    # In the direction in which an arm that grows would move it: beside that, growth of one length is refuted.
    outward = position(np.array([[0.6, 0.9]]))[0]
    points += 2.2e-4 * outward / np.linalg.norm(outward) * rise[:, None] * (cause == "drift")
    uneven = rise + 0.2 * np.sin(2 * np.pi * t / 7200)
    points += np.array([2e-4, 1e-4]) * uneven[:, None] * (cause == "uneven drift")
    points -= 2e-3 * np.stack([np.cos(0.6), np.sin(0.6)]) * rise[:, None] * (cause == "large drift")
    points += rng.normal(0, 2e-5, points.shape)
    write(folder / "data.csv", q, points, temperature=("degC", 20 + warmer), time=("s", t))
    problem = po.problem_from_dict(PROBLEM)
    return po.diagnose(problem, po.read_measurements(folder / "data.csv", problem), flips=99, plan=False)


def moving(found: po.Diagnosis) -> list[Any]:
    return [f for f in found.effects if f.effect is not None]


@pytest.mark.parametrize("cause", ["growth", "drift"])
@pytest.mark.parametrize("seed", conformance([0, 1], [0]))
def test_in_a_small_volume_growth_and_drift_are_rivals_of_each_other(cause: str, seed: int, tmp_path: Path) -> None:
    first, *_ = moving(diagnosed(tmp_path, cause, 0.03, seed))
    rivals = {rival.kind for rival in first.confounded_with}
    assert "drift" in {first.kind, *rivals}
    assert LASTING & {first.kind, *rivals}


@pytest.mark.parametrize("seed", conformance([0, 1], [0]))
def test_one_drift_is_named_and_not_several_lasting_causes(seed: int, tmp_path: Path) -> None:
    assert [f.kind for f in moving(diagnosed(tmp_path, "drift", 0.6, seed))] == ["drift"]


def test_a_drift_is_no_growth_of_a_size_that_no_arm_has(tmp_path: Path) -> None:
    """Along the first link by −2 mm in 8 K: −250 ppm/K, were it growth."""
    first, *_ = moving(diagnosed(tmp_path, "large drift", 0.03, 0))
    assert first.kind == "drift"
    assert first.plausible


def test_an_unnamed_component_that_explains_as_much_is_a_rival(tmp_path: Path) -> None:
    """A drift that goes back on its way: the named course is not refuted, and neither is any other change with time."""
    found = diagnosed(tmp_path, "uneven drift", 0.03, 0)
    kinds = {rival.kind for f in moving(found) for rival in f.confounded_with}
    assert "course" in kinds
    assert "change with time" in found.report() or "course" in found.report()


def test_first_rows_that_are_off_are_a_drift_that_settles(tmp_path: Path) -> None:
    """The base is stated, so that an arm which ends where the file says was off when it began, and not since."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.0, 2.0, (ROWS, 2))
    points = position(q, (1.0, 1.0)) + rng.normal(0, 2e-5, (ROWS, 2))
    points += np.array([-1e-4, 2e-4]) * np.exp(-np.arange(ROWS) / 8)[:, None]
    write(tmp_path / "data.csv", q, points)
    problem = po.problem_from_dict(PROBLEM)
    found = po.diagnose(problem, po.read_measurements(tmp_path / "data.csv", problem), flips=99, plan=False)
    (drift,) = moving(found)
    assert (drift.kind, drift.target) == ("drift", "settling")
    assert [rival.kind for rival in drift.confounded_with].count("drift") == 0
    sizes = drift.estimate
    for axis, true in zip("xy", (-1e-4, 2e-4), strict=True):
        assert abs(sizes[axis][0] - true) < 3 * sizes[axis][1]
    constant, std, unit = sizes["constant"]
    assert abs(constant - 8) < 3 * std
    assert unit == "rows"
    assert "the first rows are off, and the measured point settles within" in found.report().replace("\n", " ")
