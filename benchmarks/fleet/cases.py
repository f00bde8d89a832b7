"""The targets: reachable by construction, for each arm and task, drawn from a seed."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import posture_opt as po
from benchmarks.fleet.arms import ARMS, FleetArm
from benchmarks.fleet.inverse import drawn, led
from benchmarks.fleet.model import Model
from benchmarks.fleet.tasks import TASKS, FleetTask, uncertainty
from posture_opt.numerics import Array

CLEARANCE = 2.5  # of the worst σ at the random posture that made the target
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class Setup:
    """One arm with one task: what all its targets share."""

    arm: FleetArm
    task: FleetTask

    @property
    def key(self) -> str:
        return f"{self.arm.name}/{self.task.name}"

    @cached_property
    def base(self) -> dict[str, Any]:
        """The problem without a target; collisions are left unchecked, as the brute force does not know them."""
        robot = po.problem_from_dict({"robot": self.arm.section()}).robot
        rng = np.random.default_rng(zlib.crc32(f"{self.arm.name}/{self.task.errors}".encode()))
        stated = uncertainty(robot, self.task.errors, rng)
        task = self.task.document | {"tool_axis": list(self.arm.tool_axis)}
        return {"name": self.key, "robot": self.arm.section(), "cell": "none", "uncertainty": stated, "task": task}

    @cached_property
    def model(self) -> Model:
        document = {k: v for k, v in self.base.items() if k != "task"}
        problem = po.problem_from_dict(document)
        return Model(problem.robot, self.arm.tool_axis, problem.sources.names, problem.sources.covariance)

    @property
    def limits(self) -> tuple[Array, Array]:
        """(n,) limits with the margin that the task asks for taken off."""
        robot = self.model.robot
        margin = np.array([self.task.margin * (joint.type == "revolute") for joint in robot.joints])
        return np.array(robot.lower) + margin, np.array(robot.upper) - margin

    @property
    def aligned(self) -> bool:
        """Whether the tool axis is to lie along the direction, which the targets are drawn for."""
        return self.task.aligned and not self.arm.flat


@dataclass(frozen=True)
class Case:
    """One target of a set-up: position (3,) [m] and direction (3,), world, and the clearance [m]."""

    setup: Setup
    seed: int
    index: int
    position: tuple[float, ...]
    direction: tuple[float, ...]
    clearance: float

    @property
    def key(self) -> str:
        """``arm/task/seed/index``, which replays it."""
        return f"{self.setup.key}/{self.seed}/{self.index}"

    @property
    def box(self) -> tuple[Array, Array]:
        """(3,) least and largest position [m]."""
        half = np.array(self.setup.task.half_box)
        return np.array(self.position) - half, np.array(self.position) + half

    @property
    def document(self) -> dict[str, Any]:
        """The whole problem file."""
        low, high = ([f"{v!r} m" for v in side.tolist()] for side in self.box)
        target = {"region": {"min": low, "max": high}} if any(self.setup.task.half_box) else {"position": low}
        hole = {"clearance": f"{self.clearance!r} m"} if self.setup.task.criterion == "miss" else {}
        task = self.setup.base["task"] | target | hole | {"direction": list(self.direction)}
        return self.setup.base | {"task": task}


def draw(setup: Setup, seed: int, index: int) -> Case:
    """The target of a random posture within the limits: its tool point, along its tool axis or straight down."""
    rng = np.random.default_rng([seed, index, zlib.crc32(setup.key.encode())])
    model, (lower, upper) = setup.model, setup.limits
    Q = drawn(setup.model.robot, lower, upper, 64, rng)
    q, direction = Q[0], None
    if setup.aligned and rng.random() < 0.5:
        down, arrived = led(model, Q, (lower, upper), np.zeros((1, 3)), DOWN[None], np.array([0.0, 1.0]))
        if np.any(arrived):
            q, direction = down[np.argmax(arrived)], DOWN
    at = model(q[None])
    if direction is None:
        direction = at.axis[0] if setup.aligned else rng.normal(size=3) * ([1, 1, 0] if setup.arm.flat else 1)
        direction = direction / np.linalg.norm(direction)
    sigma = float(np.sqrt(np.linalg.eigvalsh(at.covariance[0])[-1]))
    return Case(setup, seed, index, tuple(at.position[0].tolist()), tuple(direction.tolist()), CLEARANCE * sigma)


def setups(only: str = "", task: str = "") -> list[Setup]:
    """Every arm with every task; of them those with ``only`` in the arm's name and ``task`` in the task's."""
    named = [Setup(arm, asked) for arm in ARMS for asked in TASKS if only in arm.name and task in asked.name]
    return [s for s in named if not (s.arm.flat and s.task.kind == "drill")]


def replayed(key: str) -> Case:
    """The case of a key ``arm/task/seed/index``."""
    arm, task, seed, index = key.split("/")
    found = next(s for s in setups() if s.arm.name == arm and s.task.name == task)
    return draw(found, int(seed), int(index))
