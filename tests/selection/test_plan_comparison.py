"""One task for several arms or models: each answer is its own solve, judged by closed forms and Monte Carlo."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import posture_opt as po
from posture_opt.robot.corrections import deviated
from tests.helpers.planar_2r import position
from tests.helpers.said import said
from tests.helpers.stated import Sources

LONGER = 3e-4  # m of the second link


def problem(**keys: object) -> po.Problem:
    joint = {"type": "revolute", "a": "1 m"}
    data = {
        "robot": {"kind": "dh", "joints": [{"name": name, **joint} for name in ("joint1", "joint2")]},
        "uncertainty": {"sigma": {"joint1.theta": "0.1 mrad", "joint2.theta": "0.3 mrad"}},
        "task": {"kind": "insert", "direction": [0, -1, 0], "position": ["0.9 m", "0.4 m", "0 m"]},
        "solver": {"starts": 8},
    }
    return po.problem_from_dict({**data, **keys})


@pytest.fixture(scope="module")
def models() -> dict[str, po.Problem]:
    nominal = problem()
    return {
        "nominal": nominal,
        "calibrated": replace(nominal, arm=po.Arm(deviated(nominal.robot, {"joint2.a": LONGER}))),
    }


def test_the_last_model_judges_every_posture(models: dict[str, po.Problem]) -> None:
    found = po.compare_plans(models)
    assert found is not None
    assert found.reference == "calibrated"
    nominal = found.answered["nominal"]
    (solution,), predicted = nominal.stations, nominal.judged["calibrated"].worst
    truth = position(solution.q[None], (1.0, 1.0 + LONGER))[0] - (0.9, 0.4)
    # What the arm misses by its longer link; the bias of joints that scatter by 0.3 mrad is below 0.1 µm.
    np.testing.assert_allclose(predicted.miss[:2], truth, atol=1e-7)
    assert predicted.distance == pytest.approx(abs(truth[0]), abs=1e-7)
    assert predicted.critical_error > predicted.distance
    assert found.answered["calibrated"].judged["calibrated"].distance < 1e-7
    document = found.to_json()
    assert set(document) == {"nominal", "calibrated", "reasons", "statements"}
    assert document["nominal"]["posture"] == solution.posture
    assert document["nominal"]["success_probability"] is None


def test_a_model_without_scatter_takes_that_of_the_reference(models: dict[str, po.Problem]) -> None:
    silent = replace(models["nominal"], sources=Sources())
    with_own, without = (
        po.compare_plans({**models, "nominal": nominal}) for nominal in (models["nominal"], silent)
    )  # fmt: skip
    assert with_own is not None
    assert without is not None
    assert without.to_json() == with_own.to_json()


def test_why_a_model_has_no_posture_is_told_once_with_the_hint(models: dict[str, po.Problem]) -> None:
    far = {name: model.with_task(position=["3 m", "0 m", "0 m"]) for name, model in models.items()}
    found = po.compare_plans(far, hint="the world is elsewhere")
    assert found is not None
    assert not found.answered
    assert found.reasons[0].startswith("the target is out of reach")
    assert found.reasons[1:] == ("the world is elsewhere",)
    assert found.to_json()["nominal"] is None
    only_one = po.compare_plans({"nominal": far["nominal"], "calibrated": models["calibrated"]})
    assert only_one is not None
    assert list(only_one.answered) == ["calibrated"]
    assert only_one.reasons == found.reasons[:1]


TASK = {"kind": "insert", "direction": [0, -1, 0], "position": ["0.9 m", "0.7 m", "0 m"], "clearance": "10 mm"}
NAMES = {"joint1.theta": "2 mrad", "joint2.theta": "2 mrad"}


def planar(*, task: dict | None = None, corrections: dict | None = None, sigma: dict | None = None) -> po.Problem:
    robot = {"kind": "preset", "name": "planar_2r", **({"corrections": corrections} if corrections else {})}
    data = {"robot": robot, "uncertainty": {"sigma": sigma or NAMES}}
    return po.problem_from_dict({**data, **({"task": task} if task else {})})


def test_every_arm_has_its_own_best_posture():
    rough, fine = planar(task=TASK), planar(task=TASK, sigma={"joint1.theta": "1 mrad", "joint2.theta": "4 mrad"})
    found = po.compare({"rough": rough, "fine": fine})
    for name, problem in (("rough", rough), ("fine", fine)):
        alone = po.select_posture(problem)
        assert found.arms[name].answer.posture == pytest.approx(alone.posture, abs=1e-9)
        assert found.arms[name].judged[name].sigma_max == pytest.approx(alone.critical.sigma_max, rel=1e-9)
    sigmas = {name: arm.judged[name].sigma_max for name, arm in found.arms.items()}
    assert found.best == min(sigmas, key=sigmas.get)


def test_a_judgement_is_where_the_other_arm_lands():
    nominal = planar(task=TASK)
    true = planar(
        task=TASK, corrections={"joint1.a": "4 mm", "joint2.theta": "3 mrad"}, sigma={"joint2.theta": "1 mrad"}
    )
    found = po.compare({"nominal": nominal, "true": true})
    plan = found.arms["nominal"].judged["true"]
    q1, q2 = found.arms["nominal"].answer.posture.values()
    # The planar arm by hand, its first link 4 mm longer and its second joint 3 mrad off.
    angles = q1 + q2 + 3e-3 + np.random.default_rng(0).normal(0, 1e-3, 200_000)
    x = 1.004 * math.cos(q1) + np.cos(angles) - 0.9
    assert plan.distance == pytest.approx(abs(x.mean()), rel=1e-3)
    assert plan.sigma_max == pytest.approx(x.std(), rel=0.01)
    assert plan.success_probability == pytest.approx(np.mean(np.abs(x) <= 10e-3), abs=5e-3)
    assert np.mean(np.abs(x) <= plan.critical_error) == pytest.approx(0.95, abs=3e-3)
    assert found.arms["true"].judged["true"].distance < 1e-5


def test_the_task_of_the_first_goes_to_all():
    other = planar(task={**TASK, "position": ["1.2 m", "0.2 m", "0 m"]})
    found = po.compare({"a": planar(task=TASK), "b": other, "c": planar()})
    assert np.allclose(found.arms["b"].answer.target.lower, [0.9, 0.7, 0.0])
    told = [(note.id, note.values["arm"]) for note in found.notes]
    assert told == [("selection.task-replaced", "b"), ("selection.task-shared", "c")]


def test_an_arm_that_cannot_is_told_with_its_reason():
    joints = [
        {"name": name, "type": "revolute", "a": "0.2 m", "alpha": "0 deg", "d": "0 m", "theta": "0 deg"}
        for name in ("j1", "j2")
    ]
    short = {"kind": "dh", "joints": joints}
    small = po.problem_from_dict({"robot": short, "uncertainty": {"sigma": {"j1.theta": "1 mrad"}}})
    found = po.compare({"long": planar(task=TASK), "short": small})
    assert found.arms["short"].answer is None
    assert found.best == "long"
    assert said(found)["selection.arm-cannot"].about == "short"
    with pytest.raises(po.errors.NoSolutionError, match="short: "):
        po.compare({"short": small.with_task(**TASK), "other": small})


def test_no_task_and_one_problem_are_refused():
    with pytest.raises(po.errors.InputError, match="no task to compare"):
        po.compare({"a": planar(), "b": planar(task=TASK)})
    with pytest.raises(po.errors.InputError, match="two problems"):
        po.compare({"a": planar(task=TASK)})
