"""What is drawn of an arm at a posture, in numbers: pictures and the interactive view show the same."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from posture_opt.collision.facets import quads, rectangle
from posture_opt.numerics import Array, round_below
from posture_opt.report.scene.arm_solids import ArmSolids, Solid
from posture_opt.report.text.words import REGIONS
from posture_opt.statements.notation import stated_length

if TYPE_CHECKING:
    from posture_opt import Solution, Spread
    from posture_opt.collision.scene import Scene
    from posture_opt.selection.program.task_target import TaskTarget

ARROW_SHARE = 0.3  # of the arm's extent: the arrow of the direction of the task
_OBSTACLE_MARGIN = 0.35  # of the arm's extent: so far around it obstacles are drawn


@dataclass(frozen=True)
class ErrorRegion:
    """The 95 % region of the tool point; ``center`` (3,) [m], ``semi_axes`` (3, m) [m]."""

    center: Array
    semi_axes: Array
    factor: float
    label: str

    @classmethod
    def of(cls, spread: Spread, factor: float) -> ErrorRegion:
        """The region of the tool at a posture, enlarged by ``factor``."""
        ellipse = spread.ellipse
        semi_axes = ellipse.factor(0.95) * (spread.basis.T @ (ellipse.axes * ellipse.semi_axes))
        label = f"{REGIONS[ellipse.rank]}, {scale_words(factor)}"
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
    """Where the tool point is to go; ``lower, upper`` (3,) [m], ``direction`` (3,), ``clearance`` [m]."""

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

    def missed(self, tool_point: Array) -> bool:
        """Whether a tool point (3,) [m] is off the target."""
        # From 0.1 mm on the target is marked next to the tool point.
        return self.kind == "point" and float(np.linalg.norm(self.lower - tool_point)) > 1e-4

    def ring(self, factor: float, tool_point: Array, extent: float) -> Ring | None:
        """The rim of the hole, enlarged as the region is; None without a clearance, or where it is too large to draw;
        ``tool_point`` (3,) [m], ``extent`` [m]."""
        # A ring beyond 0.3 of the extent is not drawn.
        if not self.clearance or factor * self.clearance > 0.3 * extent:
            return None
        label = f"hole: clearance {stated_length(self.clearance)}, {scale_words(factor)}"
        center = self.lower if self.kind == "point" else tool_point
        return Ring(center, factor * self.clearance * frame_along(self.direction), label)


@dataclass(frozen=True)
class Ring:
    """The rim of a hole; ``center`` (3,) [m], ``axes`` (3, 3) [m]."""

    center: Array
    axes: Array
    label: str

    def points(self, n: int = 73) -> Array:
        """(n, 3) points of the rim [m]."""
        turn = np.linspace(0.0, 2 * math.pi, n)
        rim: Array = self.center + np.stack([np.cos(turn), np.sin(turn)], axis=1) @ self.axes[:, :2].T
        return rim

    def walls(self, normal: Array, depth: float) -> list[Array]:
        """Both walls (5, 3) of so deep a hole [m] that are seen along the normal (3,) of a plane which it lies in."""
        aside, along = np.cross(normal, self.axes[:, 2]), self.axes[:, 2] / np.linalg.norm(self.axes[:, 2])
        return [self.center + sign * aside + depth * np.linspace(0.0, 1.0, 5)[:, None] * along for sign in (1, -1)]


@dataclass(frozen=True)
class ArmGeometry:
    """All that is drawn of one posture, world frame [m].

    Args:
        solids: base block, links, joints, tool.
        frames: (n + 2, 4, 4) of base, links and tool.
        tool_point: (3,) without errors.
        region: about its mean.
        direction: (3,) unit vector of the task; None where none is asked for.
        target: None where none is asked for, as of a spread.
        obstacles: those near the arm; of large ones what is near.
        floor: under all of it; None for a planar arm and where an obstacle is the floor.
        ground: (2, 3) orthonormal axes of the plane that the picture shows behind or under all of it, and how far that
            is along their normal [m].
    """

    solids: tuple[Solid, ...]
    frames: Array
    tool_point: Array
    region: ErrorRegion
    direction: Array | None
    target: TargetGeometry | None
    obstacles: tuple[Solid, ...]
    floor: Solid | None
    ground: tuple[Array, float]
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
        solids = tuple(solid.placed(frames) for solid in arm.solids)
        if scene is not None:
            # A base block inside an obstacle is left out: the arm is mounted on that.
            middles = [solid.corners.mean(axis=0)[None] for solid in solids]
            sunk = [any(float(o.distance(at, at)[0]) < 1e-9 for o in scene.obstacles) for at in middles]
            solids = tuple(s for s, inside in zip(solids, sunk, strict=True) if s.role != "base" or not inside)
        points = np.concatenate([solid.corners for solid in solids])
        region = ErrorRegion.of(spread, enlargement(float(spread.region(0.95)[-1]), extent_of(points)))
        obstacles = () if scene is None else obstacles_near(scene, points)
        planar = len(spread.basis) == 2
        floor = None if planar else floor_under(points, obstacles, None if scene is None else scene.floor_height)
        axes = np.asarray(spread.basis) if planar else np.eye(3)[:2]
        level = floor or next((obstacle for obstacle in obstacles if obstacle.level), None)
        ground = axes, float(((points if level is None else level.faces) @ np.cross(*axes)).min())
        return cls(solids, frames, spread.position, region, direction, target, obstacles, floor, ground, planar)

    @property
    def ring(self) -> Ring | None:
        """The rim of the hole at the target, where there is one to draw."""
        return None if self.target is None else self.target.ring(self.region.factor, self.tool_point, self.extent)

    @cached_property
    def points(self) -> Array:
        """(k, 3) corners of all surfaces of the arm [m]."""
        return np.concatenate([solid.corners for solid in self.solids])

    @cached_property
    def extent(self) -> float:
        """The largest edge of the box around the arm [m]."""
        return extent_of(self.points)


def scale_words(factor: float) -> str:
    """How much larger something is drawn than it is."""
    return f"enlarged {factor:g}\N{MULTIPLICATION SIGN}" if factor > 1 else "true to scale"


def frame_along(axis: Array) -> Array:
    """(3, 3) a right-handed frame whose z axis is the given one."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def extent_of(points: Array) -> float:
    """The largest edge of the box around points (k, 3) [m]."""
    return max(float(np.ptp(points, axis=0).max()), 1e-3)


def enlargement(size: float, extent: float) -> float:
    """The round factor (1, 2, 5, 10, 20, …) that brings ``size`` [m] nearest below a sixth of ``extent`` [m]."""
    # At 0.16 of the arm's extent an ellipsoid is well seen.
    return round_below(max(0.16 * extent / size, 1.0)) if size > 0 else 1.0


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
            # Obstacles beyond 2.5 times the extent are cut off.
            small = extent_of(faces.reshape(-1, 3)) < 2.5 * size
            found.append(Solid(obstacle.name, "obstacle", -1, faces if small else faces[near]))
    return tuple(found)


def floor_under(points: Array, obstacles: Sequence[Solid], height: float | None = None) -> Solid | None:
    """A level floor at a height [m], by default under an arm with points (k, 3) [m] and all obstacles."""
    if any(obstacle.level for obstacle in obstacles):
        return None
    seen = np.concatenate([points, *(obstacle.corners for obstacle in obstacles)])
    low, high = seen.min(axis=0), seen.max(axis=0)
    # The floor goes on by 0.25 of the extent beyond arm and obstacles.
    half = (high - low)[:2] / 2 + 0.25 * extent_of(seen)
    middle = np.array([*(low + high)[:2] / 2, low[2] if height is None else height])
    return Solid("floor", "floor", -1, rectangle(middle, np.array([half[0], 0, 0]), np.array([0, half[1], 0]), 8))
