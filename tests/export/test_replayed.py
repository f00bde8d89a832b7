"""Programs as a controller would run them: positions, lines, speeds, sides of arrival, and nothing in the way."""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.export.export_files import program_files
from posture_opt.export.robot_program import MotionRequest, answer_programs, compensated_program
from tests.export.programs import INTERPRETERS, driven
from tests.helpers import brute_force, factors
from tests.helpers.command_line import invoke
from tests.helpers.folders import names
from tests.helpers.variants import conformance

TOOL = {"xyz": ["0 m", "0 m", "150 mm"]}
TABLE = {"name": "table", "kind": "half_space", "normal": [0, 0, 1], "offset": "0 m"}
POST = {"name": "post", "kind": "cylinder", "radius": "40 mm", "length": "0.5 m", "xyz": ["0.5 m", "-0.1 m", "0.25 m"]}
PLAY = {"kind": "backlash", "estimate": {"width": "0.3 mrad"}}


def stated(robot: str, task: dict[str, Any], **sections: Any) -> dict[str, Any]:
    cell = {"obstacles": [TABLE, POST], "clearance": "5 mm"}
    return {
        "robot": {"kind": "preset", "name": robot, "tool": TOOL, "payload": "2 kg"}, "cell": cell,
        "uncertainty": {"repeatability": "0.03 mm"}, "solver": {"starts": 2, "seed": 0}, "task": task, **sections,
    }  # fmt: skip


TASKS: dict[str, dict[str, Any]] = {
    "insert": stated("irb120", {"kind": "insert", "position": ["0.35 m", "0.1 m", "0.1 m"], "approach": {"joint_1": 1}},
                     effects=[{**PLAY, "joint": "joint_1"}]),
    "drill sideways": stated("ur5e", {"kind": "drill", "position": ["0.4 m", "0.3 m", "0.3 m"],
                                      "direction": [1, 1, 0]}),
    "three holes": stated("kr6_r900", {"kind": "insert", "workpiece": {"x": "0.5 m", "y": "0.15 m", "z": "0.1 m"},
                                       "features": [{"name": f"hole {k}", "position": [f"{40 * k} mm", "0 m", "0 m"]}
                                                    for k in range(3)]}),
    "weld": stated("vs060", {"kind": "weld", "points": [["0.45 m", f"{y} m", "0.2 m"] for y in (0.1, 0.3)],
                             "speed": "10 mm/s"}),
    "compensated": stated("ur10e", {"kind": "insert", "position": ["0.7 m", "0.3 m", "0.2 m"],
                                    "approach": {"shoulder_pan": 1}}, effects=[{**PLAY, "joint": "shoulder_pan"}]),
}  # fmt: skip


@cache
def planned(name: str) -> tuple[Any, Any, np.ndarray, np.ndarray]:
    """Problem, program, postures (N, n) of the targets and the sides (N, n) that they hold for."""
    problem = po.problem_from_dict(TASKS[name])
    if name == "compensated":
        rng = np.random.default_rng(1)
        p = 1e3 * np.array([0.65, 0.3, 0.2]) + rng.uniform(-100, 100, (5, 3))
        found = po.compensate(problem, {f"{axis} [mm]": p[:, k] for k, axis in enumerate("xyz")})
        assert found.changes == ()
        return found.problem, compensated_program(found, 20.0, 1.5), found.q, found.side
    answer = po.select_posture(problem)
    (program,) = answer_programs(answer.problem, answer, MotionRequest(20.0, 1.5))
    order = list(answer.order.order) if answer.points and answer.followed is None else slice(None)
    q = answer.postures[order] if answer.points else answer.q[None]
    return answer.problem, program, q, np.ones_like(q)


@pytest.mark.parametrize(
    ("name", "kind"),
    conformance(
        [*product(TASKS, ("rapid", "krl")), ("three holes", "jointstate"), ("drill sideways", "urscript")],
        [("insert", "rapid"), ("three holes", "rapid")],
    ),
)
def test_a_program_does_what_was_planned(name: str, kind: str) -> None:
    problem, program, targets, sides = planned(name)
    robot, scene = problem.robot, problem.scene
    files = dict(program_files(program, kind, "").files)
    found = INTERPRETERS[kind](files, [joint.type for joint in robot.joints])
    assert name != "three holes" or all(f"hole {k}" in "".join(files.values()) for k in range(3))
    stops = np.array([step.q for step in found.steps])
    at = [int(np.argmin(np.abs(stops - q).max(axis=1))) for q in targets]
    assert at == sorted(at)
    for k, q in zip(at, targets, strict=True):  # positions
        moved = factors.pose(robot, stops[k])[:3, 3] - factors.pose(robot, q)[:3, 3]
        assert np.linalg.norm(moved) < 1e-6
    played = {effect.target for effect in problem.arm.effects if effect.kind == "backlash"}
    for j in [robot.joint_names.index(joint) for joint in played]:  # sides of arrival, play taken up before the line
        for k, side in zip(at, sides[:, j], strict=True):
            run = side * (stops[k, j] - stops[: k + 1, j])
            last = next((i for i in range(k, 0, -1) if side * (stops[i, j] - stops[i - 1, j]) <= 0), 0)
            assert run[last] > np.radians(1.9)
    if kind != "jointstate":
        assert found.payload == 2.0
        into = [found.steps[k] for k in at]
        out = [found.steps[k + 1] for k in (at if len(at) > 1 and name != "weld" else at[-1:])]
        assert all(step.line for step in (*into, *out))
        speed = 0.01 if name == "weld" else 0.05  # as stated, or a fifth of the reduced speed
        assert [step.speed for step in (*into, *out)] == pytest.approx([speed] * len([*into, *out]))
        if name != "weld":
            assert [step.wait for step in into] == [1.5] * len(into)
    for k in range(1, len(stops)):
        way = driven(robot, stops[k - 1], found.steps[k])
        if kind != "jointstate":
            gone = factors.pose(robot, stops[k])[:3, 3] - factors.pose(robot, stops[k - 1])[:3, 3]
            assert not found.steps[k].line or k in (at if name == "weld" else []) or np.linalg.norm(gone) > 0.045
        for q in way[:: max(len(way) // 8, 1)]:
            assert brute_force.slack(scene, q) > -1e-3
    assert not any("does not keep clear" in note for note in program.notes)


def test_a_broken_path_is_exported_in_parts_or_not_at_all(tmp_path: Any) -> None:
    """Round the base of two links, the first of which turns less than once: it has to swing back."""
    joints = [{"name": f"joint{k}", "a": "1 m", "limits": ["-170 deg", "170 deg"]} for k in (1, 2)]
    turns = np.linspace(0, 2 * np.pi, 13)
    points = [[f"{1.2 * np.cos(a)} m", f"{1.2 * np.sin(a)} m", "0 m"] for a in turns]
    problem = po.problem_from_dict({
        "robot": {"kind": "dh", "joints": joints}, "uncertainty": {"sigma": {"joint1.theta": "0.1 mrad"}},
        "task": {"kind": "trace", "points": points},
    })  # fmt: skip
    answer = po.select_posture(problem)
    assert len(answer.breaks) == 1
    with pytest.raises(po.errors.NoSolutionError, match="--with-breaks"):
        po.export_files(problem, "krl")
    (tmp_path / "p.yaml").write_text(problem.to_yaml())
    words = ("export", "--problem", tmp_path / "p.yaml", "--to", "krl", "--with-breaks", "--out", tmp_path / "out")
    assert invoke(*words).exit_code == 0
    assert len(names(tmp_path / "out")) == 2 * (len(answer.breaks) + 1)
