"""Tasks that cannot be done: the reason is the requirement that was made impossible, and what is offered does help."""

from __future__ import annotations

import json
import math
from itertools import product
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.selection.answer.infeasible import Infeasibility
from posture_opt.selection.search.relaxation import shown_apart
from posture_opt.selection.terms import TERMS
from tests.helpers import brute_force
from tests.helpers.changes import changed
from tests.helpers.said import said
from tests.helpers.variants import conformance

POINTS = {"ur10": [0.6, 0.2, 0.1], "panda": [0.45, 0.1, 0.2], "scara": [0.28, 0.15, -0.05]}
FAR = {"ur10": [1.2, 0.9, 0.1], "panda": [0.8, 0.5, 0.2], "scara": [0.9, 0.2, -0.05]}
TURNED = {
    "ur10": {"shoulder_pan": "80 deg", "shoulder_lift": "-60 deg"},
    "panda": {"panda_joint1": "80 deg", "panda_joint2": "80 deg"},
    "scara": {"joint1": "80 deg", "joint2": "80 deg"},
}
BOUNDED: dict[str, dict[str, Any]] = {
    "link_height": {"at_least": "2 m"}, "singularity_margin": {"at_least": "2 m"},
    "manipulability": {"at_least": "9 m"}, "spread": {"within": "all", "at_most": "1 um"},
    "orientation_spread": {"of": "spin", "at_most": "0.00001 deg"}, "success": {"at_least": 0.999},
    "joint_torque": {"at_most": "0.5 N m"}, "limit_margin": {"at_least": "179 deg"},
}  # fmt: skip
UNWEIGHED = "scara"  # without masses, no torque
HEAVY = ("ur10", "joint_torque")
BOUNDS = [pair for pair in product(("scara", "ur10"), BOUNDED) if pair not in ((UNWEIGHED, "joint_torque"), HEAVY)]
ALWAYS = [("scara", "limit_margin")]  # two others: test_two_terms_that_fail_are_both_named


def asked(robot: str, position: list[float], **task: Any) -> dict[str, Any]:
    return {
        "robot": {"kind": "preset", "name": robot},
        "uncertainty": {"repeatability": "0.05 mm"},
        "task": {"kind": "insert", "position": [f"{x} m" for x in position], **task},
    }


def refused(data: dict[str, Any]) -> po.Solution:
    with pytest.raises(po.errors.NoSolutionError) as caught:
        po.select_posture(po.problem_from_dict(data))
    solution = caught.value.solution
    assert isinstance(solution, po.Solution)
    document = json.loads(json.dumps(solution.to_json(), allow_nan=False))
    assert len(document["relaxations"]) == len(solution.relaxations) > 0
    costs = [relaxation.cost for relaxation in solution.relaxations]
    assert costs == sorted(costs)
    return solution


def assert_all_do(data: dict[str, Any], solution: po.Solution) -> None:
    """Every change that is offered makes the problem one that is solved, by the public way."""
    for relaxation in solution.relaxations:
        solved = po.select_posture(changed(po.problem_from_dict(data), relaxation))
        assert solved.status != "infeasible", relaxation.change


def test_every_term_has_a_case_that_cannot_be_met() -> None:
    cases = {*BOUNDED, "near_posture", "fixed_joints"}
    assert {term.model_fields["kind"].annotation.__args__[0] for term in TERMS} == cases  # type: ignore[union-attr]


every_robot = pytest.mark.parametrize("robot", conformance(["scara", "ur10"], ["scara"]))


class TestWhatIsOffered:
    @pytest.mark.parametrize(
        ("robot", "kind"), [*conformance(BOUNDS, ALWAYS), pytest.param(*HEAVY, marks=pytest.mark.long)]
    )
    def test_a_term_is_named_and_each_change_helps(self, robot: str, kind: str) -> None:
        bound = {**BOUNDED[kind]}
        if kind == "limit_margin" and robot == "ur10":
            bound["at_least"] = "350 deg"  # of 360 on either side
        data = asked(robot, POINTS[robot], clearance="5 um", subject_to=[{"kind": kind, **bound}])
        solution = refused(data)
        (reason,) = solution.reasons
        assert reason.requirement.startswith(kind)
        assert_all_do(data, solution)

    @every_robot
    def test_a_posture_far_away_offers_a_move_too(self, robot: str) -> None:
        near = {"kind": "near_posture", "posture": TURNED[robot], "at_most": "2 deg"}
        data = asked(robot, POINTS[robot], subject_to=[near])
        solution = refused(data)
        assert [reason.requirement for reason in solution.reasons] == ["near_posture"]
        assert {r.reasons[0].requirement for r in solution.relaxations} >= {"near_posture", "target"}
        assert_all_do(data, solution)

    @every_robot
    def test_two_terms_that_fail_are_both_named(self, robot: str) -> None:
        terms = [{"kind": kind, **BOUNDED[kind]} for kind in ("spread", "link_height")]
        data = asked(robot, POINTS[robot], subject_to=terms)
        solution = refused(data)
        assert {reason.requirement.split(" ")[0] for reason in solution.reasons} == {"spread", "link_height"}
        assert_all_do(data, solution)

    @every_robot
    def test_a_move_into_reach_keeps_the_tool_axis(self, robot: str) -> None:
        """The nearest point that the tool reaches at all would be out of reach again with the axis held."""
        data = asked(robot, FAR[robot])
        solution = refused(data)
        assert [reason.requirement for reason in solution.reasons] == ["target"]
        assert "towards the base" in solution.relaxations[0].change
        assert_all_do(data, solution)


SOLIDS: dict[str, dict[str, Any]] = {
    "post": {"kind": "cylinder", "radius": "60 mm", "length": "0.6 m", "shift": [0.07, 0, 0.3]},
    "lid": {"kind": "box", "size": ["0.3 m", "0.3 m", "20 mm"], "shift": [0, 0, 0.1]},
    "ball": {"kind": "sphere", "radius": "80 mm", "shift": [0, 0.1, 0]},
}


@pytest.mark.long
@pytest.mark.parametrize(
    ("robot", "name"), conformance([("scara", "post"), ("scara", "lid"), ("panda", "ball")], [("scara", "post")])
)
def test_an_obstacle_is_named_and_a_move_gets_out_of_its_way(robot: str, name: str) -> None:
    solid = dict(SOLIDS[name])
    place = [f"{x + d} m" for x, d in zip(POINTS[robot], solid.pop("shift"), strict=True)]
    data = asked(robot, POINTS[robot])
    data["cell"] = {"obstacles": [{"name": name, "xyz": place, **solid}], "clearance": "20 mm"}
    solution = refused(data)
    assert [reason.requirement for reason in solution.reasons] == [f"clearance to {name}"]
    assert any(
        r.change.startswith((f"obstacle {name} must give ", f"remove obstacle {name}")) for r in solution.relaxations
    )
    assert any(r.change.startswith(f"move obstacle {name} by ") for r in solution.relaxations)
    assert_all_do(data, solution)


@pytest.mark.long
def test_exact_distances_decide_where_no_posture_meets_their_lower_bounds() -> None:
    """Bounds beside the feeder are 0.14 mm short: 21.7 mm was refused as "21.65 mm at most", and 21.79 mm are had."""
    x, y, z = POINTS["ur10"]
    place = [f"{x} m", f"{y + 0.17} m", f"{z + 0.1} m"]
    feeder = {"name": "feeder", "kind": "box", "size": ["120 mm", "200 mm", "250 mm"], "xyz": place}
    data = asked("ur10", POINTS["ur10"])
    data["cell"] = {"obstacles": [feeder], "clearance": "21.7 mm"}
    found = po.select_posture(po.problem_from_dict(data))
    assert found.status == "feasible"  # found by exact distances, and not confirmed by rows that it does not meet
    scene = found.problem.scene
    assert brute_force.slack(scene, found.q) >= -1e-8
    pairs = zip(brute_force.distances(scene, found.q), scene.pairs, strict=True)
    gap = 1e3 * min(distance for distance, pair in pairs if "feeder" in pair)
    assert 21.7 <= gap < 21.9
    data["cell"]["clearance"] = "24 mm"
    reason = refused(data).reasons[0].message
    assert reason.startswith(f"clearance to feeder is {gap:.2f} mm at most, and at least 24 mm is required")


@pytest.mark.long
def test_a_target_is_moved_along_its_table_and_not_into_it() -> None:
    """The nearest point that an arm reaches is lower: in the table, or below the plane that the arm stands on.

    With a long tool the wrist is above the shoulder, and reaches farther where it is lower.
    """
    data = asked("ur10", [1.4, 0.2, 0.0])
    data["robot"]["tool"] = {"xyz": ["0 m", "0 m", "0.25 m"]}
    top = {"name": "table", "kind": "box", "size": ["3 m", "3 m", "40 mm"], "xyz": ["0 m", "0 m", "-20 mm"]}
    data["cell"] = {"obstacles": [top]}
    solution = refused(data)
    moves = [r.to_json()["set"] for r in solution.relaxations if "task.position" in r.to_json()["set"]]
    assert moves
    for move in moves:
        x, y, z = (float(text.removesuffix(" mm")) for text in move["task.position"])
        assert math.hypot(x, y) < 1400
        assert z > -0.1
    assert_all_do(data, solution)


SCARA_POINT = POINTS["scara"]


@pytest.mark.long
def test_how_much_an_obstacle_must_give_is_how_deep_the_arm_is_in_it() -> None:
    """The tool is 108 mm inside of a drum: no distance says how deep; a tenth less than offered does not do."""
    data = asked("scara", SCARA_POINT)
    place = [f"{x} m" for x in (0.45, 0.24, 0.2)]
    drum = {"name": "drum", "kind": "cylinder", "radius": "300 mm", "length": "2 m", "xyz": place}
    data["cell"] = {"obstacles": [drum], "clearance": "5 mm", "mounting": "none"}
    solution = refused(data)
    assert [reason.requirement for reason in solution.reasons] == ["clearance to drum"]
    (gives,) = (r for r in solution.relaxations if r.change.startswith("obstacle drum must give "))
    keys = gives.to_json()["set"]
    assert set(keys) == {"cell.obstacles.drum.radius", "cell.obstacles.drum.length"}
    radius = float(keys["cell.obstacles.drum.radius"].split()[0])
    assert gives.reasons[0].amount * 1e3 == pytest.approx(300 - radius, abs=0.2)
    assert_all_do(data, solution)
    less = 0.9 * (300 - radius)
    drum |= {"radius": f"{300 - less} mm", "length": f"{2000 - 2 * less} mm"}
    refused(data)


def test_a_mounting_plane_that_is_stated_is_lowered() -> None:
    data = asked("scara", [0.28, 0.15, -0.1])
    data["cell"] = {"mounting": {"below": "0 mm"}, "clearance": "5 mm"}
    solution = refused(data)
    assert [reason.requirement for reason in solution.reasons] == ["clearance to mounting plane"]
    (lower,) = (r for r in solution.relaxations if "cell.mounting.below" in r.to_json()["set"])
    assert lower.change.startswith("state the mounting plane ")
    assert_all_do(data, solution)


@pytest.mark.long
def test_a_held_joint_does_not_free_the_tool_axis() -> None:
    held = {"wrist_2": "-30 deg"}
    term = {"kind": "fixed_joints", "values": held}
    data = asked("ur10e", POINTS["panda"], tilt="2 deg", subject_to=[term])
    data["robot"]["tool"] = {"xyz": ["0 m", "0 m", "120 mm"]}
    with pytest.raises(po.errors.NoSolutionError) as caught:
        po.select_posture(po.problem_from_dict(data))
    assert {reason.requirement for reason in caught.value.solution.reasons} <= {f"fixed_joints of {j}" for j in held}


@pytest.mark.long
def test_an_obstacle_about_the_arm_is_the_reason() -> None:
    """The shoulder is 141 mm inside of a box about it, whatever the posture."""
    side = 0.205
    data = asked("ur10e", [0.6, 0.2, 0.2], clearance="0.3 mm")
    cabinet = {"name": "cabinet", "kind": "box", "size": [f"{side} m"] * 3, "xyz": ["0 m", "0 m", "0.25 m"]}
    data["cell"] = {"clearance": "15 mm", "obstacles": [cabinet]}
    solution = refused(data)
    assert [reason.requirement for reason in solution.reasons] == ["clearance to cabinet"]
    changes = {r.change.partition(" by ")[0] for r in solution.relaxations}
    assert {"remove obstacle cabinet"} <= changes <= {"remove obstacle cabinet", "move obstacle cabinet"}
    assert "is -141.4 mm at most" in solution.reasons[0].message
    table = {**cabinet, "xyz": ["0 m", "0 m", f"{-side / 2} m"]}  # what the arm stands on may touch its first link
    data["cell"]["obstacles"] = [table]
    assert po.select_posture(po.problem_from_dict(data)).status == "optimal"


def test_what_does_not_do_is_not_offered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(po.PostureSelector, "can_be_done", lambda *args: False)
    with pytest.raises(po.errors.NoSolutionError) as caught:
        po.select_posture(po.problem_from_dict(asked("scara", FAR["scara"])))
    assert caught.value.solution.relaxations == ()
    assert "move the target" not in str(caught.value)
    assert "selection.remedy" not in said(caught.value.solution)


def test_requirements_that_are_met_one_by_one_and_not_together_are_no_error_of_the_solver(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    data = asked("scara", SCARA_POINT, subject_to=[{"kind": "link_height", "at_least": "2 m"}])
    monkeypatch.setattr(Infeasibility, "ways", lambda self: [])
    with pytest.raises(po.errors.NoSolutionError) as caught:
        po.select_posture(po.problem_from_dict(data))
    solution = caught.value.solution
    first, *missed = solution.reasons
    assert first.requirement == "search"
    assert "no posture was found that meets all of the requirements" in first.message
    assert any(reason.requirement.startswith("link_height") for reason in missed)
    assert solution.to_json()["status"] == "infeasible"


def test_two_numbers_of_a_message_differ_where_they_differ() -> None:
    assert shown_apart(math.radians(17.192), math.radians(17.19), "rad") == ("17.192 deg", "17.19 deg")
    assert shown_apart(0.99999999, 1.0, "m") == ("999.99999 mm", "1000 mm")
    assert shown_apart(0.1, 0.1, "m")[0] == shown_apart(0.1, 0.1, "m")[1]


@pytest.mark.parametrize("robot", conformance(["irb1200", "m10id", "tx2_60"], ["tx2_60"]))
def test_an_assumed_tool_does_not_keep_the_wrist_from_bending(robot: str) -> None:
    """Only its axis is sure: with a stated radius of 20 mm an IRB 1200 reached 1 of 30 targets from above."""
    reach = po.problem_from_dict({"robot": {"kind": "preset", "name": robot}}).robot.length
    rng, rise = np.random.default_rng(11), 0.45 if robot == "m10id" else 0.0  # whose base frame is at its shoulder
    for angle, out, up in rng.uniform([-1, 0.33, 0.1], [1, 0.5, 0.25], (2, 3)):
        point = [reach * out * math.cos(angle), reach * out * math.sin(angle), reach * up - rise]
        data = asked(robot, point)
        data["robot"]["tool"] = {"xyz": ["0 m", "0 m", "150 mm"]}
        assert po.PostureSelector(po.problem_from_dict(data), compiled=False).can_be_done()
    q = po.PostureSelector(po.problem_from_dict(data), compiled=False).solve(starts=2).q
    scene = po.problem_from_dict(data).scene
    assert brute_force.slack(scene, q) >= -1e-8
    assert min(scene.required) >= 0
