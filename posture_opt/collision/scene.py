"""``Scene``: an arm with its shape and what is around it; how near they come to each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from posture_opt.collision.cell import MOUNTING_PLANE, CellSpec, Mounting, below_base, carries
from posture_opt.collision.contacts import Apart, Contacts
from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.pairs import (
    Clearance,
    Nearest,
    Pair,
    apart_pairs,
    checked_against,
    checked_own,
    moving_capsules,
    obstacle_distances,
    own_distances,
    random_postures,
)
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.collision.smooth_bounds import segment_bound, soft_minimum
from posture_opt.numerics import Array
from posture_opt.robot.robot import TOOL, Capsule, Robot
from posture_opt.robot.shape_section import stand_in, tool_capsule, tool_radius
from posture_opt.statements import Quantity, Statement, state

SELF_CLEARANCE_ROW = "clearance of the arm to itself"
"""Name of the row that keeps links apart."""
SEPARATION_M = 0.1
"""Distance beyond the margin [m]: pairs that keep so far apart need no row."""
_ROW_TOLERANCE_M = 2e-6
"""Taken off each row [m]: more than a solver may leave of a row that counts as met."""
_SURFACE_M = 1e-4
"""Depth [m] up to which a point is on the surface of a solid, and not inside of it."""


_STATED = "stated length"


def row_name(obstacle: str) -> str:
    return f"clearance to {obstacle}"


class ClearanceRow(NamedTuple):
    """A smooth lower bound of the least distance of one group of pairs."""

    name: str  # what it keeps apart
    bound: ca.SX  # scalar expression of the joint values [m]


@dataclass(frozen=True)
class Scene:
    """What is checked for collisions."""

    placed: PlacedCapsules  # the capsules of the arm
    obstacles: tuple[Obstacle, ...]  # in the world, the mounting plane last
    margin: float  # least distance to keep [m]
    own: tuple[Pair, ...]  # pairs of capsules that are checked against each other
    against: tuple[tuple[int, ...], ...]  # for each obstacle the capsules that are checked against it
    required: tuple[float, ...] = ()  # (k,) least distance [m] of each of `pairs`
    # (c,) radii [m] that count against the arm itself: of a tool whose radius nobody states, its axis alone
    own_radii: tuple[float, ...] = ()
    left_out: tuple[tuple[str, str], ...] = ()  # names of pairs that overlap whatever the posture
    mounting: Mounting | None = None  # the surface that the arm stands on; None where there is none
    assumed: bool = False  # whether the shape is not known, and capsules along the links are taken in its place
    switched_off: bool = False  # whether the problem file asks for no checks (cell: none)
    stands_anywhere: bool = False  # whether neither shape nor file says what the arm stands on

    @classmethod
    def of(cls, robot: Robot, cell: CellSpec | None, *, guessed: bool = False, without_mounting: bool = False) -> Scene:
        """Scene of a robot and its cell; ``guessed`` shapes and the tool's end count for postures without a target."""
        asked = CellSpec() if cell is None else cell
        if not asked.checked:
            return cls(PlacedCapsules(robot, ()), (), asked.clearance, (), (), switched_off=True)
        mounting = Mounting.of(robot, asked.mounting, asked.obstacles)
        if mounting is not None and mounting.assumed and without_mounting:
            mounting = replace(mounting, dropped=True)
        plane = () if mounting is None or mounting.dropped else (mounting.plane(robot),)
        obstacles = (*asked.obstacles, *plane)
        stand_ins = _stand_ins(robot) if obstacles or guessed else ()
        # So much of the tool in front of its point touches the target, leaning up to 60 deg from its normal.
        free_end = 0.0 if guessed else 2.0 * (tool_radius(robot) + asked.clearance)
        stated = stand_ins + robot.shape
        tool = tool_capsule(robot, free_end) if stated else ()
        capsules = stated + tuple(part for whole in tool for part in _beyond_wrist(robot, whole))
        placed = PlacedCapsules(robot, capsules)
        known = 0 if guessed else len(stand_ins)  # what stands in for a link overlaps its neighbours
        pairs = tuple(pair for pair in apart_pairs(placed) if min(pair) >= known)
        # The first link turns on what the arm stands on, so the mounting plane is none of its.
        exposed = [moving_capsules(placed, int(k == len(asked.obstacles))) for k in range(len(obstacles))]
        assumes = robot.tool_radius is None and not guessed
        radii = tuple(0.0 if assumes and k >= len(stated) else c.radius for k, c in enumerate(capsules))
        own = checked_own(placed, pairs, asked.clearance, np.array(radii))
        joints, required = [capsule.joint for capsule in capsules], [*own.required]
        left_out, against = [(joints[pairs[k][0]], joints[pairs[k][1]]) for k in own.left_out], []
        for obstacle, chosen in zip(obstacles, exposed, strict=True):
            under = obstacle.name == MOUNTING_PLANE or carries(robot, obstacle)
            other = checked_against(placed, obstacle, chosen, asked.clearance, under)
            against.append(tuple(chosen[k] for k in other.chosen))
            required += other.required
            left_out += [(joints[chosen[k]], obstacle.name) for k in other.left_out]
        return cls(
            placed, obstacles, asked.clearance, tuple(pairs[k] for k in own.chosen), tuple(against), tuple(required),
            radii, tuple(dict.fromkeys(left_out)), mounting, bool(stand_ins),
            stands_anywhere=mounting is None and asked.mounting is None and not asked.obstacles,
        )  # fmt: skip

    @property
    def robot(self) -> Robot:
        return self.placed.robot

    @property
    def explicit(self) -> bool:
        """Whether there are stated obstacles: then the search keeps clear of them from the beginning."""
        return any(self.against[: len(self.stated_obstacles)])

    @property
    def stated_obstacles(self) -> tuple[Obstacle, ...]:
        """The obstacles of the problem, without the mounting plane."""
        return self.obstacles if self.plane is None else self.obstacles[:-1]

    @property
    def plane(self) -> Obstacle | None:
        """The mounting plane, where the arm is checked against it."""
        return None if self.mounting is None or self.mounting.dropped else self.obstacles[-1]

    @property
    def active(self) -> bool:
        return bool(self.own) or any(self.against)

    @property
    def floor_height(self) -> float | None:
        """Height [m] of the mounting plane over the world's origin, where it is a level floor; else None."""
        plane = None if self.mounting is None or self.mounting.dropped else self.mounting.plane(self.robot)
        return plane.offset if plane is not None and plane.normal == (0.0, 0.0, 1.0) else None

    @cached_property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """(k,) the two names of each column of `distances`."""
        joints = [capsule.joint for capsule in self.placed.capsules]
        return tuple((joints[i], joints[j] if isinstance(j, int) else j) for i, j in self._keys)

    @cached_property
    def unchecked(self) -> tuple[str, ...]:
        """Names of links without a shape: all, where nothing is checked at all."""
        if not self.placed.capsules:
            return self.robot.joint_names
        if self.robot.unshaped or self.assumed:
            return self.robot.unshaped
        shaped = {capsule.joint for capsule in self.placed.capsules}
        links = zip(self.robot.joint_names, self.robot.links, strict=True)
        bare = [(name, link) for name, link in links if name not in shaped]
        # Neighbours hide links below 10 mm.
        return tuple(n for n, link in bare if any(f.kind == "translate" and abs(f.nominal) > 0.01 for f in link))

    def distances(self, Q: Array) -> Array:
        """(N, k) exact distance of every pair at Q (N, n) [m]; zero or less where they overlap."""
        start, end = self.placed.segments(np.atleast_2d(Q))
        parts = [own_distances(np.array(self.own_radii), start, end, self.own)] if self.own else []
        others = zip(self.obstacles, self.against, strict=True)
        parts += [obstacle_distances(self.placed, o, start, end, chosen) for o, chosen in others if chosen]
        return np.hstack([np.zeros((len(start), 0)), *parts])

    def least(self, Q: Array) -> Array:
        """(N,) least distance at the postures Q (N, n) [m]; infinite where nothing is checked."""
        return np.asarray(np.min(self.distances(Q), axis=1, initial=np.inf)) if self.active else np.full(len(Q), np.inf)

    def slack(self, Q: Array) -> Array:
        """(N,) by how much the nearest pair exceeds its required distance at Q (N, n) [m]; infinite without pairs."""
        if not self.active:
            return np.full(len(Q), np.inf)
        return np.asarray(np.min(self.distances(Q) - np.array(self.required), axis=1))

    def mounting_note(self, Q: Array) -> str:
        """The sentence of `mounting_statement`; empty without one."""
        found = self.mounting_statement(Q)
        return "" if found is None else found.text

    def mounting_statement(self, Q: Array) -> Statement | None:
        """What a reader of the postures Q (N, n) has to know of the surface that the arm stands on."""
        if self.stands_anywhere:
            return below_base(self.placed, np.atleast_2d(Q))
        if self.mounting is None:
            return None
        plane, segments = self.mounting.plane(self.robot), self.placed.segments(np.atleast_2d(Q))
        away = obstacle_distances(self.placed, plane, *segments, moving_capsules(self.placed, 1))
        return self.mounting.statement(-float(np.min(away, initial=0.0)))

    def statements(self, Q: Array) -> tuple[Statement, ...]:
        """What the reader of the postures Q (N, n) [rad or m] must know before anyone drives there."""
        mounting, names = self.mounting_statement(Q), self.pierced(Q)
        pierced = [state("collision.tool-pierces", obstacles=names)] if names else []
        radius, touched = Quantity(tool_radius(self.robot), _STATED), self.within_tool(Q)
        inside = [state("collision.tool-touches", radius=radius, links=touched)] if touched else []
        return (*([] if mounting is None else [mounting]), *pierced, *inside)

    def clearance(self, Q: Array) -> Clearance | None:
        """Least distances over the postures Q (N, n) or (n,); None where nothing is checked."""
        if not self.active:
            return None
        least = self.distances(Q).min(axis=0)

        def nearest(columns: range) -> Nearest | None:
            if not columns:
                return None
            k = columns[int(np.argmin(least[columns.start : columns.stop]))]
            return Nearest(float(least[k]), self.pairs[k])

        return Clearance(nearest(range(len(self.own), len(self.pairs))), nearest(range(len(self.own))))

    def solids_at(self, point: Array) -> set[str]:
        """Names of the solids that hold a point (3,) [m], world, a dropped mounting plane included."""
        p = np.asarray(point, dtype=float)[None, None]
        dropped = self.mounting is not None and self.mounting.dropped
        solids = (*self.obstacles, *([self.mounting.plane(self.robot)] if self.mounting and dropped else []))
        return {o.name for o in solids if float(o.smaller(_SURFACE_M).distance(p, p)[0, 0]) <= 0}

    def pierced(self, Q: Array) -> tuple[str, ...]:
        """Obstacles pierced by the end of a tool without stated shape at Q (N, n), which belongs to no capsule."""
        if any(capsule.joint == TOOL for capsule in self.robot.shape):
            return ()
        tools = [k for k, capsule in enumerate(self.placed.capsules) if capsule.joint == TOOL]
        free = [math.dist(self.placed.capsules[k].end, (0.0, 0.0, 0.0)) for k in tools]
        if not tools or not self.obstacles or min(free) == 0:
            return ()
        last = tools[int(np.argmin(free))]
        start, end = (side[:, last] for side in self.placed.segments(np.atleast_2d(Q)))
        tip = end + min(free) * (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
        found = []
        for obstacle in self.obstacles:
            inner = obstacle.smaller(_SURFACE_M)
            through = inner.distance(end[:, None], tip[:, None])[:, 0] <= 0
            if np.any(through & (inner.distance(tip[:, None], tip[:, None])[:, 0] > 0)):
                found.append(obstacle.name)
        return tuple(found)

    @cached_property
    def _uncounted(self) -> Array:
        """What each own pair's (k,) radii have beyond those that count [m]."""
        more = self.placed.radii - self.own_radii
        return np.array([more[i] + more[j] for i, j in self.own])

    def within_tool(self, Q: Array) -> tuple[str, ...]:
        """Links that a tool of assumed radius overlaps at Q (N, n), while its axis keeps clear of them."""
        if not self.own:
            return ()
        overlap = np.any(self.distances(Q)[:, : len(self.own)] < self._uncounted, axis=0) & (self._uncounted > 0)
        return tuple(dict.fromkeys(self.pairs[k][0] for k in np.flatnonzero(overlap)))

    def closest(self, row: str, q: Array) -> tuple[tuple[str, str], float, float]:
        """Names, distance and required distance [m] of a row's pair that lacks most at q (n,)."""
        own, distances = row == SELF_CLEARANCE_ROW, self.distances(q)[0]
        mine = [k < len(self.own) if own else row_name(names[1]) == row for k, names in enumerate(self.pairs)]
        k = int(np.argmin(np.where(mine, distances - np.array(self.required), np.inf)))
        return self.pairs[k], float(distances[k]), self.required[k]

    def rows(self, q: ca.SX, obstacles: Sequence[Obstacle] | None = None) -> list[ClearanceRow]:
        """Lower bounds [m] for each obstacle and the arm itself at ``q`` (n,), each to be at least ``margin``.

        Below it one is at most `BOUND_SLACK_M`, and half of `SOFT_MINIMUM_WIDTH_M` for each doubling of equally near
        pairs, below the true distance. Pairs that random postures leave `SEPARATION_M` farther apart have no part.
        """
        placed, near = self.placed.symbols(q), self._near_pairs
        lowered = dict(zip(self._keys, (self.margin - np.array(self.required)).tolist(), strict=True))
        found: dict[str, list[ca.SX]] = {}
        for obstacle, chosen in zip(obstacles or self.obstacles, self.against, strict=True):
            name = obstacle.name
            for k in (k for k in chosen if near[k, name]):
                capsule = self.placed.capsules[k]
                bounds = obstacle.bounds(*placed[k], capsule.length, capsule.radius)
                found.setdefault(row_name(name), []).extend(bound + lowered[k, name] for bound in bounds)
        own = [pair for pair in self.own if near[pair]]
        if own:
            bounds = self._own_bounds(q, own)
            found[SELF_CLEARANCE_ROW] = [bound + lowered[pair] for pair, bound in zip(own, bounds, strict=True)]
        highest = ca.SX(self.margin + SEPARATION_M)
        return [ClearanceRow(name, soft_minimum([*all_, highest]) - _ROW_TOLERANCE_M) for name, all_ in found.items()]

    @cached_property
    def contacts(self) -> Contacts:
        """All pairs as rows of a search in C, with exact distances."""
        groups, solids = [[(i, j, -1)] for i, j in self.own], list[Obstacle]()
        for obstacle, chosen in zip(self.obstacles, self.against, strict=True):
            numbers = range(len(solids), len(solids) + len(obstacle.parts))
            groups += [[(k, -1, number) for number in numbers] for k in chosen]
            solids += obstacle.parts
        least = np.array(self.required)
        least[: len(self.own)] -= self._uncounted
        kept = zip(groups, least.tolist(), strict=True)
        pairs = (Apart(*pair, least + _ROW_TOLERANCE_M) for group, least in kept for pair in group)
        return Contacts(self.placed, tuple(solids), tuple(pairs), SEPARATION_M)

    @property
    def _keys(self) -> tuple[tuple[int, int | str], ...]:
        """(k,) the capsules, or capsule and obstacle, of each column of `distances`."""
        others = zip(self.obstacles, self.against, strict=True)
        return (*self.own, *((k, obstacle.name) for obstacle, chosen in others for k in chosen))

    @cached_property
    def _near_pairs(self) -> dict[tuple[int, int | str], bool]:
        blocks = np.array_split(random_postures(self.placed, 4000), 1 + len(self.pairs) // 500)  # 16 MB
        least = np.min([self.distances(Q).min(axis=0) for Q in blocks], axis=0)
        required = np.array(self.required)
        far = np.where(required < self.margin, required, self.margin + SEPARATION_M)
        return dict(zip(self._keys, (least < far).tolist(), strict=True))

    def _own_bounds(self, q: ca.SX, pairs: Sequence[Pair]) -> list[ca.SX]:
        frames, capsules = self.placed.frames, self.placed.capsules
        seen = {frame: self.placed.symbols(q, frame) for frame in {frames[i] for i, _ in pairs}}
        bounds = []
        for i, j in pairs:
            first, other, placed = capsules[i], capsules[j], seen[frames[i]]
            radius = self.own_radii[i] + self.own_radii[j]
            bounds.append(segment_bound(*placed[i], first.length, *placed[j], other.length, radius))
        return bounds


def _stand_ins(robot: Robot) -> tuple[Capsule, ...]:
    """Capsules along the links whose shape is not known; none where all is known or was replaced on purpose."""
    shaped = {capsule.joint for capsule in robot.shape} & set(robot.joint_names)
    if not shaped:
        return stand_in(robot)
    return tuple(capsule for capsule in stand_in(robot) if capsule.joint in robot.bare_joints)


def scene_statements(scene: Scene, Q: Array) -> tuple[Statement, ...]:
    """What is checked at the postures Q (N, n) [rad or m], with which shapes, and what is not."""
    if scene.switched_off:
        return (state("collision.switched-off"),)
    said = list(scene.statements(Q))
    if not scene.active:
        return tuple(said)
    itself = ["itself"] if scene.own or not scene.obstacles else []
    bodies, margin = (*(obstacle.name for obstacle in scene.obstacles), *itself), Quantity(scene.margin, _STATED)
    checked = state("collision.checked-with-margin", bodies=bodies, margin=margin)
    said.append(checked if scene.margin else state("collision.checked", bodies=bodies))
    said += [] if scene.stated_obstacles else [state("collision.no-obstacles")]
    said += [*_shapes(scene), *_unchecked_pairs(scene, Q)]
    clearance = scene.clearance(Q)
    if scene.margin == 0 and clearance is not None and clearance.distance < 5e-3:
        said.append(state("collision.very-near"))
    return tuple(said)


def _beyond_wrist(robot: Robot, tool: Capsule) -> tuple[Capsule, ...]:
    """The tool from where it leaves the arm's own capsules of the link before the wrist; empty where they contain it.

    Limits of joints keep the flange out of that link itself: as deep as it comes into a capsule, that is empty.
    """
    links = tuple(capsule for capsule in robot.shape if not capsule.added)
    flange = replace(tool, end=tool.start, radius=0.0)
    placed = PlacedCapsules(robot, (*links, flange))
    pairs = [(k, len(links)) for k, body in enumerate(placed.bodies[:-1]) if body == robot.n - 2]
    away = own_distances(placed.radii, *placed.segments(random_postures(placed, 1000)), pairs) if pairs else np.zeros(1)
    if away.min() >= 0:
        return (tool,)
    share = ((robot.tool_radius or 0.0) - float(away.min())) / tool.length
    a, b = np.array(tool.start), np.array(tool.end)
    x, y, z = (a + (b - a) * share).tolist()
    return (replace(tool, start=(x, y, z)),) if share < 1 else ()


def _shapes(scene: Scene) -> list[Statement]:
    said, robot = [], scene.robot
    if scene.assumed:
        radius = Quantity(float(scene.placed.radii[0]))
        said.append(state("collision.shape-assumed", radius=radius, links=robot.unshaped or ("its links",)))
    elif scene.unchecked:
        said.append(state("collision.links-unchecked", links=scene.unchecked))
    tools = [capsule for capsule in scene.placed.capsules if capsule.joint == TOOL]
    if tools and not any(capsule.joint == TOOL for capsule in robot.shape):
        name = "assumed" if robot.tool_radius is None else "stated"
        free = Quantity(math.dist(tools[0].end, (0.0, 0.0, 0.0)), _STATED)
        said.append(state(f"collision.tool-{name}", radius=Quantity(tools[0].radius, _STATED), free=free))
    return said


def _unchecked_pairs(scene: Scene, Q: Array) -> list[Statement]:
    said = []
    if scene.left_out:
        said.append(state("collision.pairs-left-out", pairs=tuple(f"{a} with {b}" for a, b in scene.left_out)))
    least: dict[tuple[str, str], float] = {}
    own = scene.distances(Q).min(axis=0)[: len(scene.own)]  # what is near an obstacle in any posture is mounted there
    for names, required, away in zip(scene.pairs, scene.required, own, strict=False):
        if required < scene.margin and away < scene.margin:
            least[names] = min(float(away), least.get(names, float(away)))
    if least:
        pairs = tuple(f"{a} and {b} ({Quantity(away, _STATED)})" for (a, b), away in least.items())
        said.append(state("collision.pairs-closer", pairs=pairs, margin=Quantity(scene.margin, _STATED)))
    return said


@dataclass(frozen=True)
class Gap:
    """The narrowest gap at a posture."""

    distance: float  # [m]; zero or less where the bodies overlap, but not how deep
    between: tuple[str, str]  # a joint and an obstacle
    start: Array  # (3,) point of the arm [m], world
    end: Array  # (3,) point of the obstacle [m], world


def narrowest(scene: Scene, q: Array) -> Gap | None:
    """Narrowest gap at a posture (n,) to a stated obstacle, of pairs that keep the whole clearance, if any."""
    stated = {obstacle.name for obstacle in scene.stated_obstacles}
    counts = [len(scene.own) <= k and other in stated for k, (_, other) in enumerate(scene.pairs)]
    kept = np.array(counts, dtype=bool) & (np.array(scene.required) >= scene.margin)
    if not kept.any():
        return None
    distances = np.where(kept, scene.distances(q)[0], np.inf)
    k = int(np.argmin(distances))
    others = [(i, obstacle) for obstacle, chosen in zip(scene.obstacles, scene.against, strict=True) for i in chosen]
    capsule, solid = others[k - len(scene.own)]
    start, end = (ends[0, capsule] for ends in scene.placed.segments(np.atleast_2d(q)))

    def away(points: Array) -> Array:
        return solid.distance(points, points)

    for _ in range(8):  # the distance is convex along the segment, of which (2 / 32)^8 is left
        points = np.linspace(start, end, 32 + 1)
        at = int(np.argmin(away(points)))
        start, end = points[max(at - 1, 0)], points[min(at + 1, 32)]
    on_axis, steps = np.asarray((start + end) / 2), 1e-6 * np.eye(3)
    slope = away(on_axis + steps) - away(on_axis - steps)
    outward = np.asarray(slope / 2e-6 / max(float(np.linalg.norm(slope / 2e-6)), 1e-12))  # zero inside
    surface = on_axis - scene.placed.radii[capsule] * outward
    return Gap(float(distances[k]), scene.pairs[k], surface, on_axis - float(away(on_axis)) * outward)
