"""What would help: by how much the spread falls with a smaller σ, with a calibrated arm, or with the part elsewhere.

Smaller errors are judged in the postures of the answer: a new search could only gain more. A part that is moved has new
postures, found by local searches from those of the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from posture_opt.numerics import Array, Json, round_below
from posture_opt.robot.posture import drawn_between
from posture_opt.selection.answer.target_answer import TargetAnswer
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.task_target import Reach, TaskTarget
from posture_opt.selection.search.engine import STEPS, Engine
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.uncertainty.sources import Sources, stated_name

MIN_GAIN = 0.005  # a smaller relative gain is none


@dataclass(frozen=True)
class Improvement:
    change: ClassVar[str]  # what changes: an error, the knowledge of the arm, or the place of the part
    sigma_max: float  # [m] that it would leave
    gain: float  # 1 − after/before

    def to_json(self) -> dict[str, Json]:
        return {"change": self.change, **vars(self)}


@dataclass(frozen=True)
class HalvedSigma(Improvement):
    """One stated standard deviation halved, the correlations kept."""

    change = "halve_sigma"
    parameter: str
    sigma: float  # as stated [rad or m]


@dataclass(frozen=True)
class CalibratedArm(Improvement):
    """Errors that stay known as well as ``postures`` measured points determine them."""

    change = "calibrate"
    postures: int
    instrument: float  # standard deviation of a measured coordinate [m]
    assumed: bool  # the file states no instrument


@dataclass(frozen=True)
class MovedPart(Improvement):
    """The part shifted by ``shift`` [m], world."""

    change = "move_part"
    shift: tuple[float, float, float]


def improvements(
    stations: Sequence[TargetAnswer], combined: Callable[[Array], Any], place: TargetAnswer | None = None
) -> tuple[Improvement, ...]:
    """Changes that lower ``combined`` of the K stations' standard deviations (K,) [m], most gain first."""
    before = float(combined(np.array([station.sigma_max for station in stations])))
    if not before > 0:
        return ()
    problem = stations[0].problem

    def gain(sigma: float) -> tuple[float, float]:
        return sigma, 1.0 - sigma / before

    def under(sources: Sources) -> tuple[float, float]:
        return gain(float(combined(np.array([station.sigma_under(sources) for station in stations]))))

    found: list[Improvement] = [
        HalvedSigma(*under(_halved(problem.task_sources, name)), name, sigma)
        for name, sigma in _weighty(stations, problem.task_sources)
    ]
    # 30 postures, as many as ISO 9283 takes repeats; 0.05 mm: a laser tracker.
    stated = 0.0 if problem.measurement is None else problem.measurement.position
    postures, instrument = 30, stated or 0.05e-3
    known = after_calibration(problem, postures, instrument)
    if known is not None:
        left = under(known.plus(problem.workpiece_sources))
        found.append(CalibratedArm(*left, postures, instrument, assumed=not stated))
    moved = None if place is None else _moved(place, before)
    if moved is not None:
        found.append(MovedPart(*gain(moved[0]), moved[1]))
    return tuple(sorted(found, key=lambda change: -change.gain))


def _weighty(stations: Sequence[TargetAnswer], sources: Sources) -> list[tuple[str, float]]:
    """Sources to try: halving one of variance share s lowers σ by ``1 − sqrt(1 − 3 s/4)`` without correlations."""
    every = sorted((share for station in stations for share in station.budget), key=lambda share: share.share)
    shares = {share.parameter: share.share for share in every}
    sigma = dict(zip(map(stated_name, sources.names), map(float, sources.sigma), strict=True))
    ranked = sorted((name for name in shares if shares[name] >= 0.01 and name in sigma), key=lambda n: -shares[n])
    return [(name, sigma[name]) for name in ranked[:8]]


def _halved(sources: Sources, name: str) -> Sources:
    scale = np.where([stated_name(one) == name for one in sources.names], 0.5, 1.0)
    both = np.outer(scale, scale)
    return Sources(sources.names, sources.covariance * both, sources.notes, sources.scatter * both)


def _moved(place: TargetAnswer, before: float) -> tuple[float, tuple[float, float, float]] | None:
    """Least σ_max [m] with the part a short way off, and that way; one batch of local searches for all places."""
    target, problem = place.target, place.optimisation_problem
    if target.kind != "point":
        return None
    targets = [target.with_position(target.lower + shift) for shift in _shifts(target, problem.reach)]
    engine = place.engine or Engine(problem, place.problem.solver, compiled=False)
    known = [place.q, *(np.array(list(a.posture.values())) for a in place.alternatives[1:5])]
    of = np.repeat(np.arange(len(targets)), len(known))
    ends = engine.descended_each(np.tile(np.array(known), (len(targets), 1)), targets, of, STEPS)
    parameters = np.array([aim.parameters for aim in targets])[of]
    candidates = zip(engine.screened(ends.q, parameters), is_clear(place.problem.scene, ends.q), of, strict=True)
    left = [(c.sigma, k, c.q) for c, clear, k in candidates if clear and c.feasible and c.sigma < before]
    if not left:
        return None
    _, k, q = min(left, key=lambda end: end[:2])
    x, y, z = map(float, targets[k].lower - target.lower)
    return place.sigma_at(targets[k], q), (x, y, z)


def _shifts(target: TaskTarget, reach: Reach) -> list[Array]:
    """Short shifts (3,) [m] across the direction of the task and along it; of a planar arm within its plane."""
    # 5 % of the workspace, rounded down to 1, 2 or 5
    length, within = round_below(0.05 * reach.radius), reach.directions @ reach.directions.T
    axes = [axis for axis in (*target.basis.T, target.direction) if np.linalg.norm(within @ axis) > 0.5]
    angles = 2 * np.pi * np.arange(8) / 8
    around = np.round(np.column_stack([np.cos(angles), np.sin(angles)]), 15)  # a quarter turn leaves no 1e-17
    ways = [w @ np.array(axes[:2]) for w in around] if len(axes) > 1 else [axes[0], -axes[0]]
    ways += [sign * axis for axis in axes[2:] for sign in (1.0, -1.0)]
    return [length * way for way in ways]


def after_calibration(problem: ProblemData, count: int, instrument: float) -> Sources | None:
    """Sources after ``count`` measured points, ``Σ ← Σ − ΣJᵀ(JΣJᵀ + R)⁻¹JΣ``; None where no error stays.

    J (3, k) is the sensitivity of the tool point, ``R = s²I + J S Jᵀ`` of instrument [m] and scatter: linear least
    squares with the stated σ's as priors (Bar-Shalom, Li and Kirubarajan 2001, section 3.2).
    """
    sources = problem.sources
    remaining = sources.constant
    if not np.any(np.diag(remaining) > 0):
        return None
    # Random postures within the limits, clear of collisions where enough of them are.
    drawn = np.random.default_rng(0).uniform(*drawn_between(problem.robot), (10 * count, problem.robot.n))
    clear = drawn[is_clear(problem.scene, drawn)] if problem.scene.active else drawn
    for q in (clear if len(clear) >= count else drawn)[:count].tolist():
        twists = problem.arm.twists(sources.names, q, problem.arm.reach(q).walk)
        J = np.array([shift for shift, _ in twists], dtype=float).T
        noise = instrument**2 * np.eye(3) + J @ sources.scatter @ J.T
        gain = np.linalg.solve(J @ remaining @ J.T + noise, J @ remaining)
        remaining = remaining - remaining @ J.T @ gain
        remaining = (remaining + remaining.T) / 2
    return Sources(sources.names, remaining + sources.scatter, sources.notes, sources.scatter)
