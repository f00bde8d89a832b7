"""What is drawn of an arm at a posture, in numbers: pictures and the interactive view show the same."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from posture_opt.collision.facets import quads, rectangle
from posture_opt.numerics import Array
from posture_opt.report.scene.arm_solids import ArmSolids, JointAxis, Solid, is_level
from posture_opt.report.text.words import REGIONS

if TYPE_CHECKING:
    from posture_opt.collision.scene import Scene
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.program.task_target import TaskTarget
    from posture_opt.uncertainty.spread.spread import Spread

_REGION_SHARE = 0.16  # of the arm's extent: the size at which an ellipsoid is well seen
_OBSTACLE_MARGIN = 0.35  # of the arm's extent: so far around it obstacles are drawn
_MAX_WHOLE_OBSTACLE = 2.5  # of the extent: larger obstacles are cut off
_FLOOR_MARGIN = 0.25  # of the extent: so far the floor goes on beyond the arm and the obstacles


@dataclass(frozen=True)
class ErrorRegion:
    """The 95 % region of the tool point.

    Args:
        center: (3,) [m].
        semi_axes: (3, m) columns from the centre to the surface, true to scale [m]; m = 2 for a planar arm.
        factor: by which the drawing enlarges it about its centre.
        label: what it is and how much it is enlarged.
    """

    center: Array
    semi_axes: Array
    factor: float
    label: str

    @classmethod
    def of(cls, spread: Spread, factor: float) -> ErrorRegion:
        """The region of the tool at a posture, enlarged by ``factor``."""
        ellipse = spread.ellipse
        semi_axes = ellipse.factor(0.95) * (spread.basis.T @ (ellipse.axes * ellipse.semi_axes))
        name = REGIONS[ellipse.rank]
        label = f"{name}, enlarged {factor:g}\N{MULTIPLICATION SIGN}" if factor > 1 else f"{name}, true to scale"
        return cls(spread.basis.T @ ellipse.center, semi_axes, factor, label)

    def surface(self, n: int = 16) -> Array:
        """(a, b, 3) points of the enlarged surface [m]; of the enlarged ellipse of a planar arm."""
        v = np.linspace(0.0, 2 * math.pi, 2 * n + 1)
        if self.semi_axes.shape[1] < 3:
            u = np.linspace(0.0, 1.0, 4)[:, None]
            unit = np.stack([u * np.cos(v), u * np.sin(v)][: self.semi_axes.shape[1]], axis=-1)
        else:
            u = np.linspace(0.0, math.pi, n + 1)[:, None]
            unit = np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u) + 0.0 * v], axis=-1)
        points: Array = self.center + self.factor * unit @ self.semi_axes.T
        return points

    def faces(self, n: int = 16) -> Array:
        """(k, 4, 3) the enlarged surface as faces [m]."""
        return quads(self.surface(n))


@dataclass(frozen=True)
class TargetGeometry:
    """Where the tool point is to go.

    Args:
        lower, upper: (3,) the box for the tool point [m]; equal for a point.
        direction: (3,) unit vector of the task.
        clearance: radial [m], true to scale; None where there is none.
    """

    kind: Literal["point", "region", "anywhere"]
    lower: Array
    upper: Array
    direction: Array
    clearance: float | None

    @classmethod
    def of(cls, target: TaskTarget) -> TargetGeometry:
        """Of the target of a solve."""
        kind: Any = target.kind
        return cls(kind, target.lower, target.upper, target.direction, target.given_clearance)


@dataclass(frozen=True)
class ArmGeometry:
    """All that is drawn of one posture, world frame [m].

    Args:
        solids: base block, links, joints, tool.
        frames: (n + 2, 4, 4) of base, links and tool.
        joints: (n,) where they act.
        tool_point: (3,) without errors.
        region: about its mean.
        direction: (3,) unit vector of the task; None where none is asked for.
        target: None where none is asked for, as of a spread.
        obstacles: those near the arm; of large ones what is near.
        floor: under all of it; None for a planar arm and where an obstacle is the floor.
    """

    solids: tuple[Solid, ...]
    frames: Array
    joints: tuple[JointAxis, ...]
    tool_point: Array
    region: ErrorRegion
    direction: Array | None
    target: TargetGeometry | None
    obstacles: tuple[Solid, ...]
    floor: Solid | None
    planar: bool

    @classmethod
    def of_solution(cls, solution: Solution) -> ArmGeometry:
        """The posture of a solution with its target and its cell."""
        target = TargetGeometry.of(solution.target)
        return cls.of(solution.spread, target.direction, target, solution.problem.scene)

    @classmethod
    def of_spread(cls, spread: Spread) -> ArmGeometry:
        """A posture with the direction of the task, where there is one, and the cell."""
        direction = None if spread.for_task is None else spread.for_task.direction
        return cls.of(spread, direction, None, getattr(spread.problem, "scene", None))

    @classmethod
    def of(
        cls, spread: Spread, direction: Array | None, target: TargetGeometry | None, scene: Scene | None
    ) -> ArmGeometry:
        """The posture of a spread with what is asked of the tool point and the obstacles."""
        arm = ArmSolids(spread.tool_point.robot)
        frames = arm.frames(spread.q)
        solids = tuple(solid.placed(frames) for solid in arm.solids if not _sunk(solid.placed(frames), scene))
        points = np.concatenate([solid.faces.reshape(-1, 3) for solid in solids])
        region = ErrorRegion.of(spread, enlargement(float(spread.region(0.95)[-1]), extent_of(points)))
        obstacles = () if scene is None else obstacles_near(scene, points)
        planar = len(spread.basis) == 2
        floor = None if planar else floor_under(points, obstacles, None if scene is None else scene.floor_height)
        joints = tuple(joint.placed(frames) for joint in arm.joints)
        return cls(
            solids, frames, joints, spread.position, region, direction, target, obstacles, floor, planar
        )  # fmt: skip

    @cached_property
    def points(self) -> Array:
        """(k, 3) corners of all surfaces of the arm [m]."""
        return np.concatenate([solid.faces.reshape(-1, 3) for solid in self.solids])

    @cached_property
    def extent(self) -> float:
        """The largest edge of the box around the arm [m]."""
        return extent_of(self.points)


def extent_of(points: Array) -> float:
    """The largest edge of the box around points (k, 3) [m]."""
    return max(float(np.ptp(points, axis=0).max()), 1e-3)


def enlargement(size: float, extent: float) -> float:
    """The round factor (1, 2, 5, 10, 20, …) that brings ``size`` [m] nearest below a sixth of ``extent`` [m]."""
    if size <= 0:
        return 1.0
    wanted = max(_REGION_SHARE * extent / size, 1.0)
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(step * power for step in (1, 2, 5) if step * power <= wanted * (1 + 1e-9))


def obstacles_near(scene: Scene, points: Array) -> tuple[Solid, ...]:
    """The obstacles near an arm with points (k, 3) [m]; of large ones what is near."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = float((high - low).max())
    low, high = low - _OBSTACLE_MARGIN * size, high + _OBSTACLE_MARGIN * size
    found = []
    for obstacle in scene.stated_obstacles:
        faces = obstacle.facets(low, high)
        middle = faces.mean(axis=1)
        near = np.all((middle >= low) & (middle <= high), axis=1)
        if near.any():
            small = extent_of(faces.reshape(-1, 3)) < _MAX_WHOLE_OBSTACLE * size
            found.append(Solid(obstacle.name, "obstacle", -1, faces if small else faces[near]))
    return tuple(found)


def floor_under(points: Array, obstacles: Sequence[Solid], height: float | None = None) -> Solid | None:
    """A level floor at a height [m], by default under an arm with points (k, 3) [m] and all obstacles.

    None where an obstacle serves as one.
    """
    if any(is_level(obstacle) for obstacle in obstacles):
        return None
    seen = np.concatenate([points, *(obstacle.faces.reshape(-1, 3) for obstacle in obstacles)])
    low, high = seen.min(axis=0), seen.max(axis=0)
    half = (high - low)[:2] / 2 + _FLOOR_MARGIN * extent_of(seen)
    middle = np.array([*(low + high)[:2] / 2, low[2] if height is None else height])
    return Solid("floor", "floor", -1, rectangle(middle, np.array([half[0], 0, 0]), np.array([0, half[1], 0]), 8))


def _sunk(solid: Solid, scene: Scene | None) -> bool:
    """Whether a base block is inside an obstacle: then the arm is mounted on that."""
    if solid.role != "base" or scene is None:
        return False
    middle = solid.faces.reshape(-1, 3).mean(axis=0)[None]
    return any(float(obstacle.distance(middle, middle)[0]) < 1e-9 for obstacle in scene.obstacles)
