"""Limits beyond ±180°: all of the range is searched, and one turn of it where turns are alike."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.robot.posture import drawn_between
from posture_opt.selection.search.multistart import until_recurrence
from tests.helpers.planar_2r import postures_at
from tests.helpers.variants import conformance

# A mobile manipulator's arm on its lift: a [m], alpha, d [m], theta, lower, upper of the turning joints [deg].
ARM = (
    (0.02, 90, 0.337904822, -90, -30, 270),
    (0.02, 90, 0, 180, -140, 65),
    (0.02, 90, 0.33, 0, -150, 150),
    (0.02, 90, 0, 180, -140, 65),
    (0, 90, 0.335510155, 180, -210, 90),
    (-0.07, 90, 0, 180, -108, 172),
    (0, 0, 0, 0, -150, 150),
)
SIGMA_MRAD = (0.526, 0.243, 0.388, 0.298, 0.393, 0.408, 0.661)
BEST = 451.7e-6  # m, by a search of its own over both zeros of the joint; the next best optimum is 457.6 µm


def planar(*limits: tuple[float, float], **task: Any) -> Any:
    joints = [
        {"name": f"joint{k}", "type": "revolute", "a": "1 m", "limits": [f"{low} deg", f"{high} deg"]}
        for k, (low, high) in enumerate(limits, 1)
    ]
    document = {
        "robot": {"kind": "dh", "joints": joints},
        "uncertainty": {"sigma": {"joint1.theta": "1 mrad", "joint2.theta": "1 mrad"}},
        "task": {"kind": "insert", "direction": [0, -1, 0], **task},
    }
    return po.problem_from_dict(document)


def lifted_arm(shift: float) -> Any:
    """The arm on its lift, the zero of its first turning joint moved by ``shift`` [deg]."""
    lift = {"name": "j1", "type": "prismatic", "a": "0.118876313 m", "alpha": "2.0679 rad", "d": "-0.01670607 m"}
    joints: list[dict[str, Any]] = [lift | {"theta": "110 deg", "limits": ["0 m", "0.35 m"]}]
    for k, (a, alpha, d, theta, low, high) in enumerate(ARM):
        moved = shift if k == 0 else 0.0
        keys = {"a": f"{a} m", "alpha": f"{alpha} deg", "d": f"{d} m", "theta": f"{theta + moved} deg"}
        limits = [f"{low - moved} deg", f"{high - moved} deg"]
        joints.append({"name": f"j{k + 2}", "type": "revolute", **keys, "limits": limits})
    sigma = {f"j{k}.theta": f"{value} mrad" for k, value in enumerate(SIGMA_MRAD, 2)}
    lengths = {"j1.d": "0.481 mm", "j1.a": "0.2656 mm", "j2.a": "0.2437 mm", "j3.a": "0.24 mm"}
    base = {"xyz": ["-24.5 mm", "0 m", "845.7 mm"], "rpy": ["0 rad", "0 rad", "0 rad"]}
    tool = {"xyz": ["0 m", "0 m", "70.4 mm"], "rpy": ["0 rad", "0 rad", "180 deg"]}
    task = {
        "kind": "insert", "direction": [0.79107502, 0.3460898, -0.50440277], "tool_axis": [0, 0, 1],
        "criterion": "worst", "position": ["538.2717 mm", "600.5434 mm", "757.3064 mm"],
    }  # fmt: skip
    return po.problem_from_dict({
        "robot": {"kind": "dh", "base": base, "tool": tool, "joints": joints},
        "uncertainty": {"sigma": sigma | lengths}, "task": task,
    })  # fmt: skip


@pytest.mark.parametrize(
    ("limits", "drawn"),
    [
        ((-30, 270), (-30, 270)),
        ((-180, 180), (-180, 180)),
        ((-360, 360), (-180, 180)),
        ((-10, 720), (-10, 350)),
        ((-500, -100), (-460, -100)),
        ((200, 800), (200, 560)),
        ((190, 300), (190, 300)),
    ],
)
def test_a_turn_of_the_limits_is_drawn(limits: tuple[float, float], drawn: tuple[float, float]) -> None:
    """Every angle within the limits lies whole turns from exactly one that is drawn, or is drawn itself."""
    robot = planar(limits, (-90, 90), position=["0.9 m", "0.4 m", "0 m"]).robot
    low, high = (np.rad2deg(ends) for ends in drawn_between(robot))
    assert (low[0], high[0]) == pytest.approx(drawn)
    assert (low[1], high[1]) == pytest.approx((-90, 90))
    low, high = (np.rad2deg(ends) for ends in drawn_between(robot, whole=[0]))
    assert (low[0], high[0]) == pytest.approx(limits)


@pytest.mark.parametrize(
    ("shift", "seeds"),
    conformance([(0.0, (1,)), (0.0, tuple(range(6))), (120.0, tuple(range(6)))], always=[(0.0, (1,))]),
)
def test_where_the_zero_of_a_joint_lies_changes_nothing(shift: float, seeds: Sequence[int]) -> None:
    selector = po.PostureSelector(lifted_arm(shift), compiled=None if len(seeds) > 1 else False)
    engine = selector.engine(selector.target)
    found = [until_recurrence(engine, selector.target, seed).found[0] for seed in seeds]
    assert [each.sigma for each in found] == pytest.approx([BEST] * len(seeds), rel=2e-3)
    assert {round(math.degrees(each.q[1]) + shift) for each in found} == {270}


def test_turns_that_a_distance_tells_apart_are_all_searched() -> None:
    """Of both elbows and all their turns within the limits, the nearest to the posture asked for."""
    wanted = np.deg2rad([310.0, -280.0])
    posture = {"joint1": "310 deg", "joint2": "-280 deg"}
    near = [{"kind": "near_posture", "weight": 100, "posture": posture}]
    position = ["0.9 m", "0.4 m", "0 m"]
    solution = po.select_posture(planar((-360, 360), (-360, 360), position=position, minimize=near))
    turns = np.array(list(itertools.product((-360, 0, 360), repeat=2)))
    every = np.concatenate([q + np.deg2rad(turns) for q in postures_at(np.array([0.9, 0.4]))])
    every = every[np.all(np.abs(every) <= 2 * np.pi, axis=1)]
    nearest = every[np.argmin(np.linalg.norm(every - wanted, axis=1))]
    assert np.asarray(list(solution.posture.values())) == pytest.approx(nearest, abs=1e-5)
