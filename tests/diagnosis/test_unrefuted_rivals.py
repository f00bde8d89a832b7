"""Which causes are told apart where a model leaves structure: half of equal causes must not be refuted by chance."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.search.unrefuted_rivals import _Comparison
from posture_opt.model.effects import JointCompliance
from tests.helpers.real_arms import DATA, long_on_real_arms

ROWS, BLOCKS, BLOCK = 200, 20, 3


def comparison(seed: int, share: float, patch: float) -> tuple[Any, np.ndarray]:
    """A member and a rival at 25 degrees; ``share`` of the signal is the member's, ``patch`` the size of what neither
    explains, one draw in each block of rows."""
    rng = np.random.default_rng(seed)
    m = ROWS * BLOCK
    groups = np.repeat(np.arange(BLOCKS), ROWS // BLOCKS)
    Z, other = rng.normal(size=(m, 1)), rng.normal(size=(m, 1))
    rival = np.cos(np.radians(25)) * Z + np.sin(np.radians(25)) * other
    r = share * Z[:, 0] + (1 - share) * rival[:, 0] + rng.normal(size=m)
    # What is left out acts along both, in one block one way and in the next the other: as a third cause would.
    r += patch * np.repeat(rng.normal(size=BLOCKS)[groups], BLOCK) * (Z[:, 0] - rival[:, 0])
    data = SimpleNamespace(G=rng.normal(size=(m, 6)), r=r)
    data.sensitivities = SimpleNamespace(residuals=SimpleNamespace(block=BLOCK))
    member = Candidate(JointCompliance(joint="elbow"), Z)
    return _Comparison.of(data, [member], groups), rival  # type: ignore[arg-type]


def refuted(share: float, patch: float, draws: int = 300) -> float:
    cases = (comparison(seed, share, patch) for seed in range(draws))
    return float(np.mean([not found.unrefuted(0, rival, found.outside(rival)) for found, rival in cases]))


@pytest.mark.parametrize("patch", [0.0, 3.0])
def test_of_two_causes_that_explain_alike_the_other_is_seldom_refuted(patch: float) -> None:
    """One-sided 2.3 % with two standard errors; 20 blocks have longer tails, and 300 draws scatter by 1.3 %."""
    assert refuted(0.5, patch) < 0.06


def test_what_explains_clearly_less_everywhere_is_refuted() -> None:
    assert refuted(1.0, 0.0) > 0.98


def test_a_cause_at_a_right_angle_is_no_rival() -> None:
    found, rival = comparison(0, 0.5, 3.0)
    away = rival - found.directions[0] @ (found.directions[0].T @ rival)
    assert not found.unrefuted(0, away, found.outside(away))


@long_on_real_arms
def test_two_series_of_one_arm_agree_on_what_its_sag_could_be() -> None:
    """Series B names the shoulder's compliance with that of the column as a rival; by the criterion D refuted it."""
    problem = po.load_problem(DATA / "ipa_ur10" / "problem.yaml")
    data = po.read_measurements(DATA / "ipa_ur10" / "series_d.csv", problem)
    found = po.diagnose(problem, data, plan=False)
    (sag,) = [f for f in found.effects if f.kind == "joint_compliance"]
    assert ("link_bending", "shoulder_pan") in {(c.kind, c.target) for c in sag.confounded_with}
