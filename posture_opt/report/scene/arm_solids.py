"""The arm as solids that move with its frames: base block, links, joints, tool.

Links are the capsules of the arm's shape where that is known; else they taper along the chain from the base to the
tool, as thick as arms of that length are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from posture_opt.collision.facets import cylinder_facets, rectangle, tapered_facets
from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array
from posture_opt.report.page.colours import BLUE, GREEN, ORANGE, VERMILLION
from posture_opt.robot.robot import BASE, TOOL, Capsule, Robot
from posture_opt.robot.shape_section import STAND_IN_RADIUS_RATIO, stand_in, tool_capsule

Role = Literal["base", "link", "joint", "tool", "obstacle", "floor", "region"]
COLOURS = {
    "base": "#3C4146", "link": "#D3DBE2", "joint": BLUE, "tool": "#53585E", "obstacle": "#F2DFCA", "floor": "#F3F3F3",
    "region": ORANGE, "ring": GREEN, "direction": "#222222", "missed": VERMILLION,
}  # fmt: skip
"""What is drawn of an arm -> its colour in pictures, on pages and on the live page; dark and light also in grey."""

_TAPER_RADII = 1.25, 0.55  # of the radius: at the base, and at the end of the last link
_BLOCK_SIZE = 1.9, 0.6  # of the radius at the base: half side and height of the base block
_DRUM_SIZE = 0.75, 1.12  # of the link's radius: radius and half length of a joint, whose ends show like caps
_SLIDE_SIZE = 0.45, 1.6  # the same of a slide
_AXIS_SHARES = np.linspace(-1.0, 1.0, 201)  # of the arm's length: where the middle of a joint is looked for on its axis


@dataclass(frozen=True)
class Solid:
    """A body with its surface.

    Args:
        name: of the joint that it belongs to or of the obstacle; ``base``, ``tool``, ``floor``.
        frame: which frame of the arm it moves with: 0 the base, k behind joint k, n + 1 the tool; -1: the world.
        faces: (k, 4, 3) [m] in that frame.
    """

    name: str
    role: Role
    frame: int
    faces: Array

    def placed(self, frames: Array) -> Solid:
        """The solid in the world, where the frames (n + 2, 4, 4) of the arm are."""
        if self.frame < 0:
            return self
        T = frames[self.frame]
        return replace(self, frame=-1, faces=self.faces @ T[:3, :3].T + T[:3, 3])

    @property
    def corners(self) -> Array:
        """(4 k, 3) [m]."""
        return self.faces.reshape(-1, 3)

    @property
    def level(self) -> bool:
        """Whether it is a floor: all of it at one height."""
        return float(np.ptp(self.faces[..., 2])) < 1e-9

    @cached_property
    def normals(self) -> Array:
        """(k, 4, 3) at each corner the sum of the unit normals of the faces that meet there without an edge.

        Faces count as smooth up to an angle with the cosine 0.7, about 46 degrees.
        """
        flat = np.cross(self.faces[:, 3] - self.faces[:, 1], self.faces[:, 2] - self.faces[:, 0])
        flat = flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-300)
        # Corners that agree to 0.1 µm are one.
        _, place = np.unique(self.faces.reshape(-1, 3).round(7), axis=0, return_inverse=True)
        order, sizes = np.argsort(place.ravel(), kind="stable"), np.bincount(place.ravel())
        total = np.zeros((4 * len(flat), 3))
        # Corners in one place are neighbours in this order: each is compared with those behind it, up to the largest
        # number of corners in one place.
        for step in range(int(sizes.max(initial=0))):
            one, other = order[: len(order) - step], order[step:]
            a, b = flat[one // 4], flat[other // 4]
            # From a cosine of 0.7 down, an edge is sharp.
            smooth = (place.ravel()[one] == place.ravel()[other]) & (np.sum(a * b, axis=1) > 0.7)
            total[one[smooth]] += b[smooth]
            if step:
                total[other[smooth]] += a[smooth]
        return total.reshape(-1, 4, 3)


@dataclass(frozen=True)
class JointAxis:
    """Where a joint acts; ``middle`` (3,) [m], ``axis`` (3,), ``radius`` [m]."""

    name: str
    type: Literal["revolute", "prismatic"]
    frame: int
    middle: Array
    axis: Array
    radius: float

    def placed(self, frames: Array) -> JointAxis:
        """The joint in the world, where the frames (n + 2, 4, 4) of the arm are."""
        T = frames[self.frame]
        return replace(self, frame=-1, middle=T[:3, :3] @ self.middle + T[:3, 3], axis=T[:3, :3] @ self.axis)


@dataclass(frozen=True)
class Link:
    """A cone between two balls in the frame that it moves with; ``joint`` as of a `Capsule`.

    Args:
        start, end: (3,) middles of the balls [m].
        start_radius, end_radius: of the balls [m]; equal for a capsule.
    """

    joint: str
    start: Array
    end: Array
    start_radius: float
    end_radius: float


@dataclass(frozen=True)
class ArmSolids:
    """The solids of an arm, each in the frame that it moves with; `frames` says where these are at a posture."""

    robot: Robot

    def frames(self, q: Sequence[float] | Array) -> Array:
        """(n + 2, 4, 4) the frames of base, links and tool in the world at the posture ``q`` (n,)."""
        values, reached, found = [float(v) for v in q], walk((), ()), []
        for factors in (self.robot.base, *self.robot.links, self.robot.tool):
            reached = walk(factors, factor_values(factors, values), reached)
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = np.array(reached.columns, dtype=float).T, reached.position
            found.append(T)
        return np.array(found)

    @cached_property
    def radius(self) -> float:
        """How thick the arm is about its middle [m]: of its links, weighted by their length."""
        capsules = [c for c in self.robot.shape if c.joint not in (BASE, TOOL) and c.length > 0]
        if not self.robot.links_have_shape:
            return STAND_IN_RADIUS_RATIO * max(self.robot.length, 1e-3)
        return float(np.average([c.radius for c in capsules], weights=[c.length for c in capsules]))

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """Base, links and tool as cones between balls; of an arm without a shape, links taper from base to tool."""
        drawn = []
        if not self.robot.links_have_shape:
            capsules = stand_in(self.robot)
            way = np.concatenate([[0.0], np.cumsum([capsule.length for capsule in capsules])])
            radii = self.radius * np.interp(way / max(float(way[-1]), 1e-12), [0.0, 1.0], _TAPER_RADII)
            drawn = [_link(c, float(a), float(b)) for c, a, b in zip(capsules, radii, radii[1:], strict=False)]
        end = drawn[-1].end_radius if drawn else _TAPER_RADII[1] * self.radius
        # A tool of unknown shape ends at 0.12 of the radius.
        tools = [replace(_link(c, 0.9 * end, 0.12 * self.radius), joint=TOOL) for c in tool_capsule(self.robot)]
        return (*drawn, *(_link(c, c.radius, c.radius) for c in self.robot.shape), *tools)

    @cached_property
    def joints(self) -> tuple[JointAxis, ...]:
        """(n,) each joint in the frame before it, its body where links on both sides are nearest to its axis."""
        return tuple(self._joint(k) for k in range(self.robot.n))

    @cached_property
    def solids(self) -> tuple[Solid, ...]:
        """All of them, each in its own frame."""
        roles: dict[str, Role] = {BASE: "base", TOOL: "tool"}
        found = [self._block()]
        for link in self.links:
            faces = tapered_facets(link.start, link.end, link.start_radius, link.end_radius)
            found.append(Solid(link.joint, roles.get(link.joint, "link"), self._frame(link.joint), faces))
        for joint in self.joints:
            wide, long = _DRUM_SIZE if joint.type == "revolute" else _SLIDE_SIZE
            reach = long * joint.radius * joint.axis
            faces = cylinder_facets(joint.middle - reach, joint.middle + reach, wide * joint.radius)
            found.append(Solid(joint.name, "joint", joint.frame, faces))
        return tuple(found)

    def _frame(self, joint: str) -> int:
        """The number of the frame that a joint carries."""
        at = {BASE: 0, TOOL: self.robot.n + 1}
        return at[joint] if joint in at else self.robot.joint_names.index(joint) + 1

    def _block(self) -> Solid:
        side, height = (factor * self.radius for factor in _BLOCK_SIZE)
        u, v = np.diag([side, side, 0.0])[:2]
        top, up = np.array([0.0, 0.0, -self.robot.mounting_below]), np.array([0.0, 0.0, height / 2])
        middle = top - up
        ends = [rectangle(top, u, v, 1), rectangle(middle - up, v, u, 1)]
        sides = [rectangle(middle + s * a, s * b, up, 1) for a, b in ((u, v), (v, -u)) for s in (1.0, -1.0)]
        return Solid(BASE, "base", 0, np.concatenate([*ends, *sides]))

    def _joint(self, k: int) -> JointAxis:
        """Joint k, its body where the links before and behind it come nearest to its axis."""
        joint, frames = self.robot.joints[k], self.frames(np.zeros(self.robot.n))
        front = next(i for i, factor in enumerate(self.robot.links[k]) if factor.joint is not None)
        factors = self.robot.links[k][:front]
        reached = walk(factors, factor_values(factors, np.zeros(self.robot.n).tolist()))
        origin, axis = np.array(reached.position), np.array(reached.columns[self.robot.links[k][front].axis])
        T = frames[k]
        points = T[:3, :3] @ (origin[:, None] + self.robot.length * _AXIS_SHARES * axis[:, None]) + T[:3, 3:]
        before = self._nearest(points.T, frames, k)
        behind = self._nearest(points.T, frames, k + 1)
        best = int(np.argmin(before[0] + behind[0] + 1e-3 * self.robot.length * np.abs(_AXIS_SHARES)))
        radius = max(float(near[1][best]) for near in (before, behind)) or self.radius
        middle = origin + self.robot.length * _AXIS_SHARES[best] * axis
        return JointAxis(joint.name, joint.type, k, middle, axis, radius)

    def _nearest(self, points: Array, frames: Array, frame: int) -> tuple[Array, Array]:
        """(N,) distances of points (N, 3) from the links that move with a frame, and the radius of the nearest one."""
        least, radius = np.full(len(points), np.inf), np.zeros(len(points))
        for link in self.links:
            if self._frame(link.joint) == frame:
                T = frames[frame]
                start, end = (T[:3, :3] @ point + T[:3, 3] for point in (link.start, link.end))
                along = end - start
                t = np.clip((points - start) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
                apart = np.linalg.norm(points - start - t[:, None] * along, axis=1)
                nearer = apart < least
                own = link.start_radius + t * (link.end_radius - link.start_radius)
                least, radius = np.where(nearer, apart, least), np.where(nearer, own, radius)
        return np.where(np.isfinite(least), least, 0.0), radius


def _link(capsule: Capsule, start_radius: float, end_radius: float) -> Link:
    return Link(capsule.joint, np.array(capsule.start), np.array(capsule.end), start_radius, end_radius)
