"""Three reflectors that sag together under a heavy payload: their rows stay, and the compliance is found."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import posture_opt as po

UR10_DH = (
    (0, np.pi / 2, 0.1273), (-0.612, 0, 0), (-0.5723, 0, 0), (0, np.pi / 2, 0.163941), (0, -np.pi / 2, 0.1157),
    (0, 0, 0.0922),
)  # fmt: skip

TARGETS = {"r1": (0.05, 0.0, 0.05), "r2": (-0.05, 0.03, 0.05), "r3": (0.0, -0.06, 0.08)}


def frames(q: np.ndarray) -> list[np.ndarray]:
    """Frames of the joints and of the flange, by the textbook product of Denavit-Hartenberg matrices."""
    found = [np.eye(4)]
    for (a, alpha, d), t in zip(UR10_DH, q, strict=True):
        c, s, ca, sa = np.cos(t), np.sin(t), np.cos(alpha), np.sin(alpha)
        step = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        found.append(found[-1] @ np.array(step))
    return found


@pytest.mark.long
def test_rows_that_agree_are_kept_and_their_cause_is_found() -> None:
    rng = np.random.default_rng(4)
    rows = []
    for k in range(40):
        q = rng.uniform([-2, -2.4, -2, -2, -2, -3], [2, -0.7, 2, 2, 2, 3])
        mass = 30.0 if k % 8 == 0 else 0.5
        plain = frames(q)
        lever = plain[-1][:3, 3] - plain[2][:3, 3]
        q_true = q + np.array([0, 0, 8e-6 * plain[2][:3, 2] @ np.cross(lever, [0, 0, -9.81 * mass]), 0, 0, 0])
        flange = frames(q_true)[-1]
        for name, at in TARGETS.items():
            point = 1e3 * (flange[:3, :3] @ at + flange[:3, 3]) + rng.normal(0, 0.03, 3)
            rows.append([name, *np.degrees(q), *point, mass])
    problem = po.problem_from_dict({
        "robot": {"kind": "preset", "name": "ur10", "base": "free", "tool": "free"},
        "uncertainty": {"measurement": {"position": "0.03 mm"}},
    })  # fmt: skip
    joints = [f"{name} [deg]" for name in problem.robot.joint_names]
    table = pd.DataFrame(rows, columns=["target", *joints, "x [mm]", "y [mm]", "z [mm]", "payload [kg]"])
    found = po.diagnose(problem, po.read_measurements(table, problem), plan=False)
    assert not found.calibration.outliers
    assert ("joint_compliance", "elbow") in [(f.kind, f.target) for f in found.effects]
