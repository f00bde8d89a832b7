"""Every statement of postures, maps and comparisons that the catalogue has is made somewhere, and reads well."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.collision.scene import Scene, scene_statements
from posture_opt.report.text.blocks import fits, lead
from posture_opt.result import Result
from posture_opt.selection.answer.path_answer import PathBreak
from posture_opt.selection.search.relaxation import Reason, Relaxation
from posture_opt.statements import Statement, every_entry, state
from tests.helpers.every_result import MADE
from tests.helpers.said import said

MINE = ("Solution", "Solution of a path", "Solution of features", "TargetMap", "PostureBatch", "Comparison",
        "Comparison of arms", "Compensation")  # fmt: skip
PRINTABLE = re.compile(r"[{}]|\bnan\b|\binf\b")


def made(name: str, **keys: Any) -> po.Solution:
    """The answer to a shipped problem with other keys of its file."""
    problem = po.load_problem(name)
    return po.select_posture(problem.replace(**keys) if keys else problem)


@pytest.mark.parametrize("name", MINE)
def test_the_first_screen_has_the_answer_and_its_limits(name: str) -> None:
    result = MADE[name]()
    shown, _ = lead(result.statements)
    assert fits(shown)
    assert shown[0].severity == "result"
    document = result.to_json()["statements"]
    assert [one["id"] for one in document] == [one.id for one in sorted(result.statements, key=_weight)]  # type: ignore[index, union-attr]
    assert {one["text"] for one in document} == {one.text for one in result.statements}  # type: ignore[index, union-attr]


def _weight(one: Statement) -> int:
    return ["danger", "caution", "result", "note", "detail"].index(one.severity)


def test_a_sentence_has_at_most_25_words_of_its_own() -> None:
    rooms = ("selection", "collision", "compensation", "problem", "uncertainty")
    entries = {name: entry for name, entry in every_entry().items() if name.partition(".")[0] in rooms}
    assert {name: len(entry.text.split()) for name, entry in entries.items() if len(entry.text.split()) > 25} == {}
    assert all(entry.text.endswith((".", ")")) for entry in entries.values())


def test_a_taught_position_is_the_condition_of_its_probability() -> None:
    """Repeatability says nothing of where the arm is in the world; stated errors that stay do."""
    task = {"kind": "insert", "direction": [0, -1, 0], "position": ["0.9 m", "0.4 m", "0 m"], "clearance": "50 mm"}
    ids = {}
    for name, errors in {
        "taught": {"repeatability": "0.1 mm"},
        "placed": {"sigma": {"joint1.theta": "1 mrad"}},
    }.items():
        robot = {"kind": "preset", "name": "planar_2r"}
        found = po.select_posture(po.problem_from_dict({"robot": robot, "uncertainty": errors, "task": task}))
        ids[name] = {one for one in said(found) if "success" in one}
        assert "> 99.9 %" in found.report()
    assert ids == {"taught": {"uncertainty.success-taught"}, "placed": {"uncertainty.success"}}


def test_a_joint_that_spins_the_tool_about_its_axis_is_free_and_any_value_as_good() -> None:
    found = made("insert_ur10")
    (name,) = said(found)["selection.free-joint"].values["joints"]  # type: ignore[misc, union-attr]
    at = found.problem.robot.joint_names.index(str(name))
    turned = np.array(found.q)
    turned[at] += 1.0
    assert found.sigma_at(found.target, turned) == pytest.approx(found.sigma_max, rel=1e-9)


def texts(result: Result) -> str:
    return " ".join(one.text for one in result.statements)


@pytest.mark.parametrize("name", MINE)
def test_sentences_are_filled(name: str) -> None:
    text = texts(MADE[name]())
    for keys in re.findall(r"\{[a-z_]+: [^{}]*\}", text):  # of problem files
        text = text.replace(keys, "")
    assert PRINTABLE.search(text) is None


def scenes() -> Iterator[Statement]:
    """Of what is checked, with which shapes."""
    box = {"name": "box", "kind": "box", "size": ["0.3 m", "0.3 m", "4 mm"], "xyz": ["0.7 m", "0.2 m", "0.106 m"]}
    tool, ur10 = {"xyz": ["0 m", "0 m", "300 mm"], "radius": "10 mm"}, {"kind": "preset", "name": "ur10"}
    joints = [{"name": f"j{k}", "a": "0.4 m", "alpha": f"{90 * (k % 2)} deg"} for k in range(4)]
    bare, known = (
        {"kind": "dh", "joints": joints},
        {"add": [{"joint": "j1", "from": [0, 0, 0], "to": ["0.3 m", 0, 0], "radius": "40 mm"}]},
    )
    cells: list[tuple[dict[str, Any], Any]] = [
        (ur10, "none"), ({**ur10, "tool": tool}, {"obstacles": [box]}), (bare, {"obstacles": [box]}),
        ({**bare, "shape": known}, {"mounting": "none"}), ({**bare, "shape": {"radius": "40 mm"}}, None),
    ]  # fmt: skip
    for robot, cell in cells:
        scene = po.problem_from_dict({"robot": robot} if cell is None else {"robot": robot, "cell": cell}).scene
        yield from scene_statements(scene, np.zeros((1, scene.robot.n)))
    robot = po.problem_from_dict({"robot": ur10}).robot
    kept = tuple(capsule for capsule in robot.shape if capsule.joint != "wrist_1")
    partly = Scene.of(replace(robot, unshaped=("wrist_1",), shape=kept), None)
    yield from scene_statements(partly, np.zeros((1, 6)))
    dropped = replace(po.problem_from_dict({"robot": ur10}), without_mounting=True).scene
    yield from dropped.statements(np.radians([[0, 90, 0, 0, 0, 0]]))


def answers() -> Iterator[Result]:
    """Answers at one target: without any, with bounds, with other optima, improved by the solver."""
    one = MADE["Solution"]()
    assert isinstance(one, po.Solution)
    reasons = tuple(Reason(name, "it is too far", 0.1, "m") for name in ("target", "tool_axis"))
    confirmation = one.statistics.confirmation
    assert confirmation is not None
    yield replace(one, status="infeasible", reasons=reasons, relaxations=(Relaxation("move it", (), {}, 1.0),))
    for agrees, taken in ((0.1, True), (0.1, False), (float("nan"), False)):
        said = replace(confirmation, agrees=agrees, taken=taken)
        yield replace(one, status="feasible", statistics=replace(one.statistics, confirmation=said))
    sigma = {"joint1.theta": "1 mrad", "joint2.theta": "1 mrad"}
    robot = {"kind": "preset", "name": "planar_2r", "base": "free"}
    stated = {"robot": robot, "uncertainty": {"sigma": sigma}}
    task = {"kind": "insert", "direction": [0, -1, 0], "position": ["2 m", "0 m", "0 m"]}
    yield po.select_posture(po.problem_from_dict({**stated, "task": task}))
    for name in ("insert_ur10", "insert_panda", "insert_iiwa14_tilt", "insert_ur10_peg", "measure_planar_2r"):
        yield made(name)
    joints = [{"name": f"j{k}", "a": "0.4 m", "alpha": f"{90 * (k % 2)} deg"} for k in range(6)]
    bare = {"robot": {"kind": "dh", "joints": joints}, "uncertainty": {"sigma": {"j1.theta": "1 mrad"}}}
    yield po.select_posture(
        po.problem_from_dict({**bare, "task": {"kind": "trace", "position": ["0.6 m", "0.3 m", "0 m"]}})
    )
    spread = {"kind": "orientation_spread", "of": "all", "at_most": "5 deg"}
    inside = {**stated, "robot": {"kind": "preset", "name": "planar_2r"}}
    yield po.select_posture(
        po.problem_from_dict({**inside, "task": {**task, "position": ["1 m", "0.5 m", "0 m"], "subject_to": [spread]}})
    )


def axes() -> Iterator[Statement]:
    """Of what becomes of the tool axis."""
    found = made("insert_ur10")
    for tilt in (0.0, 0.1):
        yield found.optimisation_problem.axis_note(replace(found.target, tilt=tilt, spin=np.array([1.0, 0, 0])))
        yield found.optimisation_problem.axis_note(replace(found.target, tilt=tilt))


def motions() -> Iterator[Result]:
    """Motions along a path: broken, closed, fast."""
    one = MADE["Solution of a path"]()
    assert isinstance(one, po.Solution)
    assert one.followed is not None
    path: Any = one.followed
    breaks = tuple(PathBreak(1, 2, kind, "joint1", 3.0, "rad", 0.1, 0) for kind in ("singular", "limits"))
    fast = replace(path.law.robot, joints=tuple(replace(j, velocity=1.0) for j in path.law.robot.joints))
    around = path.law.Q.copy()
    around[-1] = around[0] + [2 * np.pi, 0]
    task: Any = one.problem.task
    closed: Any = replace(one.problem, task=task.model_copy(update={"closed": True}))
    yield replace(one, followed=replace(path, breaks=breaks))
    yield replace(one, followed=replace(path, off_line=9.0, law=replace(path.law, stated=0.1)))
    yield replace(one, problem=closed, followed=replace(path, law=replace(path.law, robot=fast)))
    law = replace(path.law, robot=fast, stated=0.1, Q=around)
    yield replace(one, problem=closed, followed=replace(path, law=law))
    yield replace(one, status="infeasible", reasons=(Reason("speed", "it is too fast", 0.1, "m/s"),))


def features() -> Iterator[Result]:
    """Features of a workpiece that is fixed, and where not all can be done."""
    places = [{"name": f"f{k}", "position": [f"{x} m", "0 m", "0 m"]} for k, x in enumerate((1.0, 1.2))]
    fixed = {"kind": "insert", "direction": [0, -1, 0], "features": places, "workpiece": {"x": "0 m", "y": "0.5 m"}}
    task = {**fixed, "clearance": "0.5 mm"}
    data = {"robot": {"kind": "preset", "name": "planar_2r"}, "uncertainty": {"sigma": {"joint1.theta": "1 mrad"}}}
    found = po.select_posture(po.problem_from_dict({**data, "task": task}))
    yield found
    also = state("selection.features-also-fail", features=("f1",))
    reason = Reason("target", "f0: it is too far", 0.1, "m")
    yield replace(found, status="infeasible", reasons=(reason,), notes=(also,))


def maps() -> Iterator[Result]:
    """Maps with another position in the problem, and of an arm whose effect was measured in a part of a range."""
    one = MADE["TargetMap"]()
    assert isinstance(one, po.TargetMap)
    yield replace(one, own=one.best)
    yield replace(one, own=next(point for point in one.map_points if not point.feasible))
    effect = {"kind": "cyclic_error", "joint": "joint1", "cycles": 3.3, "centre": "0 rad",
              "estimate": {"sin": "0.6 mrad", "cos": "0 rad"}, "measured_range": ["-23 deg", "57 deg"]}  # fmt: skip
    task = {"kind": "insert", "direction": [0, -1, 0], "position": ["1.2 m", "0.6 m", "0 m"]}
    robot, sigma = {"kind": "preset", "name": "planar_2r"}, {"sigma": {"joint2.theta": "0.05 mrad"}}
    known = {"robot": robot, "uncertainty": sigma, "effects": [effect]}
    problem = po.problem_from_dict({**known, "task": task})
    yield po.map_targets(problem, counts=(2, 2), low=(1.2, 0.6, 0.0), high=(1.3, 0.7, 0.0), compiled=False)
    yield po.select_posture(po.problem_from_dict({**known, "task": {**task, "position": ["-1.2 m", "-0.6 m", "0 m"]}}))


def comparisons() -> Iterator[Result]:
    """Arms that are alike, unlike, other, and one that cannot do the task."""
    data = {"robot": {"kind": "preset", "name": "planar_2r"}, "uncertainty": {"sigma": {"joint1.theta": "1 mrad"}},
            "task": {"kind": "insert", "direction": [0, -1, 0], "position": ["0.9 m", "0.7 m", "0 m"]}}  # fmt: skip
    planar = po.problem_from_dict(data)
    joints = [{"name": name, "a": "0.2 m", "alpha": "0 deg"} for name in ("joint1", "joint2")]
    short = {"robot": {"kind": "dh", "joints": joints}, "uncertainty": data["uncertainty"]}
    far = {**short, "robot": {"kind": "dh", "joints": [{**joint, "a": "1.2 m"} for joint in joints]}}
    yield po.compare({"one": planar, "same": planar, "short": po.problem_from_dict(short)})
    yield po.compare({"one": planar, "long": po.problem_from_dict(far)})
    yield po.compare({"one": planar, "other": po.load_problem("insert_scara")})


def batches() -> Iterator[Result]:
    """A batch in which one problem has no answer."""
    one = MADE["PostureBatch"]()
    assert isinstance(one, po.PostureBatch)
    yield replace(one, answers=(*one.answers, replace(one.answers[0], code=3, reasons=("it is too far",))))


def compensations() -> Iterator[Result]:
    """Compensated rows with something to check."""
    one = MADE["Compensation"]()
    assert isinstance(one, po.Compensation)
    before = replace(one.before, off=one.before.off + 1e-4)
    turned = one.q * [[1, 1], [1, -1]]  # another elbow
    joints = np.array([[True, False], [False, False]])
    remarks = (state("compensation.near-first-row"),)
    yield replace(one, before=before, q=turned, unsettled=joints, remarks=remarks)
    sided = replace(one.targets, near=one.near, side=np.array([[0, 0], [-1, -1]]))
    effect = {"kind": "backlash", "joint": "joint1", "estimate": {"width": "0.2 mrad"}}
    yield replace(one, before=before, q=turned, targets=sided, problem=one.problem.replace(effects=[effect]))


ELSEWHERE = {
    # made by tests of what they are about
    "collision.link-below-base", "collision.tool-pierces",
    "collision.workpiece-hit", "collision.workpiece-near", "collision.pairs-left-out", "selection.off-plane",
    "selection.relaxed-search", "selection.move-part", "selection.plan-conditions", "selection.plan-error",
    "selection.plan-impossible", "selection.plan-inside-measured-range", "selection.plan-mostly-systematic",
    "selection.plan-needs-unmeasured-range", "selection.plan-relies-on-effects", "selection.plan-scatter-unstated",
    "selection.measure-for-task", "selection.nearest-placement",
}  # fmt: skip


def test_every_sentence_is_made_and_every_id_has_one() -> None:
    rooms = ("selection", "collision", "compensation", "problem")
    variants = (answers, motions, features, maps, comparisons, batches, compensations)
    results = [*(MADE[name]() for name in MINE), *(result for make in variants for result in make())]
    statements = [*scenes(), *axes(), *(one for result in results for one in result.statements)]
    entries = {name for name in every_entry() if name.partition(".")[0] in rooms}
    assert entries - {one.id for one in statements} - ELSEWHERE == set()
    for one in statements:
        assert not {"None", "nan", "inf"} & set(re.split(r"\W+", one.text)) or "cell: none" in one.text, one.text
