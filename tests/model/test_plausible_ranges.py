"""What a cause can be on an arm: ranges with their sources, against loads and figures worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

import posture_opt as po
from posture_opt.model.effects import EFFECTS, Effect, FittedSizes
from posture_opt.model.effects.base.multiples import rotating_parts
from posture_opt.model.effects.base.plausible_range import CATALOGUE, PlausibleRange, least_stiffness
from posture_opt.model.effects.joint_compliance import JointCompliance
from posture_opt.model.effects.joint_coupling import JointCoupling
from tests.helpers.effect_cases import SHAPES, instances


def arm(mass: float) -> po.Problem:
    """Two links of 1 m in a vertical plane, a point mass at the end of each."""
    joint = {"type": "revolute", "a": "1 m", "alpha": "0 deg", "d": "0 m", "theta": "0 deg"}
    limits = {"limits": ["-180 deg", "180 deg"], "mass": f"{mass} kg", "com": ["0 m", "0 m", "0 m"]}
    joints = [{"name": name, **joint, **limits} for name in ("joint1", "joint2")]
    return po.problem_from_dict({"robot": {"kind": "dh", "joints": joints, "gravity": [0, -9.81, 0]}})


@pytest.mark.parametrize("mass", [0.05, 1.0, 10.0, 60.0])
def test_the_softest_gear_is_the_smallest_that_carries_the_stretched_arm(mass: float) -> None:
    robot = arm(mass).robot
    stretched = (9.81 * mass * (1 + 2), 9.81 * mass * 1)  # N m
    for joint, load in enumerate(stretched):
        smallest = next(stiffness for _, rated, stiffness in CATALOGUE if rated >= load)
        assert least_stiffness(robot, joint) == pytest.approx(smallest / 4)


def test_catalogue_gears_twist_by_some_milliradians_under_their_rated_torque() -> None:
    rated, stiffness = np.array([row[1:] for row in CATALOGUE]).T
    assert np.all(np.diff(rated) > 0)
    assert np.all(np.diff(stiffness) > 0)
    assert np.all(rated / stiffness < 2.7e-3)


@pytest.mark.parametrize(("stiffness", "plausible"), [(44.0, False), (4400.0, True), (2e4, True)])
def test_a_wrist_a_hundred_times_too_soft_is_told(stiffness: float, plausible: bool) -> None:
    """The wrist that was seen on an ABB IRB 120."""
    robot = po.problem_from_dict({"robot": {"kind": "preset", "name": "irb120"}}).robot
    effect = JointCompliance(joint=robot.joint_names[4])
    estimate = FittedSizes({"compliance": (1 / stiffness, 0.05 / stiffness, "rad/(N*m)")})
    known = effect.plausible(robot)
    assert known is not None
    assert known.holds(*effect.plausible_size(estimate)) is plausible
    assert "softer" in known.would_need(1 / stiffness)


def test_couplings_are_of_neighbours_and_of_the_wrist() -> None:
    robot = po.problem_from_dict({"robot": {"kind": "preset", "name": "ur10"}}).robot
    names = robot.joint_names
    found = {
        (a, b)
        for a in range(6)
        for b in range(6)
        if a != b and JointCoupling(joint=names[b], follows=names[a]).plausible(robot) is None
    }
    assert found == {(a, b) for a in range(6) for b in range(6) if abs(a - b) == 1 or {a, b} == {3, 5}}
    far = JointCoupling(joint="wrist_1", follows="shoulder_pan").plausible(robot)
    assert far is not None
    assert "shoulder_lift and elbow" in far.would_need(1e-3)


@pytest.mark.parametrize(
    ("lines", "stated", "expected"),
    [
        ((80.0,), math.nan, [(80.0, 1)]),
        ((239.7,), math.nan, [(120.0, 2)]),
        ((101.2, 202.1), math.nan, [(101.0, 1), (101.0, 2)]),
        ((80.1, 160.1, 240.2), math.nan, [(80.0, 1), (80.0, 2), (80.0, 3)]),
        ((13.5, 27.0), math.nan, []),
        ((40.0, 80.0, 160.0), math.nan, []),
        ((80.0,), 101.0, []),
        ((202.0,), 101.0, [(101.0, 2)]),
    ],
)
def test_lines_are_told_by_the_part_that_turns_so_often(
    lines: tuple[float, ...], stated: float, expected: list
) -> None:
    parts = rotating_parts(lines, stated)
    assert [(part.ratio, part.per_turn) for part in parts] == expected
    assert all("per revolution of the motor" in part.words for part in parts)


@pytest.mark.parametrize("cls", EFFECTS, ids=lambda cls: cls.kind_name())
def test_every_range_has_a_source_and_says_what_it_takes(cls: type[Effect], sites) -> None:
    for name in SHAPES:
        site, robot, _ = sites[name]
        for effect in instances(cls, site, robot):
            known = effect.plausible(robot)
            if known is None:
                continue
            assert isinstance(known, PlausibleRange)
            assert known.low <= known.high
            assert known.source
            assert known.needs
            assert known.to_json()["unit"]
            assert effect.title in effect.looks_like
