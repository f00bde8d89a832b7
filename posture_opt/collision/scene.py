"""``Scene``: an arm with its shape and what is around it; how near they come to each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from posture_opt.collision.cell import CellSpec
from posture_opt.collision.contacts import Apart, Contacts
from posture_opt.collision.mounting import MOUNTING_PLANE, Mounting, below_base, carries
from posture_opt.collision.nearest import Clearance, Nearest
from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.pairs import (
    Checked,
    Pair,
    apart_pairs,
    checked_against,
    checked_own,
    moving_capsules,
    obstacle_distances,
    own_distances,
    random_postures,
)
from posture_opt.collision.placed_capsules import Placed, PlacedCapsules
from posture_opt.collision.smooth_bounds import segment_bound, soft_minimum
from posture_opt.numerics import Array
from posture_opt.robot.link_capsules import stand_in, tool_capsule, tool_radius
from posture_opt.robot.robot import Robot
from posture_opt.robot.shape import TOOL, Capsule
from posture_opt.statements import Statement, state

SELF_CLEARANCE_ROW = "clearance of the arm to itself"
"""Name of the row that keeps links apart."""
SEPARATION_M = 0.1
"""Distance beyond the margin [m]: pairs that keep so far apart need no row."""
_POSTURE_COUNT = 4000
"""Random postures by which pairs are found to keep apart."""
_BLOCK_PAIRS = 500
"""Pairs whose distances at all of them are held together: 16 MB."""
_FREE_END_RADII = 2.0
"""So many radii (and clearances) of the tool in front of its tool point are not checked: it touches its target there,
leaning up to 60 deg from a flat surface's normal."""
_ROW_TOLERANCE_M = 2e-6
"""Taken off each row [m]: more than a solver may leave of a row that counts as met."""
_SHORT_LINK_M = 0.01
"""Offset [m] of a link that its neighbours hide: corrections alone are shorter."""
_SURFACE_M = 1e-4
"""Depth [m] up to which a point is on the surface of a solid, and not inside of it."""


def row_name(obstacle: str) -> str:
    """Name of the row that keeps the arm away from an obstacle."""
    return f"clearance to {obstacle}"


class ClearanceRow(NamedTuple):
    """A smooth lower bound of the least distance of one group of pairs.

    Args:
        name: what it keeps apart.
        bound: scalar expression of the joint values [m].
    """

    name: str
    bound: ca.SX


@dataclass(frozen=True)
class Scene:
    """What is checked for collisions.

    Args:
        placed: the capsules of the arm.
        obstacles: in the world, the mounting plane last.
        margin: least distance to keep [m].
        own: pairs of capsules that are checked against each other.
        against: for each obstacle the capsules that are checked against it.
        required: (k,) least distance [m] of each pair in the order of `pairs`: the margin, or what it can have; below
            zero for an assumed tool, by its radius.
        left_out: names of the pairs that overlap whatever the posture, which are not checked.
        mounting: the surface that the arm stands on; None where there is none.
        assumed: whether the shape is not known, and capsules along the links are taken in its place.
        switched_off: whether the problem file asks for no checks (``cell: none``).
        stands_anywhere: whether neither shape nor file says what the arm stands on.
    """

    placed: PlacedCapsules
    obstacles: tuple[Obstacle, ...]
    margin: float
    own: tuple[Pair, ...]
    against: tuple[tuple[int, ...], ...]
    required: tuple[float, ...] = ()
    left_out: tuple[tuple[str, str], ...] = ()
    mounting: Mounting | None = None
    assumed: bool = False
    switched_off: bool = False
    stands_anywhere: bool = False

    @classmethod
    def of(cls, robot: Robot, cell: CellSpec | None, *, guessed: bool = False, without_mounting: bool = False) -> Scene:
        """Links of known shape are checked against each other, all obstacles and the surface that the arm stands on;
        those of unknown shape against obstacles and a surface that is stated.

        The tool is part of the arm, but for its end near the target, where it has to touch. Nothing is checked where
        the cell says so.

        Args:
            robot: with its shape, if it is known.
            cell: obstacles, mounting and clearance; None for none of them.
            guessed: for postures without a target, that no one sees before the arm goes there: an arm of unknown shape
                is checked against itself too, with capsules along its links, and the tool up to its end.
            without_mounting: whether an assumed mounting plane is dropped.
        """
        asked = CellSpec() if cell is None else cell
        if not asked.checked:
            return cls(PlacedCapsules(robot, ()), (), asked.clearance, (), (), switched_off=True)
        mounting = Mounting.of(robot, asked.mounting, asked.obstacles)
        if mounting is not None and mounting.assumed and without_mounting:
            mounting = replace(mounting, dropped=True)
        standing = mounting is not None and not mounting.dropped
        obstacles = (*asked.obstacles, *((mounting.plane(robot),) if mounting is not None and standing else ()))
        stand_ins = _stand_ins(robot) if obstacles or guessed else ()
        assumed = bool(stand_ins)
        free_end = 0.0 if guessed else _FREE_END_RADII * (tool_radius(robot) + asked.clearance)
        capsules = stand_ins + robot.shape
        stated = len(capsules)
        capsules += tool_capsule(robot, free_end) if capsules else ()
        placed = PlacedCapsules(robot, capsules)
        known = 0 if guessed else len(stand_ins)  # what stands in for a link overlaps its neighbours
        pairs = tuple(pair for pair in apart_pairs(placed) if min(pair) >= known)
        # The first link turns on what the arm stands on, so the mounting plane is none of its.
        exposed = [moving_capsules(placed, int(standing and k == len(asked.obstacles))) for k in range(len(obstacles))]
        # Of a tool whose radius nobody states, the axis alone must not pass through the arm.
        assumes = robot.tool_radius is None and not guessed
        unsure = np.array([c.radius * (assumes and k >= stated) for k, c in enumerate(capsules)])
        own = checked_own(placed, pairs, asked.clearance, unsure)
        others = [
            checked_against(
                placed, obstacle, chosen, asked.clearance, obstacle.name == MOUNTING_PLANE or carries(robot, obstacle)
            )
            for obstacle, chosen in zip(obstacles, exposed, strict=True)
        ]
        return cls(
            placed,
            obstacles,
            asked.clearance,
            tuple(pairs[k] for k in own.chosen),
            tuple(tuple(exposed[i][k] for k in other.chosen) for i, other in enumerate(others)),
            (*own.required, *(distance for other in others for distance in other.required)),
            _names_of_left_out(placed, pairs, own, obstacles, exposed, others),
            mounting,
            assumed,
            stands_anywhere=mounting is None and asked.mounting is None and not asked.obstacles,
        )

    @property
    def robot(self) -> Robot:
        """The arm whose capsules are placed."""
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
        """Whether anything is checked."""
        return bool(self.own) or any(self.against)

    @property
    def floor_height(self) -> float | None:
        """Height [m] of the mounting plane over the world's origin, where it is a level floor; else None."""
        plane = None if self.mounting is None or self.mounting.dropped else self.mounting.plane(self.robot)
        return plane.offset if plane is not None and plane.normal == (0.0, 0.0, 1.0) else None

    @cached_property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """(k,) the two names of everything that `distances` holds, column by column."""
        joints = [capsule.joint for capsule in self.placed.capsules]
        own = [(joints[i], joints[j]) for i, j in self.own]
        others = zip(self.obstacles, self.against, strict=True)
        return (*own, *((joints[k], obstacle.name) for obstacle, chosen in others for k in chosen))

    @cached_property
    def held(self) -> tuple[tuple[tuple[str, str], float], ...]:
        """Pairs that cannot have the margin: their names, and the distance [m] that they keep."""
        return tuple(
            (names, distance)
            for names, distance in zip(self.pairs, self.required, strict=True)
            if 0 <= distance < self.margin
        )

    @cached_property
    def unchecked(self) -> tuple[str, ...]:
        """Names of links without a shape: all, where nothing is checked at all."""
        if not self.placed.capsules:
            return self.robot.joint_names
        shaped = {capsule.joint for capsule in self.placed.capsules}
        empty = [
            joint.name
            for joint, link in zip(self.robot.joints, self.robot.links, strict=True)
            if joint.name not in shaped and any(f.kind == "translate" and abs(f.nominal) > _SHORT_LINK_M for f in link)
        ]
        return self.robot.unshaped or (() if self.assumed else tuple(empty))

    def distances(self, Q: Array) -> Array:
        """(N, k) exact distance of every pair at the postures Q (N, n) [m].

        Zero or less where they overlap, but not how deep.
        """
        start, end = self.placed.segments(np.atleast_2d(Q))
        parts = [own_distances(self.placed, start, end, self.own)] if self.own else []
        parts += [
            obstacle_distances(self.placed, obstacle, start, end, chosen)
            for obstacle, chosen in zip(self.obstacles, self.against, strict=True)
            if chosen
        ]
        return np.hstack([np.zeros((len(start), 0)), *parts])

    def least(self, Q: Array) -> Array:
        """(N,) least distance at each of the postures Q (N, n) [m]; infinite where nothing is checked."""
        return np.asarray(np.min(self.distances(Q), axis=1, initial=np.inf)) if self.active else np.full(len(Q), np.inf)

    def slack(self, Q: Array) -> Array:
        """(N,) by how much the nearest pair exceeds what it is to keep, at each of the postures Q (N, n) [m].

        Infinite where nothing is checked.
        """
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
        chosen = moving_capsules(self.placed, 1)
        plane = self.mounting.plane(self.robot)
        away = obstacle_distances(self.placed, plane, *self.placed.segments(np.atleast_2d(Q)), chosen)
        return self.mounting.statement(-float(np.min(away, initial=0.0)))

    def statements(self, Q: Array) -> tuple[Statement, ...]:
        """What the reader of the postures Q (N, n) [rad or m] must know before anyone drives there."""
        mounting, names = self.mounting_statement(Q), self.pierced(Q)
        pierced = [state("collision.tool-pierces", obstacles=names)] if names else []
        return (*([] if mounting is None else [mounting]), *pierced)

    def clearance(self, Q: Array) -> Clearance | None:
        """The least distances over the postures Q (N, n) or (n,), and between which; None where nothing is checked."""
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
        """The names of the obstacles that a point (3,) [m] is inside of, world; the mounting plane among them.

        That plane counts also where it was assumed and dropped, so that the arm reaches below it.
        """
        p = np.asarray(point, dtype=float)[None, None]
        dropped = self.mounting is not None and self.mounting.dropped
        solids = (*self.obstacles, *([self.mounting.plane(self.robot)] if self.mounting and dropped else []))
        return {o.name for o in solids if float(o.smaller(_SURFACE_M).distance(p, p)[0, 0]) <= 0}

    def pierced(self, Q: Array) -> tuple[str, ...]:
        """The obstacles that the end of the tool passes through at Q (N, n), its point not being inside of them.

        That end belongs to no capsule, as the tool has to touch with it: a hole is entered, but nothing in front of it.
        None of a tool whose shape is stated, which is checked as it is.
        """
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

    def closest(self, row: str, q: Array) -> tuple[tuple[str, str], float, float]:
        """Of the pairs that a row of `rows` is of, by its name, the one that lacks most of what it is to keep.

        Args:
            q: (n,) posture [rad or m].

        Returns:
            its names, its distance there and the distance that it is to keep [m].
        """
        mine = [
            k < len(self.own) if row == SELF_CLEARANCE_ROW else row_name(p[1]) == row for k, p in enumerate(self.pairs)
        ]
        distances = self.distances(q)[0]
        k = int(np.argmin(np.where(mine, distances - np.array(self.required), np.inf)))
        return self.pairs[k], float(distances[k]), self.required[k]

    def rows(self, q: ca.SX, obstacles: Sequence[Obstacle] | None = None) -> list[ClearanceRow]:
        """A lower bound of the least distance [m] to each obstacle, and of the arm to itself, at joint values ``q``
        (n,).

        Each is to be at least ``margin``. Where it is below that it is at most `smooth_bounds.BOUND_SLACK_M` below the
        true distance, and half of `smooth_bounds.SOFT_MINIMUM_WIDTH_M` for each doubling of pairs that are equally
        near. Pairs that thousands of random postures leave farther apart than the margin and `SEPARATION_M` have no
        part in it, and it never exceeds that.

        Args:
            q: (n,) joint values.
            obstacles: in place of those of the scene: the same ones, smaller or moved by symbols.
        """
        placed, near = self.placed.symbols(q), self._near_pairs
        lowered = dict(zip(self._keys, (self.margin - np.array(self.required)).tolist(), strict=True))
        found = []
        for obstacle, chosen in zip(obstacles or self.obstacles, self.against, strict=True):
            close = [k for k in chosen if near[k, obstacle.name]]
            bounds = [
                bound + lowered[k, obstacle.name]
                for k in close
                for bound in self._obstacle_bounds(placed[k], obstacle, k)
            ]
            if bounds:
                found.append(self._clearance_row(row_name(obstacle.name), bounds))
        own = [pair for pair in self.own if near[pair]]
        if own:
            bounds = [bound + lowered[pair] for pair, bound in zip(own, self._own_bounds(q, own), strict=True)]
            found.append(self._clearance_row(SELF_CLEARANCE_ROW, bounds))
        return found

    @cached_property
    def contacts(self) -> Contacts:
        """All pairs as rows of a search in C, with exact distances."""
        solids = tuple(part for obstacle in self.obstacles for part in obstacle.parts)
        first = np.cumsum([0, *(len(obstacle.parts) for obstacle in self.obstacles)]).tolist()
        others = [
            [(k, -1, solid) for solid in range(first[place], first[place + 1])]
            for place, chosen in enumerate(self.against)
            for k in chosen
        ]
        every = [*([(i, j, -1)] for i, j in self.own), *others]
        kept = zip(every, self.required, strict=True)
        pairs = (Apart(*pair, least + _ROW_TOLERANCE_M) for group, least in kept for pair in group)
        return Contacts(self.placed, solids, tuple(pairs), SEPARATION_M)

    def _obstacle_bounds(self, placed: Placed, obstacle: Obstacle, k: int) -> list[ca.SX]:
        """Lower bounds [m] of the distance of capsule k to an obstacle."""
        capsule = self.placed.capsules[k]
        return obstacle.bounds(*placed, capsule.length, capsule.radius)

    def _clearance_row(self, name: str, bounds: list[ca.SX]) -> ClearanceRow:
        """The soft minimum of bounds [m], bounded above by the margin and `SEPARATION_M`."""
        return ClearanceRow(name, soft_minimum([*bounds, ca.SX(self.margin + SEPARATION_M)]) - _ROW_TOLERANCE_M)

    @property
    def _keys(self) -> tuple[tuple[int, int | str], ...]:
        """(k,) the capsules, or capsule and obstacle, of everything that `distances` holds."""
        others = zip(self.obstacles, self.against, strict=True)
        return (*self.own, *((k, obstacle.name) for obstacle, chosen in others for k in chosen))

    @cached_property
    def _near_pairs(self) -> dict[tuple[int, int | str], bool]:
        """Which pairs random postures bring nearer than `SEPARATION_M`; of those that are held nearer than the margin,
        which they bring nearer than that.
        """
        blocks = np.array_split(random_postures(self.placed, _POSTURE_COUNT), 1 + len(self.pairs) // _BLOCK_PAIRS)
        least = np.min([self.distances(Q).min(axis=0) for Q in blocks], axis=0)
        required = np.array(self.required)
        far = np.where(required < self.margin, required, self.margin + SEPARATION_M)
        return dict(zip(self._keys, (least < far).tolist(), strict=True))

    def _own_bounds(self, q: ca.SX, pairs: Sequence[Pair]) -> list[ca.SX]:
        """For every pair, seen from the frame of the first one: only joints between them take part."""
        frames, capsules = self.placed.frames, self.placed.capsules
        seen = {frame: self.placed.symbols(q, frame) for frame in {frames[i] for i, _ in pairs}}
        bounds = []
        for i, j in pairs:
            first, other, placed = capsules[i], capsules[j], seen[frames[i]]
            radius = first.radius + other.radius
            bounds.append(segment_bound(*placed[i], first.length, *placed[j], other.length, radius))
        return bounds


def _stand_ins(robot: Robot) -> tuple[Capsule, ...]:
    """Capsules along the links whose shape is not known; none where all is known or was replaced on purpose."""
    shaped = {capsule.joint for capsule in robot.shape} & set(robot.joint_names)
    if not shaped:
        return stand_in(robot)
    return tuple(capsule for capsule in stand_in(robot) if capsule.joint in robot.bare_joints)


def _names_of_left_out(
    placed: PlacedCapsules,
    pairs: Sequence[Pair],
    own: Checked,
    obstacles: Sequence[Obstacle],
    exposed: Sequence[Sequence[int]],
    others: Sequence[Checked],
) -> tuple[tuple[str, str], ...]:
    """The two names of each pair that is left out, of the arm itself first; each once."""
    joints = [capsule.joint for capsule in placed.capsules]
    names = [(joints[i], joints[j]) for i, j in (pairs[k] for k in own.left_out)]
    for obstacle, chosen, other in zip(obstacles, exposed, others, strict=True):
        names += [(joints[chosen[k]], obstacle.name) for k in other.left_out]
    return tuple(dict.fromkeys(names))
