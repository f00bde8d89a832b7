"""Effects that the file states already and that the data change: what is found adds to them, and is delivered so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, planar_rows

NOISE = 2e-5  # m
ROWS = 200


def diagnosed(stated: dict[str, Any], turns: Any) -> tuple[po.Diagnosis, po.Measurements]:
    """Of an arm whose first joint errs by ``turns(q, t)`` [rad] where the file states an effect of its own."""
    rng = np.random.default_rng(2)
    q, t = rng.uniform(-2.5, 2.5, (ROWS, 2)), np.arange(float(ROWS))
    turned = q + np.stack([turns(q, t), 0 * t], axis=1)
    points = position(turned) + rng.normal(0, NOISE, q.shape)
    problem, data = planar_rows(q, points, {**PROBLEM, "effects": [stated]}, time=("s", t))
    return po.diagnose(problem, data, flips=99, folds=3, plan=False, with_time=True), data


def test_a_joint_may_slip_again_at_another_moment() -> None:
    stated = {"kind": "slip", "of": "joint1", "moment": "59.5 s", "estimate": {"step": "0.2 mrad"}}
    found, data = diagnosed(stated, lambda q, t: 2e-4 * (t >= 60) + 5e-4 * (t >= 140))
    (slip,) = [effect for effect in found.effects if effect.kind == "slip"]
    step, std, _ = slip.estimate["step"]
    assert step == pytest.approx(5e-4, abs=4 * std)
    assert slip.estimate["moment"][0] == pytest.approx(139.5, abs=0.6)
    # Rows beside the moment are on either side of it for a fold that has not seen them.
    clear = np.abs(data.time - 139.5) > 3
    errors = found.held["extended"].errors[clear]
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) < 1.15 * np.sqrt(2) * NOISE
    assert [e.values[0] for e in found.extended.effects] == pytest.approx([2e-4, 5e-4], abs=4 * std)


def test_the_delivered_file_has_the_shape_that_was_found() -> None:
    """``dq = −h side (1 − exp(−move / travel))``: 0.6 mrad and 0.1 rad where the file says 0.2 mrad and 1 rad."""

    def turns(q: np.ndarray, t: np.ndarray) -> np.ndarray:
        move = np.diff(q[:, 0], prepend=q[0, 0])
        return np.asarray(-6e-4 * np.sign(move) * (1 - np.exp(-np.abs(move) / 0.1)))

    stated = {"kind": "hysteresis", "joint": "joint1", "travel": "1 rad", "estimate": {"height": "0.2 mrad"}}
    found, data = diagnosed(stated, turns)
    (effect,) = [e for e in found.extended.effects if e.kind == "hysteresis"]
    assert effect.values == pytest.approx([6e-4], rel=0.05)
    (said,) = [e["estimate"] for e in found.to_json()["effects"] if e["kind"] == "hysteresis"]
    assert said["height"]["value"] == pytest.approx(effect.values[0], rel=1e-9)  # the total, not the change
    assert said["height"]["stated"] == pytest.approx(2e-4)
    assert said["travel"]["unit"] == "rad"
    delivered = po.calibrate(found.extended, data, plan=False).to_json()["residual_rms"]["nominal"]
    assert delivered < 1.1 * found.to_json()["residual_rms"]["extended"]
