"""Postures that an arm may be sent to for a measurement: inside its limits and clear of what is known to be there."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.collision.scene import Scene
from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.experiments.information import planned_rows
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.chain import Walk, factor_values, stack, walk
from posture_opt.numerics import Array, Mask
from posture_opt.robot.robot import Joint, Robot

Box = tuple[tuple[float, ...], tuple[float, ...]]
ANYWHERE: Box = ((-math.inf,) * 3, (math.inf,) * 3)

POSTURE_STEP = {"revolute": math.radians(0.01), "prismatic": 1e-5}
"""What postures are rounded to [rad, m]: numbers that a teach pendant takes as they are."""
_LIMIT_MARGIN = {"revolute": math.radians(2.0), "prismatic": 2e-3}  # to a limit, where none is stated
# Two postures differ by this in at least one joint [rad, m]: what the model cannot express differs from place to place.
_SEPARATION = {"revolute": math.radians(20.0), "prismatic": 0.05}
_MAX_MARGIN_SHARE = 0.05  # of a joint's range
_MAX_TRIED_POSTURES = 200_000  # random postures before the search for allowed ones is given up
_TRIED_AT_ONCE = 5000
# Candidate rows of each sort, before those that are not allowed go: enough for a design and a few seconds.
_MEASURED_CANDIDATES, _SWUNG_CANDIDATES, _RANDOM_CANDIDATES = 150, 350, 500
_MAX_PAYLOADS = 4  # of the data; of more the least, the largest and some between


@dataclass(frozen=True)
class Workspace:
    """Where an arm may go.

    Args:
        lower, upper: (n,) of every joint, one turn at most, the margins to the limits taken off [rad, m].
        height: the least height (world z) of the tool point and of all links that a joint can raise [m]; −inf: none.
        box: lower and upper corner of where the tool point may go, world [m].
        scene: what the arm must not collide with: itself, with capsules along its links where its shape is not known,
            and the obstacles of its cell.
    """

    robot: Robot
    lower: Array
    upper: Array
    height: float
    box: Box
    scene: Scene

    @classmethod
    def of(
        cls, robot: Robot, scene: Scene, *, height: float = -math.inf, margin: float = 0.0, box: Box = ANYWHERE
    ) -> Workspace:
        """The workspace inside the limits; ``margin`` to the limits of revolute joints where one is stated [rad].

        Raises:
            InputError: a slide without limits.
        """
        ranges = [joint_range(joint, margin) for joint in robot.joints]
        lower, upper = np.array(ranges, dtype=float).T
        return cls(robot, lower, upper, height, box, scene)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """What moves."""
        return self.robot.joints

    @property
    def ranges(self) -> tuple[Array, Array]:
        """(w,), (w,) lower and upper end of all joints [rad or m]."""
        return self.lower, self.upper

    @property
    def bounded(self) -> bool:
        """Whether the tool point is held in a box."""
        return bool(np.isfinite(self.box).any())

    def allowed(self, q: Array) -> Mask:
        """Which of the postures (N, n) [rad or m] are allowed (N,): in the box, high enough, free of collisions.

        Limits of the joints are not checked: candidates are drawn within them. Collisions are checked last, for the
        rest.
        """
        reached = nominal_chain(self.robot, q)
        points = skeleton_points(self.robot, reached, len(q))
        moving = np.ptp(points[:, :, 2], axis=0) > 1e-9 if len(q) > 1 else np.ones(points.shape[1], dtype=bool)
        heights = np.where(moving, points[:, :, 2], np.inf).min(axis=1)
        inside = np.all((points[:, -1] >= self.box[0]) & (points[:, -1] <= self.box[1]), axis=1)
        found = np.asarray(inside & (heights >= self.height))
        found[found] = self.scene.slack(q[found]) >= 0
        return found

    def postures(self, count: int, rng: np.random.Generator) -> tuple[Array, float]:
        """Random allowed postures (count, n), rounded, and the share of the tried ones that were allowed.

        Uniform in the joint values between ``lower`` and ``upper``; `_MAX_TRIED_POSTURES` are tried at the most.

        Raises:
            NoSolutionError: hardly any posture is allowed.
        """
        found: list[Array] = []
        have = tried = 0
        while have < count and tried < _MAX_TRIED_POSTURES:
            q = self.rounded(self.drawn(rng, _TRIED_AT_ONCE))
            found.append(q[self.allowed(q)])
            have, tried = have + len(found[-1]), tried + _TRIED_AT_ONCE
        if have < count:
            around = " and of the obstacles" if self.scene.explicit else ""
            above = f", above {self.height * 1e3:g} mm" if self.height > -math.inf else ""
            above += ", with the tool point in the box" if self.bounded else ""
            raise NoSolutionError(
                f"only {have} of {tried} random postures keep clear of the arm itself{around}{above}: "
                "widen what is stated, link_height, the box, the limits of the joints or the cell"
            )
        return np.concatenate(found)[:count], have / tried

    def drawn(self, rng: np.random.Generator, count: int) -> Array:
        """(count, n) postures at random within the limits."""
        return rng.uniform(self.lower, self.upper, (count, self.robot.n))

    def rounded(self, q: Array) -> Array:
        """Postures (N, n) as they are in the file: to 0.01 deg and 0.01 mm (`POSTURE_STEP`), inside the limits."""
        step, (lower, upper) = np.array([POSTURE_STEP[joint.type] for joint in self.joints]), self.ranges
        return np.asarray(np.clip(np.round(q / step), np.ceil(lower / step), np.floor(upper / step)) * step)

    def passable(self, q: Array) -> Mask:
        """Which of the postures (N, n) may be passed through on the way to another one."""
        return self.allowed(q)

    def separations(self, count: int) -> Array:
        """(w,) by which two of ``count`` postures differ in one number at least [rad or m].

        A quarter of the range over the n-th root of ``count`` where that is less: there must be room for all of them.
        """
        stated = np.array([_SEPARATION[joint.type] for joint in self.joints])
        n = len(stated)
        room = self.steps()[:n] / (4 * count ** (1 / n))
        return np.asarray(np.maximum(np.minimum(stated, room), 1e-9))

    def steps(self) -> Array:
        """(w,) what a step to a posture nearby is a share of: the ranges of the joints [rad or m]."""
        lower, upper = self.ranges
        return upper - lower

    def unit_travel(self) -> Array:
        """(w,) travel that counts as one radian: 1 rad of a revolute joint, the length of the arm of a slide [m]."""
        size = max(self.robot.length, 1e-3)
        return np.array([1.0 if joint.type == "revolute" else size for joint in self.joints])


def joint_range(joint: Joint, margin: float) -> tuple[float, float]:
    """Lower and upper end of a joint's range in a plan [rad or m]: one turn at most, a margin to its limits taken off.

    The margin is 2° or 2 mm, at most 5 % of the range on each side, or what the task states if that is more.

    Raises:
        InputError: a slide without limits.
    """
    lower, upper = joint.lower, joint.upper
    if joint.type == "prismatic" and not (math.isfinite(lower) and math.isfinite(upper)):
        raise InputError(Issue(f"{joint.name} has no limits to plan within", hint=f"state the limits of {joint.name}"))
    if joint.type == "revolute" and not upper - lower <= 2 * math.pi:  # a full turn more is the same posture
        lower = -math.pi if lower <= -math.pi and upper >= math.pi else max(lower, upper - 2 * math.pi)
        return lower, lower + 2 * math.pi
    stated = margin if joint.type == "revolute" else 0.0
    inward = max(
        min(_LIMIT_MARGIN[joint.type], _MAX_MARGIN_SHARE * (upper - lower)), min(stated, 0.49 * (upper - lower))
    )
    return lower + inward, upper - inward


def nominal_chain(robot: Robot, q: Array) -> Walk:
    """The nominal chain at the postures (N, n) [rad or m], without effects; origins of its frames in the world."""
    return walk(robot.factors, factor_values(robot.factors, [np.ascontiguousarray(column) for column in q.T]))


def skeleton_points(robot: Robot, reached: Walk, count: int) -> Array:
    """(N, n + 2, 3) origin of the first joint, of the frame behind every joint, and the tool point [m]."""
    ends = np.cumsum([len(robot.base), *(len(link) for link in robot.links)])
    origins = [screw.origin for screw in reached.screws] + [reached.position]
    corners = [origins[k] for k in ends] + [reached.position]
    return np.stack([np.broadcast_to(stack(corner), (count, 3)) for corner in corners], axis=1)


def available_payloads(data: Measurements, stated: float) -> tuple[float, ...]:
    """Payloads [kg] that are available: of the data (`_MAX_PAYLOADS` at most), the one of the file, and none."""
    measured = np.unique(np.round(data.payload, 3)) if data.payload is not None else np.zeros(0)
    if len(measured) > _MAX_PAYLOADS:
        measured = measured[np.linspace(0, len(measured) - 1, _MAX_PAYLOADS).round().astype(int)]
    return tuple(sorted({0.0, round(stated, 3), *map(float, measured)}))


def candidate_rows(residuals: Residuals, joints: Collection[int], sided: bool, seed: int = 0) -> Measurements:
    """Rows that could be measured, none of them yet.

    Postures of the data again; the same with some joints anywhere in their range; and any others. They keep clear of
    the arm itself and go no lower than its foot, or than the data went. Payloads and sides are drawn at random.

    Args:
        joints: those that are moved over their whole range.
        sided: whether the side of arrival is chosen too.

    Raises:
        InputError: a slide without limits.
    """
    robot, data = residuals.robot, residuals.data
    rng = np.random.default_rng(seed)
    known = np.unique(data.q, axis=0)
    known = known[rng.permutation(len(known))]
    # What the arm was mounted on when it was measured is not known; it reached no lower than the lowest row.
    scene = Scene.of(robot, None, guessed=True, without_mounting=True)
    workspace = Workspace.of(robot, scene, height=_lowest_point(residuals))
    swung = known[rng.integers(len(known), size=_SWUNG_CANDIDATES)]
    columns = list(joints) or list(range(robot.n))
    swung[:, columns] = rng.uniform(
        workspace.lower[columns], workspace.upper[columns], (_SWUNG_CANDIDATES, len(columns))
    )
    anywhere = rng.uniform(workspace.lower, workspace.upper, (_RANDOM_CANDIDATES, robot.n))
    q = workspace.rounded(np.concatenate([known[:_MEASURED_CANDIDATES], swung, anywhere]))
    q = q[workspace.allowed(q)]
    rows = planned_rows(robot, q, data.measured_axes, data.target_names[:1], oriented=data.rotation is not None)
    loads = available_payloads(data, robot.payload)
    return replace(
        rows,
        payload=None if loads == (0.0,) and data.payload is None else rng.choice(loads, len(q)),
        temperature=None if data.temperature is None else np.full(len(q), float(np.mean(data.temperature))),
        time=np.zeros(len(q)),
        approach=rng.choice([-1.0, 1.0], q.shape) if sided else np.zeros(q.shape),
        approach_length=np.tile(np.median(data.approach_length, axis=0), (len(q), 1)),
    )


def _lowest_point(residuals: Residuals) -> float:
    """The foot of the arm, or the lowest that a moving part of it came to in the data if that is lower [m]."""
    robot, q = residuals.robot, residuals.data.q
    points = skeleton_points(robot, nominal_chain(robot, q), len(q))
    moving = np.ptp(points[:, :, 2], axis=0) > 1e-9
    lowest = float(points[:, moving, 2].min()) if moving.any() else np.inf
    return min(lowest, float(points[0, 0, 2])) - 1e-9
