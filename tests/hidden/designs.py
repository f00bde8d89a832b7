"""What is measured: postures in random order, payloads, approach sides, clock and thermometer.

Sides are ±1 of each joint's last move. They are either stated in columns (the arm leaves the pose before and arrives
from a side that is drawn for every joint) or follow from the rows: side and travel of a joint are the sign and length
of its step from the row before. Nothing is known of the way to the first row: side and travel 0. Temperature is that
of the arm in °C and counts from 20 °C; time counts from the first row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.hidden.mechanics import Arm, Array, walk

REFERENCE = 20.0  # °C


@dataclass(frozen=True)
class Plan:
    """What a session is to be like."""

    rows: int = 150
    repeated: int = 10  # poses that are visited ``visits`` times
    visits: int = 3
    payloads: tuple[float, ...] = (0.0, 10.0)
    span: float = 0.0  # rad about a random posture; 0: the whole range
    sides: bool | None = None  # in columns, from the rows, or drawn
    logged: bool | None = None  # clock and thermometer; drawn where None
    heat: float = 5.0  # K, of the room's way up and down


@dataclass(frozen=True, eq=False)
class Session:
    """N rows in the order of measuring: commands (N, n) and everything that may act besides them."""

    q: Array
    pose: Array
    side: Array
    travel: Array
    payload: Array
    temperature: Array
    time: Array
    sides_stated: bool
    logged: bool
    payload_logged: bool

    def __len__(self) -> int:
        return len(self.q)

    def take(self, rows: Array) -> Session:
        parts = {k: getattr(self, k)[rows] for k in ("q", "pose", "side", "travel", "payload", "temperature", "time")}
        return replace(self, **parts)


def draw_session(rng: np.random.Generator, arm: Arm, plan: Plan, centre: Array | None = None) -> Session:
    """A session of the arm; ``centre`` (n,) of narrow ranges, so that a second session can keep it."""
    poses = plan.rows - plan.repeated * (plan.visits - 1)
    q = draw_postures(rng, arm, poses, plan.span, centre)
    order = _order(rng, poses, plan.repeated, plan.visits)
    load = rng.permutation(np.resize(np.array(plan.payloads), poses))
    stated = bool(rng.random() < 0.7) if plan.sides is None else plan.sides
    commands = q[order]
    step = np.diff(commands, axis=0, prepend=commands[:1])
    side, travel = np.sign(step), np.abs(step)
    if stated:
        side = rng.choice([-1.0, 1.0], (poses, arm.n))[order]
    logged = bool(rng.random() < 0.7) if plan.logged is None else plan.logged
    time = np.concatenate([[0.0], np.cumsum(rng.uniform(20.0, 40.0, len(order) - 1))])
    temperature = _weather(rng, time, plan.heat)
    asked = len(set(plan.payloads)) > 1 or plan.payloads[0] > 0
    return Session(commands, order, side, travel, load[order], temperature, time, stated, logged, asked)


def draw_postures(rng: np.random.Generator, arm: Arm, count: int, span: float, centre: Array | None = None) -> Array:
    """Random commands (count, n), the tool above the floor on which an arm of six or seven joints stands."""
    lower, upper = arm.lower * 0.97, arm.upper * 0.97
    lower = np.where(np.array(arm.prismatic), arm.lower, lower)
    if span:
        centre = draw_centre(rng, arm) if centre is None else centre
        width = np.where(np.array(arm.prismatic), arm.upper - arm.lower, span)
        lower, upper = np.maximum(lower, centre - width / 2), np.minimum(upper, centre + width / 2)
    kept = np.zeros((0, arm.n))
    while len(kept) < count:
        q = rng.uniform(lower, upper, (4 * count, arm.n))
        kept = np.concatenate([kept, q[above_floor(arm, q)]])
    return np.round(kept[:count], 9)


def draw_centre(rng: np.random.Generator, arm: Arm) -> Array:
    """A posture in the middle of the workspace, off the limits."""
    middle, half = (arm.lower + arm.upper) / 2, (arm.upper - arm.lower) / 2
    while True:
        centre = middle + rng.uniform(-0.6, 0.6, arm.n) * half
        around = centre + rng.uniform(-0.3, 0.3, (50, arm.n))
        if above_floor(arm, around).mean() > 0.8:
            return centre


def above_floor(arm: Arm, q: Array) -> Array:
    if arm.n < 6:
        return np.ones(len(q), bool)
    w = walk(arm, q)
    return (w.p - w.o_base)[:, 2] > 0.05


def _order(rng: np.random.Generator, poses: int, repeated: int, visits: int) -> Array:
    """Every pose once and the first ``repeated`` ``visits`` times, never twice in a row."""
    order = np.concatenate([np.arange(poses), np.repeat(np.arange(repeated), visits - 1)])
    while True:
        order = rng.permutation(order)
        if (np.diff(order) != 0).all():
            return order


def _weather(rng: np.random.Generator, time: Array, heat: float) -> Array:
    """The arm's temperature: a room that goes up and down several times, apart from the clock, and a little warming."""
    span = time[-1]
    periods = span / rng.uniform(1.5, 5.0, 3)
    phases = rng.uniform(0, 2 * np.pi, 3)
    room = np.sin(2 * np.pi * time[:, None] / periods + phases) @ rng.uniform(0.4, 1.0, 3)
    warm = rng.uniform(0.0, 1.0) * (1 - np.exp(-3 * time / span))
    return np.round(REFERENCE + rng.uniform(0, 4) + heat * (0.7 * room + 0.5 * warm), 2)
