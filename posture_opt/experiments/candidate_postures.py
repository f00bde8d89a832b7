"""Postures that an arm may be sent to for a measurement: inside its limits and clear of what is known to be there."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.collision.scene import Scene
from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.experiments.information import planned_rows
from posture_opt.experiments.planned_kind import KindPlaces
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
# Candidate rows of each sort, before those that are not allowed go: enough for a design and a few seconds.
_MEASURED_CANDIDATES, _SWUNG_CANDIDATES, _RANDOM_CANDIDATES = 150, 350, 500


@dataclass(frozen=True)
class Workspace:
    """Where an arm may go; postures (N, w) are the joints, then what `KindPlaces` has beside them."""

    robot: Robot
    lower: Array  # (n,) of every joint, one turn at most, the margins to the limits taken off [rad, m]
    upper: Array
    height: float  # least height (world z) of the tool point and of all links that a joint can raise [m]; −inf: none
    box: Box  # lower and upper corner of where the tool point may go, world [m]
    scene: Scene  # what the arm must not collide with: itself, with capsules along its links, and its cell
    places: KindPlaces | None = None  # of an instrument that shows no position: only what it measures is allowed

    @classmethod
    def of(
        cls, robot: Robot, scene: Scene, *, height: float = -math.inf, margin: float = 0.0, box: Box = ANYWHERE
    ) -> Workspace:
        """The workspace inside the limits; ``margin`` to the limits of revolute joints where one is stated [rad]."""
        lower, upper = np.array([joint_range(joint, margin) for joint in robot.joints], dtype=float).T
        return cls(robot, lower, upper, height, box, scene)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints of the arm, then of a second one."""
        return (*self.robot.joints, *(joint for _, joint in (self.places.further if self.places else ())))

    @cached_property
    def ranges(self) -> tuple[Array, Array]:
        """(w,), (w,) lower and upper end of all joints [rad or m]."""
        more = np.array([joint_range(joint, 0.0) for joint in self.joints[self.robot.n :]]).reshape(-1, 2)
        return np.r_[self.lower, more[:, 0]], np.r_[self.upper, more[:, 1]]

    @property
    def bounded(self) -> bool:
        """Whether the tool point is held in a box."""
        return bool(np.isfinite(self.box).any())

    def clear(self, q: Array) -> Mask:
        """Which of the postures (N, n) [rad or m] are in the box, high enough and free of collisions (N,)."""
        points = skeleton_points(self.robot, nominal_chain(self.robot, q), len(q))
        moving = np.ptp(points[:, :, 2], axis=0) > 1e-9 if len(q) > 1 else np.ones(points.shape[1], dtype=bool)
        heights = np.where(moving, points[:, :, 2], np.inf).min(axis=1)
        inside = np.all((points[:, -1] >= self.box[0]) & (points[:, -1] <= self.box[1]), axis=1)
        found = np.asarray(inside & (heights >= self.height))
        found[found] = self.scene.slack(q[found]) >= 0
        return found

    def allowed(self, q: Array) -> Mask:
        """Which of the postures (N, w) are clear, and measure something."""
        found = self.clear(q[:, : self.robot.n])
        if self.places is not None:
            found[found] = self.places.offered(q[found])[1]
            found[found] = ~self.places.hidden(q[found], self.scene.placed)
        return found

    def passable(self, q: Array) -> Mask:
        """Which of the postures (N, w) may be passed through: an attached instrument measures on the way too."""
        attached = self.places is not None and self.places.kind.attached
        return self.allowed(q) if attached else self.clear(q[:, : self.robot.n])

    def postures(self, count: int, rng: np.random.Generator) -> tuple[Array, float]:
        """Random allowed postures (count, w), rounded, and the share of the tried ones that were allowed."""
        found: list[Array] = []
        have = tried = 0
        # 200 000 random postures before the search for allowed ones is given up
        while have < count and tried < 200_000:
            q = self.rounded(self.drawn(rng, 5000))
            found.append(q[self.allowed(q)])
            have, tried = have + len(found[-1]), tried + 5000
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
        """(count, w) postures at random where the instrument may see something."""
        if self.places is not None:
            return self.places.drawn(rng, count, *self.ranges)
        return rng.uniform(self.lower, self.upper, (count, self.robot.n))

    def rounded(self, q: Array) -> Array:
        """Postures (N, w) as in the file, to 0.01 deg and 0.01 mm inside the limits; touches are led to their place."""
        q, w = q if self.places is None else self.places.touching(q), len(self.joints)
        step, (lower, upper) = np.array([POSTURE_STEP[joint.type] for joint in self.joints]), self.ranges
        own = np.clip(np.round(q[:, :w] / step), np.ceil(lower / step), np.floor(upper / step)) * step
        return np.column_stack([own, np.round(q[:, w:])])

    def separations(self, count: int) -> Array:
        """(w,) by which two of ``count`` postures differ in one number at least [rad or m]."""
        stated = np.array([_SEPARATION[joint.type] for joint in self.joints])
        room = self.steps()[: len(stated)] / (4 * count ** (1 / len(stated)))
        # Another instrument is another posture: their numbers differ by more than 0.5.
        return self._with_instrument(np.maximum(np.minimum(stated, room), 1e-9), 0.5)

    def steps(self) -> Array:
        """(w,) what a step to a posture nearby is a share of: the ranges of the joints [rad or m]."""
        return self._with_instrument(self.ranges[1] - self.ranges[0], 0.0)

    def unit_travel(self) -> Array:
        """(w,) travel that counts as one radian: 1 rad of a revolute joint, of a slide the length of the arm or 1 m."""
        size = self.robot.length or 1.0
        own = np.array([1.0 if joint.type == "revolute" else size for joint in self.joints])
        return self._with_instrument(own, np.inf)

    def _with_instrument(self, own: Array, value: float) -> Array:
        """(w,) of the joints (m,), and of the number of the instrument behind them."""
        return np.concatenate([own, np.full(self.places.fixed if self.places else 0, value)])


def joint_range(joint: Joint, margin: float) -> tuple[float, float]:
    """Ends of a joint's range in a plan [rad or m]: one turn at most, less a margin to its limits."""
    lower, upper = joint.lower, joint.upper
    if joint.type == "prismatic" and not (math.isfinite(lower) and math.isfinite(upper)):
        raise InputError(Issue(f"{joint.name} has no limits to plan within", hint=f"state the limits of {joint.name}"))
    if joint.type == "revolute" and not upper - lower <= 2 * math.pi:  # a full turn more is the same posture
        lower = -math.pi if lower <= -math.pi and upper >= math.pi else max(lower, upper - 2 * math.pi)
        return lower, lower + 2 * math.pi
    stated = margin if joint.type == "revolute" else 0.0
    # 0.05 of a joint's range
    inward = max(min(_LIMIT_MARGIN[joint.type], 0.05 * (upper - lower)), min(stated, 0.49 * (upper - lower)))
    return lower + inward, upper - inward


def measured_room(robot: Robot, q: Array | None) -> Robot:
    """The robot itself; a flange without an arm may go where its poses q (N, n) [rad or m] were measured."""
    if not robot.pose_prefix:
        return robot
    if q is None:
        hint = "name some that the arm reaches: --given DATA.csv"
        raise InputError(Issue("poses of a flange are planned among measured ones", ("robot", "kind"), "flange", hint))
    turns = np.array([joint.type == "revolute" for joint in robot.joints])
    near = np.where(turns, np.angle(np.exp(1j * (q - q[0]))) + q[0], q)
    ends = zip(robot.joints, near.min(axis=0).tolist(), near.max(axis=0).tolist(), strict=True)
    return replace(robot, joints=tuple(replace(joint, lower=lower, upper=upper) for joint, lower, upper in ends))


def nominal_chain(robot: Robot, q: Array) -> Walk:
    """The nominal chain at the postures (N, n) [rad or m], without effects; origins of its frames in the world."""
    return walk(robot.factors, factor_values(robot.factors, [np.ascontiguousarray(column) for column in q.T]))


def skeleton_points(robot: Robot, reached: Walk, count: int) -> Array:
    """(N, n + 2, 3) origin of the first joint, of the frame behind every joint, and the tool point [m]."""
    ends = np.cumsum([len(robot.base), *(len(link) for link in robot.links)])
    origins = [screw.origin for screw in reached.screws] + [reached.position]
    corners = [origins[k] for k in ends] + [reached.position]
    return np.stack([np.broadcast_to(stack(corner), (count, 3)) for corner in corners], axis=1)


def candidate_rows(residuals: Residuals, joints: Collection[int], sided: bool, seed: int = 0) -> Measurements:
    """Rows that could be measured, none of them yet."""
    robot, data = residuals.robot, residuals.data
    rng = np.random.default_rng(seed)
    known = np.unique(data.q, axis=0)
    known = known[rng.permutation(len(known))]
    # What the arm was mounted on when it was measured is unknown; it reached no lower than its foot or the lowest row.
    points = skeleton_points(robot, nominal_chain(robot, data.q), len(data))
    moving = np.ptp(points[:, :, 2], axis=0) > 1e-9
    lowest = float(points[:, moving, 2].min()) if moving.any() else np.inf
    scene = Scene.of(robot, None, guessed=True, without_mounting=True)
    room = measured_room(robot, data.q)
    workspace = Workspace.of(room, scene, height=min(lowest, float(points[0, 0, 2])) - 1e-9)
    swung = known[rng.integers(len(known), size=_SWUNG_CANDIDATES)]
    columns = list(joints) or list(range(robot.n))
    lower, upper = workspace.lower, workspace.upper
    swung[:, columns] = rng.uniform(lower[columns], upper[columns], (_SWUNG_CANDIDATES, len(columns)))
    anywhere = rng.uniform(lower, upper, (_RANDOM_CANDIDATES, robot.n))
    q = workspace.rounded(np.concatenate([known[:_MEASURED_CANDIDATES], swung, anywhere]))
    q = q[workspace.allowed(q)]
    rows = planned_rows(robot, q, data.measured_axes, data.target_names[:1], oriented=data.rotation is not None)
    measured = np.unique(np.round(data.payload, 3)) if data.payload is not None else np.zeros(0)
    if len(measured) > 4:  # of more payloads the least, the largest and some between
        measured = measured[np.linspace(0, len(measured) - 1, 4).round().astype(int)]
    loads = tuple(sorted({0.0, round(robot.payload, 3), *map(float, measured)}))
    return replace(
        rows,
        payload=None if loads == (0.0,) and data.payload is None else rng.choice(loads, len(q)),
        temperature=None if data.temperature is None else np.full(len(q), float(np.mean(data.temperature))),
        time=np.zeros(len(q)),
        approach=rng.choice([-1.0, 1.0], q.shape) if sided else np.zeros(q.shape),
        approach_length=np.tile(np.median(data.approach_length, axis=0), (len(q), 1)),
    )
