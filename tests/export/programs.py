"""A small interpreter of robot programs, written from the manuals of the languages; what they say is then replayed."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import yaml

from posture_opt.export.robot_program import MotionRequest, RobotProgram, answer_programs
from tests.helpers import brute_force, factors

Files = Mapping[str, str]
NUMBER = r"[-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?"


def answer_program(problem: Any, answer: Any, asked: MotionRequest | None = None) -> RobotProgram:
    """The one program of an answer that is not broken."""
    (program,) = answer_programs(problem, answer, asked or MotionRequest())
    return program


class Step(NamedTuple):
    """One motion: to joint values q [rad or m], with the tool on a line at a speed [m/s] or joint by joint."""

    q: list[float]
    line: bool = False
    speed: float = float("nan")
    blend: float = 0.0
    wait: float = 0.0


@dataclass
class Program:
    """What a program does."""

    steps: list[Step] = field(default_factory=list)
    payload: float = 0.0

    def waits(self, seconds: float) -> None:
        """The arm waits where it is."""
        self.steps[-1] = self.steps[-1]._replace(wait=seconds)


def urscript(files: Files, types: Sequence[str]) -> Program:
    """``movej([…], a=…, v=…)`` or ``movel([…], a=…, v=…, r=…)`` inside of ``def name(): … end``."""
    found = Program()
    (text,) = files.values()
    code = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    assert re.fullmatch(r"def \w+\(\):", code[0])
    assert code[-1] == "end"
    move = re.compile(rf"  move([jl])\(\[(.*)\], a={NUMBER}, v=({NUMBER})(?:, r=({NUMBER}))?\)")
    for line in code[1:-1]:
        if m := move.fullmatch(line):
            q = [float(v) for v in m[2].split(",")]
            found.steps.append(Step(q, True, float(m[3]), float(m[4] or 0)) if m[1] == "l" else Step(q))
        elif m := re.fullmatch(rf"  sleep\(({NUMBER})\)", line):
            found.waits(float(m[1]))
        elif m := re.fullmatch(rf"  set_payload\(({NUMBER}), \[.*\]\)", line):
            found.payload = float(m[1])
        else:
            assert re.fullmatch(r"  set_tcp\(p\[.*\]\)", line), line
    return found


def krl(files: Files, types: Sequence[str]) -> Program:
    """``PTP name`` in the .src file, ``DECL E6AXIS name={A1 …}`` in the .dat file."""
    source = next(text for name, text in files.items() if name.endswith(".src"))
    data = next(text for name, text in files.items() if name.endswith(".dat"))
    name = next(iter(files)).rpartition(".")[0]
    assert f"\nDEF {name}()\n" in source and source.endswith("END\n")  # noqa: PT018
    assert f"\nDEFDAT {name}\n" in data and data.endswith("ENDDAT\n")  # noqa: PT018
    assert source.index("BAS(#INITMOV, 0)") < source.index("PTP ")
    known = {}
    for variable, inside in re.findall(r"^DECL E6AXIS (\w+)=\{(.*)\}$", data, re.MULTILINE):
        axes = dict(entry.split() for entry in inside.split(","))
        assert list(axes)[:6] == [f"A{k}" for k in range(1, 7)]
        known[variable] = si([float(v) for v in axes.values()], types)
    found, speed, blend, aim = Program(), float("nan"), 0.0, ""
    for line in source.splitlines():
        if m := re.fullmatch(r"PTP (\w+)", line):
            found.steps.append(Step(known[m[1]]))
        elif m := re.fullmatch(r"XL=FORWARD\((\w+), FAULT\)", line):
            aim = m[1]
        elif m := re.fullmatch(r"LIN XL( C_DIS)?", line):
            found.steps.append(Step(known[aim], True, speed, blend if m[1] else 0.0))
        elif m := re.fullmatch(rf"\$VEL\.CP=({NUMBER})", line):
            speed = float(m[1])
        elif m := re.fullmatch(rf"\$APO\.CDIS=({NUMBER})", line):
            blend = float(m[1]) / 1e3
        elif m := re.fullmatch(rf"WAIT SEC ({NUMBER})", line):
            found.waits(float(m[1]))
        elif m := re.match(rf"\$LOAD=\{{M ({NUMBER}),", line):
            found.payload = float(m[1])
    return found


def rapid(files: Files, types: Sequence[str]) -> Program:
    """``MoveAbsJ name\\NoEOffs, v1000, fine, tool0;`` of ``CONST jointtarget name := [[…], […]];``."""
    (text,) = files.values()
    assert text.startswith("MODULE ") and text.endswith("ENDMODULE\n")  # noqa: PT018
    assert all(
        line.endswith(";") for line in text.splitlines() if re.match(r"\s+(CONST|MoveAbsJ|WaitTime|VelSet)", line)
    )
    known, speeds, found, percent = {}, {}, Program(), 100.0
    for line in text.splitlines():
        if m := re.match(r"  CONST jointtarget (\w+) := \[\[(.*)\], \[(.*)\]\];", line):
            robot, external = m[2].split(","), m[3].split(",")
            assert len(robot) == len(external) == 6
            known[m[1]] = si([*map(float, robot), *(float(v) for v in external if float(v) < 9e9)], types)
        elif m := re.match(rf"  CONST speeddata (\w+) := \[({NUMBER}),", line):
            speeds[m[1]] = float(m[2]) / 1e3
        elif m := re.match(rf"  PERS tooldata \w+ := \[TRUE, \[\[.*\], \[.*\]\], \[({NUMBER}),", line):
            found.payload = float(m[1])
        elif m := re.match(rf"    VelSet ({NUMBER}), 5000;", line):
            percent = float(m[1])
        elif m := re.match(r"    MoveAbsJ (\w+)\\NoEOffs, v1000, fine, \w+;", line):
            found.steps.append(Step(known[m[1]]))
        elif m := re.match(r"    MoveL CalcRobT\((\w+), (\w+)\), (\w+), (fine|z0|z1), \2;", line):
            zone = {"fine": 0.0, "z0": 0.3e-3, "z1": 1e-3}[m[4]]
            found.steps.append(Step(known[m[1]], True, speeds[m[3]] * percent / 100, zone))
        elif m := re.match(rf"    WaitTime\\InPos, ({NUMBER});", line):
            found.waits(float(m[1]))
    return found


def jointstate(files: Files, types: Sequence[str]) -> Program:
    """The YAML of a message; a point where the arm waits is in it twice."""
    (text,) = files.values()
    message = yaml.safe_load(text)
    if "position" in message:
        assert len(message["name"]) == len(message["position"])
        return Program([Step(message["position"])])
    found = Program()
    for point in message["points"]:
        if not found.steps or point["positions"] != found.steps[-1].q:
            found.steps.append(Step(point["positions"]))
    return found


def si(values: Sequence[float], types: Sequence[str]) -> list[float]:
    """Degrees and mm as rad and m; what the arm has no joints for is zero."""
    assert not any(values[len(types) :])
    return [np.radians(v) if kind == "revolute" else v / 1e3 for v, kind in zip(values, types, strict=False)]


INTERPRETERS: dict[str, Callable[[Files, Sequence[str]], Program]] = {
    "urscript": urscript, "krl": krl, "rapid": rapid, "jointstate": jointstate,
}  # fmt: skip


def _stops(kind: str) -> Callable[[Files, Sequence[str]], list[list[float]]]:
    return lambda files, types: [step.q for step in INTERPRETERS[kind](files, types).steps]


READERS = {kind: _stops(kind) for kind in INTERPRETERS}
"""The joint values of the stops alone, in rad and m."""


def driven(robot: Any, a: np.ndarray, step: Step) -> np.ndarray:
    """(K, n) postures on the way from a posture: joints moved evenly, or the tool led along its line from pose to pose.

    A line has to end in the posture that was commanded: a controller that keeps its configuration comes there.
    """
    b = np.array(step.q)
    if not step.line:
        return a + np.linspace(0, 1, int(np.abs(b - a).max() / np.radians(2)) + 2)[1:, None] * (b - a)
    start, end = factors.pose(robot, a), factors.pose(robot, b)
    angle_axis = _rotation_vector(end[:3, :3] @ start[:3, :3].T)
    ways, q = [], a.copy()
    for s in np.linspace(0, 1, max(int(np.linalg.norm(end[:3, 3] - start[:3, 3]) / 5e-3), 2) + 1)[1:]:
        x, R = (1 - s) * start[:3, 3] + s * end[:3, 3], _turn(s * angle_axis) @ start[:3, :3]
        for _ in range(20):
            T, J = (part[0] for part in brute_force.tool_and_jacobian(robot, q[None]))
            miss = np.concatenate([x - T[:3, 3], _rotation_vector(R @ T[:3, :3].T)])
            q = q + np.linalg.lstsq(J, miss, rcond=1e-6)[0]
        ways.append(q)
    assert np.abs(ways[-1] - b).max() < 1e-4, "the line ends in another posture"
    return np.array(ways)


def _turn(v: np.ndarray) -> np.ndarray:
    angle = np.linalg.norm(v)
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = v / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def _rotation_vector(R: np.ndarray) -> np.ndarray:
    """Of a turn well below half of one."""
    v = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = np.linalg.norm(v)
    return v if sine < 1e-12 else v / sine * np.arctan2(sine, (np.trace(R) - 1) / 2)
