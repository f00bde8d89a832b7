"""Of unknown loads the turn about its mean is stated: it has to be determined, whatever else moves the tool."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

import posture_opt as po
from posture_opt.calibration.estimation.effects_fit import fit_with_effects
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.causes.determined_sizes import determined_parts, stated_parts, turn_about_mean, turns_of
from posture_opt.model.effects.joint_compliance import JointCompliance
from tests.helpers.planar_files import write

LINK, LOAD_PER_KG = 1.0, 9.81  # m, N m/kg at 1 m
COMPLIANCE = 1e-5  # rad per N m


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    """Two links in a vertical plane, measured while stretched out to one side; joint1 sags by 2 kg at the tip."""
    rng = np.random.default_rng(7)
    q = np.stack([rng.uniform(-0.5, 0.5, 80), rng.uniform(-1.5, 1.5, 80)], axis=1)
    load = 2.0 * LOAD_PER_KG * (LINK * np.cos(q[:, 0]) + LINK * np.cos(q.sum(axis=1)))
    first = q[:, 0] - COMPLIANCE * load
    both = first + q[:, 1]
    points = LINK * np.stack([np.cos(first) + np.cos(both), np.sin(first) + np.sin(both)], axis=1)
    file: Path = tmp_path_factory.mktemp("turns") / "data.csv"
    write(file, q, points + rng.normal(0, 1e-5, points.shape))
    joints = [{"name": f"joint{i}", "type": "revolute", "a": "1 m"} for i in (1, 2)]
    problem = po.problem_from_dict(
        {
            "robot": {"kind": "dh", "joints": joints, "gravity": [0, -9.81, 0]},
            "uncertainty": {"measurement": {"position": "0.01 mm"}},
        }
    )
    data = po.read_measurements(file, problem)
    calibration = po.calibrate(problem, data)
    residuals = calibration.residuals
    effect = JointCompliance(joint="joint1", loads="points", points=("tool", "joint1"))
    return fit_with_effects(residuals, calibration.x, calibration.identifiability.directions, [effect])


def with_uncertain_turns(fit: Fit, share: float) -> Fit:
    """The same estimate, uncertain by a share of the turn about its mean, where the tool moves least by it."""
    own = fit.slices[0]
    turns, moves = turns_of(fit, 0)[0], fit.effect_columns(0)
    turns = turns - turns.mean(axis=0)
    ways = eigh(turns.T @ turns, moves.T @ moves)[1]
    step = np.zeros(len(fit.x))
    step[own] = ways[:, -1] * share * np.linalg.norm(turns @ fit.x[own]) / np.linalg.norm(turns @ ways[:, -1])
    way = np.linalg.pinv(fit.directions) @ step
    return replace(fit, C=fit.C + np.outer(way, way))


def test_a_turn_within_its_error_is_not_stated(fit: Fit) -> None:
    """Though what the effect does to the tool is certain: a mean turn, mostly, as an offset of the joint has."""
    assert stated_parts(fit, 0) == determined_parts(fit, 0) == (0,)
    size, std = turn_about_mean(fit, 0, [0])
    turn = turns_of(fit, 0)[0] @ fit.x[fit.slices[0]]
    assert size == pytest.approx(np.std(turn))
    assert std < 0.1 * size
    doubtful = with_uncertain_turns(fit, 0.7)
    assert determined_parts(doubtful, 0) == (0,)
    assert stated_parts(doubtful, 0) == ()
    size, std = turn_about_mean(doubtful, 0, [0])
    assert size < 1.96 * std
    assert stated_parts(with_uncertain_turns(fit, 0.3), 0) == (0,)
