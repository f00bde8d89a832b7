"""What the steps of a map search share: what may be done at a target, and the best of some postures there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.maps.map_candidate import MapCandidate
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.multistart import local_optima

NEAR_POSTURE_STEP = 0.3  # rad or m: postures nearer to each other than this mostly end at the same optimum


def out_of_plane(engine: Engine, target: TaskTarget) -> bool:
    """Whether a target lies outside of the plane, or line, that the tool point cannot leave."""
    return engine.optimisation_problem.reach.misses(target.lower, target.upper)


def freedom(engine: Engine, target: TaskTarget) -> int:
    """Degrees of freedom that a task at a point leaves, joints left out that change nothing; below zero where it is
    bound twice.
    """
    problem = engine.optimisation_problem
    held = int(problem.reach.directions.shape[1]) + (0 if target.tilt > 0 else problem.axis_rows)
    return engine.robot.n - held - len(problem.nlp.indifferent)


def best_among(engine: Engine, target: TaskTarget, Q: Array) -> MapCandidate:
    """The best local optimum that postures Q (M, n) [rad or m], which reach the target, lead to."""
    own = engine.screen(Q, target.parameters)[2][:, 0]
    scale = engine.scale_of(own)
    best = local_optima(engine, replace(target, scale=scale), Q)[0]
    return MapCandidate("feasible", best, scale) if best.feasible else MapCandidate("requirement not met", None, scale)


def better_of(engine: Engine, target: TaskTarget, first: MapCandidate, second: MapCandidate) -> MapCandidate:
    """Which of two candidates of one target is better; a tie goes to the first one.

    Their objectives have scales of their own: the second is evaluated again in that of the first.
    """
    if second.best is None or first.best is None:
        return second if first.best is None and second.status != "not reached" else first
    same = engine.candidates(second.best.q[None], replace(target, scale=first.scale))[0]
    return (
        MapCandidate("feasible", replace(second.best, objective=same.objective), first.scale)
        if (same.objective < first.best.objective)
        else first
    )


def is_near(engine: Engine, q: Array, known: Sequence[Array]) -> bool:
    """Whether one of some postures (n,) is the same but for less than 0.3 rad (or m) in every joint that matters.

    Whole turns make no difference.
    """
    if not len(known):
        return False
    away = np.abs(np.array(known) - q)
    revolute = np.array([joint.type == "revolute" for joint in engine.robot.joints])
    away = np.where(revolute, np.minimum(away % (2 * np.pi), 2 * np.pi - away % (2 * np.pi)), away)
    away[:, list(engine.optimisation_problem.nlp.indifferent)] = 0.0
    return bool(np.min(np.max(away, axis=1)) < NEAR_POSTURE_STEP)
