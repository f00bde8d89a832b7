"""Configurations against all postures at one pose, found by a solver of the tests' own, and against plane geometry."""

from __future__ import annotations

import itertools
import math

import numpy as np

import posture_opt as po
from posture_opt.selection.answer.other_postures import configurations
from tests.helpers.factors import frame, pose
from tests.helpers.planar_2r import postures_at
from tests.helpers.shipped import preset_robot


def ur_branches(robot, q):
    """(≤ 8, 6) all postures of a UR at the pose of ``q``, by Gauss and Newton's method from random ones."""
    goal, found = pose(robot, q), []
    rng = np.random.default_rng(0)
    for _ in range(300):
        x = rng.uniform(-np.pi, np.pi, 6)
        for _ in range(60):
            T = pose(robot, x)
            r = np.concatenate([(goal - T)[:3, 3], 0.3 * (goal - T)[:3, :3].ravel()])
            J = np.array([
                np.concatenate([(pose(robot, x + h) - T)[:3, 3], 0.3 * (pose(robot, x + h) - T)[:3, :3].ravel()]) / 1e-6
                for h in 1e-6 * np.eye(6)
            ]).T  # fmt: skip
            step = np.linalg.lstsq(J, r, rcond=1e-9)[0]
            x = x + step * min(1.0, 0.5 / max(np.abs(step).max(), 1e-12))
            if np.linalg.norm(r) < 1e-9:
                break
        x = (x + np.pi) % (2 * np.pi) - np.pi
        if np.linalg.norm(r) < 1e-7 and all(np.abs(np.exp(1j * x) - np.exp(1j * y)).max() > 1e-3 for y in found):
            found.append(x)
        if len(found) == 8:
            break
    return np.array(found)


def test_the_eight_postures_of_a_ur_are_eight_configurations() -> None:
    robot = preset_robot("ur5e")
    Q = ur_branches(robot, np.array([0.4, -1.3, 1.5, -1.0, -1.2, 0.3]))
    named = configurations(robot, Q)
    assert len(set(named)) == len(Q) == 8
    for q, (shoulder, elbow, wrist) in zip(Q, named, strict=True):
        # The elbow is above the chord from the shoulder to the fourth axis, in the plane of the arm.
        shoulder_at, elbow_at, wrist_at = (frame(robot, q, k)[:3, 3] for k in (0, 1, 2))
        chord, bend = wrist_at - shoulder_at, elbow_at - shoulder_at
        share = (bend @ chord) / (chord @ chord)
        ahead = frame(robot, q, 4)[:3, 3] - frame(robot, q, 0)[:3, 3]
        forward = np.array([chord[0], chord[1], 0]) @ np.array([ahead[0], ahead[1], 0]) > 0
        assert (elbow == "elbow up") == (((bend - share * chord)[2] > 0) == forward)
        assert wrist in ("wrist flipped", "wrist not flipped")
        # A shoulder is one angle of the pan.
        same = [p for p, other in zip(Q, named, strict=True) if other[0] == shoulder]
        assert all(abs(math.remainder(p[0] - q[0], 2 * math.pi)) < 1e-6 for p in same)
    by_sign = {
        wrist: {bool(np.sin(q[4]) > 0) for q, n in zip(Q, named, strict=True) if n[2] == wrist} for *_, wrist in named
    }
    assert all(len(signs) == 1 for signs in by_sign.values())


def test_the_elbow_of_a_planar_arm_is_left_or_right_of_the_line_to_the_tool() -> None:
    robot = preset_robot("planar_2r")
    for point in np.random.default_rng(2).uniform(-1.2, 1.2, (20, 2)):
        for q in postures_at(point):
            if np.isnan(q).any():
                continue
            elbow = np.array([math.cos(q[0]), math.sin(q[0])])
            left = point[0] * elbow[1] - point[1] * elbow[0] > 0
            assert configurations(robot, [q]) == [("elbow left" if left else "elbow right",)]


def test_alternatives_are_one_of_each_configuration_best_first() -> None:
    """A UR10 whose spin is free: at most eight, their signs all different, none better than the first."""
    solution = po.select_posture(po.load_problem("insert_ur10"))
    named = [a.configuration for a in solution.alternatives]
    assert len(set(named)) == len(named) <= 8
    assert all(named)
    sigma = [a.sigma_max for a in solution.alternatives]
    assert all(b >= a * (1 - 1e-9) for a, b in itertools.pairwise(sigma))
    assert list(solution.alternatives[0].posture.values()) == list(solution.posture.values())
    assert {a.configuration for a in solution.optima} == set(named)
    text = " ".join(solution.report().split())
    assert "configuration" in text
    assert solution.to_json()["alternatives"][0]["configuration"] == ", ".join(named[0])
