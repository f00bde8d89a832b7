"""Changes of a problem without a file: what they reach, in which units, and what they refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po


@pytest.fixture(scope="module")
def panda() -> po.Problem:
    return po.load_problem("insert_panda")


def same_as_file(problem: po.Problem) -> None:
    """A replaced problem is the one that its own file holds."""
    again = po.problem_from_dict(problem.to_dict(), problem.folder)
    assert again.task == problem.task
    assert again.robot == problem.robot
    np.testing.assert_array_equal(again.sources.covariance, problem.sources.covariance)


def test_si_and_units_say_the_same(panda: po.Problem) -> None:
    si = panda.replace(
        task__position=np.array([0.55, 0.1, 0.2]),
        uncertainty__repeatability=5e-5,
        robot__payload=np.float64(1.5),
        robot__tool={"xyz": [0, 0, 0.12], "rpy": (0, 0, np.pi / 2)},
    )
    written = panda.replace(
        task__position=["550 mm", "10 cm", "0.2 m"],
        uncertainty__repeatability="0.05 mm",
        robot__payload="1.5 kg",
        robot__tool={"xyz": ["0 m", "0 m", "120 mm"], "rpy": ["0 deg", "0 deg", "90 deg"]},
    )
    assert si.task.position == pytest.approx((0.55, 0.1, 0.2), rel=1e-15)
    assert written.task.position == pytest.approx(si.task.position, rel=1e-15)
    np.testing.assert_allclose(si.sources.covariance, written.sources.covariance, rtol=1e-14)
    q = [0.1, 0.2, 0.3, -1.5, 0.2, 1.5, 0.1]
    np.testing.assert_allclose(po.propagate(si, q).position, po.propagate(written, q).position, rtol=0, atol=1e-15)
    assert si.robot.payload == 1.5
    same_as_file(si)


def test_numbers_of_joints_and_parameters_take_the_unit_of_their_name() -> None:
    scara = po.load_problem("insert_scara")
    turning, sliding = (next(j for j in scara.robot.joints if j.type == t) for t in ("revolute", "prismatic"))
    changed = scara.replace(uncertainty={"sigma": {f"{turning.name}.theta": 1e-3, f"{sliding.name}.d": 1e-5}})
    assert dict(zip(changed.sources.names, changed.sources.sigma, strict=True)) == pytest.approx(
        {f"{turning.name}.theta": 1e-3, f"{sliding.name}.d": 1e-5}
    )
    held = [{"kind": "near_posture", "posture": {turning.name: 0.3, sliding.name: 0.05}, "at_most": 0.5}]
    term = scara.replace(task__subject_to=held).to_dict()["task"]["subject_to"][0]
    assert term["posture"] == {turning.name: "0.3 rad", sliding.name: "0.05 m"}
    assert term["at_most"] == "0.5 rad"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"task__positoin": [0, 0, 0]}, "task.positoin: unknown key – did you mean 'position'"),
        ({"task__position": [0.1, 0.2]}, "task.position: a position has three coordinates, 2 are given"),
        ({"task__clearance": "5 kg"}, "task.clearance: 'kg' is not a unit of length"),
        ({"uncertainty__repeatability": "0.05"}, "uncertainty.repeatability: the length has no unit"),
        ({"task__clearance__x": 1}, "task.clearance: '0.2 mm' stands here, which has no key 'x'"),
        ({"task__subject_to__7__at_least": 1}, r"the list has no such entry – one of: 0"),
        ({"robot__payload": float("nan")}, "robot.payload: nan is not a finite number"),
        ({"robot__name": "panta"}, "robot.name: there is no preset 'panta' – did you mean 'panda'"),
        ({"tsk__position": 1}, "tsk: unknown key – did you mean 'task'"),
    ],
)
def test_what_does_not_fit_is_named_by_its_key(panda: po.Problem, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(po.errors.InputError, match=message):
        panda.replace(**changes)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("insert_pandas", "did you mean the built-in 'insert_panda'\\?"),
        ("insert_pan", "the built-in 'insert_panda', 'insert_panda_block' or 'insert_panda_cell'"),
        ("nothing_like_it", "the built-in problems are custom_planar_2r, "),
        ("somewhere/else.yaml", "'optimize-posture new planar_2r' prints"),
    ],
)
def test_a_name_that_is_no_problem_lists_those_that_are(
    name: str, hint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(po.errors.InputError, match=hint):
        po.load_problem(name)
    assert po.load_problem("insert_panda").name == "Vertical insertion with a Panda"
