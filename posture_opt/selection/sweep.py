"""Evidence of globality: a systematic sweep of the freedom that is left, beside the random starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.selection.engine import CandidatePosture, Engine
from posture_opt.selection.feasible import ROW_TOLERANCE, TOLERANCE, Wish
from posture_opt.selection.goal import Goal

Floats = np.ndarray
_SPINS = 120
_SEEDS = 8
_GRID = 91


@dataclass(frozen=True)
class Sweep:
    """What was swept, in how many points, how many of them were feasible, and the best of them."""

    over: str
    points: int
    feasible: int
    best: CandidatePosture


def sweep(engine: Engine, goal: Goal, rng: np.random.Generator) -> Sweep | None:
    """The sweep that the problem allows: over both joint angles, or over the spin of the tool; else None."""
    robot, programme = engine.programme.robot, engine.programme
    if robot.n <= 2 and goal.kind != "point":
        axes = [np.linspace(low, high, _GRID) for low, high in zip(robot.lower, robot.upper, strict=True)]
        Q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, robot.n)
        return _evaluate(engine, goal, Q, f"a grid of {_GRID} values of each joint")
    fixed = programme.reach.directions.shape[1] + programme.axis_rows
    if goal.kind == "point" and goal.tilt == 0 and programme.axis_rows == 2 and robot.n == fixed + 1:
        return _evaluate(engine, goal, _spun(engine, goal, rng), f"the spin of the tool in {_SPINS} steps")
    return None


def _spun(engine: Engine, goal: Goal, rng: np.random.Generator) -> Floats:
    """Postures that reach the goal with the tool's spin held at each of many angles, every branch sought anew."""
    angles = np.repeat(np.arange(_SPINS) * 2 * np.pi / _SPINS, _SEEDS)
    spin = np.cos(angles)[:, None] * goal.basis[:, 0] + np.sin(angles)[:, None] * goal.basis[:, 1]
    wish = Wish(goal.lower, goal.direction, spin, np.ones(3))
    Q, errors = engine.ik.solve(engine.ik.random_postures(len(angles), rng), wish)
    return Q[errors < TOLERANCE]


def _evaluate(engine: Engine, goal: Goal, Q: Floats, over: str) -> Sweep | None:
    if not len(Q):
        return None
    objective, violation = (column[:, 0] for column in engine.screen(Q, goal.parameters())[:2])
    feasible = violation <= ROW_TOLERANCE
    if not np.any(feasible):
        return None
    k = int(np.argmin(np.where(feasible, objective, np.inf)))
    best = engine.candidates(Q[k : k + 1], goal)[0]
    return Sweep(over, len(Q), int(np.count_nonzero(feasible)), best)
