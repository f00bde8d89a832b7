"""What would help: by how much the spread falls with a smaller σ, with a calibrated arm, or with the part elsewhere.

Smaller errors are judged in the postures of the answer: a new search could only gain more. A part that is moved has new
postures, found by local searches from those of the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from posture_opt.numerics import Array, Json, round_below
from posture_opt.selection.answer.expected_calibration import Calibrating, after_calibration
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import Reach, TaskTarget
from posture_opt.selection.search.engine import STEPS, Engine
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.uncertainty.regions.critical import Critical
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.sources.workpiece import stated_name
from posture_opt.uncertainty.spread.budget import Share

MIN_GAIN = 0.005
"""A smaller relative gain is none."""
_MIN_VARIANCE_SHARE = 0.01  # of the variance: sources with a smaller share are not asked about
_MAX_SOURCES = 8  # of them
_SHIFT_SHARE = 0.05  # of the size of the workspace: how far the part is moved, rounded down to 1, 2 or 5
_SHIFT_DIRECTIONS = 8  # directions across that of the task
_MAX_START_ALTERNATIVES = 4  # other postures that the moved part is tried with


@dataclass(frozen=True)
class Improvement:
    """One change that would help.

    Args:
        change: what changes: an error, the knowledge of the arm, or the place of the part.
        sigma_max: [m] that it would leave; ``gain`` is ``1 − after/before``.
    """

    change: ClassVar[str]
    sigma_max: float
    gain: float

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI."""
        return {"change": self.change, **vars(self)}


@dataclass(frozen=True)
class HalvedSigma(Improvement):
    """One stated standard deviation [rad or m] halved, the correlations kept.

    Args:
        parameter: its name; ``sigma`` the value as it is stated.
    """

    change = "halve_sigma"
    parameter: str
    sigma: float


@dataclass(frozen=True)
class CalibratedArm(Improvement):
    """Errors that stay from repeat to repeat known as well as ``postures`` measured points determine them.

    Args:
        instrument: standard deviation of each coordinate of a measured point [m]; ``assumed`` where the file has none.
    """

    change = "calibrate"
    postures: int
    instrument: float
    assumed: bool


@dataclass(frozen=True)
class MovedPart(Improvement):
    """The part shifted by ``shift`` [m], world."""

    change = "move_part"
    shift: tuple[float, float, float]


class AnsweredStation(Protocol):
    """What is asked of one posture of an answer, a ``Solution``."""

    @property
    def problem(self) -> ProblemData: ...
    @property
    def critical(self) -> Critical: ...
    @property
    def budget(self) -> tuple[Share, ...]: ...
    def sigma_under(self, sources: Sources) -> float:
        """σ_max [m] in the same posture under other errors."""


class MovableAnswer(Protocol):
    """What is asked of an answer whose target may stand elsewhere, a ``Solution``."""

    @property
    def problem(self) -> ProblemData: ...
    @property
    def optimisation_problem(self) -> OptimisationProblem: ...
    @property
    def target(self) -> TaskTarget: ...
    @property
    def engine(self) -> Engine | None: ...
    @property
    def q(self) -> Array: ...
    @property
    def alternatives(self) -> Sequence[Any]: ...
    def sigma_at(self, target: TaskTarget, q: Array) -> float:
        """σ_max [m] at another target in the posture (n,)."""


def improvements(
    stations: Sequence[AnsweredStation], combined: Callable[[Array], Any], place: MovableAnswer | None = None
) -> tuple[Improvement, ...]:
    """What would lower the standard deviation of an answer with a posture at each of K stations, most gain first.

    Args:
        combined: of (K,) standard deviations [m], the figure of merit of the answer.
        place: the answer, where its part could also stand elsewhere.
    """
    before = float(combined(np.array([station.critical.sigma_max for station in stations])))
    if not before > 0:
        return ()
    problem = stations[0].problem

    def gain(sigma: float) -> tuple[float, float]:
        """What is left of the standard deviation [m], and the relative gain."""
        return sigma, 1.0 - sigma / before

    def under(sources: Sources) -> tuple[float, float]:
        """The same under other errors, in the postures of the answer."""
        return gain(float(combined(np.array([station.sigma_under(sources) for station in stations]))))

    found: list[Improvement] = [
        HalvedSigma(*under(_halved(problem.task_sources, name)), name, sigma)
        for name, sigma in _weighty(stations, problem.task_sources)
    ]
    known = after_calibration(problem, Calibrating.of(problem))
    if known is not None:
        left = known.sources.plus(problem.workpiece_sources)
        found.append(CalibratedArm(*under(left), known.postures, known.instrument, known.assumed))
    moved = None if place is None else _moved(place, before)
    if moved is not None:
        found.append(MovedPart(*gain(moved[0]), moved[1]))
    return tuple(sorted(found, key=lambda change: -change.gain))


def _weighty(stations: Sequence[AnsweredStation], sources: Sources) -> list[tuple[str, float]]:
    """Name and σ of the sources with the largest shares in the variance of any station.

    Only these are tried: halving a source of share s reduces σ by ``1 − sqrt(1 − 3 s/4)`` where nothing correlates.
    """
    shares: dict[str, float] = {}
    for station in stations:
        for share in station.budget:
            shares[share.parameter] = max(shares.get(share.parameter, 0.0), share.share)
    sigma = dict(zip(map(stated_name, sources.names), map(float, sources.sigma), strict=True))
    ranked = sorted(
        (name for name in shares if shares[name] >= _MIN_VARIANCE_SHARE and name in sigma), key=lambda n: -shares[n]
    )
    return [(name, sigma[name]) for name in ranked[:_MAX_SOURCES]]


def _halved(sources: Sources, name: str) -> Sources:
    """The same sources with one standard deviation, as the file states it, halved, its correlations kept."""
    scale = np.where([stated_name(one) == name for one in sources.names], 0.5, 1.0)
    both = np.outer(scale, scale)
    return Sources(sources.names, sources.covariance * both, sources.notes, sources.scatter * both)


def _moved(place: MovableAnswer, before: float) -> tuple[float, tuple[float, float, float]] | None:
    """The least σ_max [m] with the part a short way off, and the way; None where the place was free, or none is better.

    All places are tried in one batch of local searches, from the posture of the answer and from its alternatives.
    """
    target, problem = place.target, place.optimisation_problem
    if target.kind != "point":
        return None
    targets = [target.with_position(target.lower + shift) for shift in _shifts(target, problem.reach)]
    engine = place.engine or Engine(problem, place.problem.solver, compiled=False)
    known = [
        place.q,
        *(np.array(list(a.posture.values())) for a in place.alternatives[1 : 1 + _MAX_START_ALTERNATIVES]),
    ]
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
    length, within = round_below(_SHIFT_SHARE * reach.radius), reach.directions @ reach.directions.T
    axes = [axis for axis in (*target.basis.T, target.direction) if np.linalg.norm(within @ axis) > 0.5]
    angles = 2 * np.pi * np.arange(_SHIFT_DIRECTIONS) / _SHIFT_DIRECTIONS
    around = np.round(np.column_stack([np.cos(angles), np.sin(angles)]), 15)  # a quarter turn leaves no 1e-17
    ways = [w @ np.array(axes[:2]) for w in around] if len(axes) > 1 else [axes[0], -axes[0]]
    ways += [sign * axis for axis in axes[2:] for sign in (1.0, -1.0)]
    return [length * way for way in ways]
