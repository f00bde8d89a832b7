"""``MeasurementPlan``: which postures to measure next, and what they are expected to tell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.candidate_postures import Room, length
from posture_opt.diagnosis.exchange import Criterion, Progress, exchange, inverse
from posture_opt.diagnosis.measurements import Measurements
from posture_opt.diagnosis.nominal import nominal_poses
from posture_opt.diagnosis.parameters import CalibrationProblem, Parameter
from posture_opt.diagnosis.plan_information import Given, Instrument, given_knowledge, instrument, nothing_given
from posture_opt.diagnosis.plan_stages import Beforehand, Stage, Unknowns
from posture_opt.diagnosis.travel import Tour, tour
from posture_opt.errors import InputError, InsufficientDataError, Issue
from posture_opt.robot.robot import Robot

Array = NDArray[np.float64]
Codes = NDArray[np.intp]
Purpose = Literal["parameters", "task"]

_DRAWS = 21  # random plans of the same size that the chosen one is compared with
_STARTS = 4  # of the exchange; fewer for large plans, where one ends as well as another
_STARTED = 240  # postures in all starts together
_NEW, _MOST_NEW = 24, 3000  # postures tried near each chosen one, and near all, in each round
_SHOWN = 1500  # random postures that are kept to be drawn
# Two postures differ by this in at least one joint [rad, m]: what the model cannot express differs from place to place.
_APART = {"revolute": np.radians(20.0), "prismatic": 0.05}
_NEAR = (0.3, 0.1, 0.03)  # of the joints' ranges: how near, round by round


@dataclass(frozen=True, eq=False)
class Target:
    """The posture whose tool point a plan serves, and the directions (t, 3) along which its error counts."""

    q: Array
    basis: Array
    within: str


@dataclass(frozen=True, eq=False)
class MeasurementPlan:
    """Postures to measure, in the order of their visit, and what is expected of them.

    Args:
        q: (count, n) the postures [rad, m], rounded to 0.01 deg and 0.01 mm.
        points: (count, 3) where the nominal tool point comes to lie, world [m].
        purpose: ``parameters`` or ``task``.
        parameters: the (k,) unknowns; ``settled`` (k,) which of them measurements with this instrument can determine.
        words: what no measurement can tell, a sentence each.
        before, after, random: what is known without the plan, with it, and with random postures (medians).
        gain: the criterion's standard error with as many random postures, over that with the chosen ones.
        equivalent: so many random postures do what the chosen ones do; ``None`` where none of the tried sizes does.
        reach: (m, 3) nominal tool points of random postures that are allowed, world [m].
        tried: the largest number of random postures that was tried.
        target: the task's posture, or ``None``.
        tour: travel, blocked legs and approach sides.
        room: where the arm may go; ``share`` of the random postures that are allowed.
        given: the measurements made already, or ``None``; ``spread`` is what a fit to them leaves, in units of the
            instrument's σ.
        sigma: the instrument's, of a coordinate [m]; ``sigma_rotation`` [rad], 0 where orientations are not measured.
        targets: the points on the tool that are measured at each posture; empty for one.
        notes: sentences for the report.
    """

    robot: Robot
    q: Array
    points: Array
    purpose: Purpose
    parameters: tuple[Parameter, ...]
    settled: NDArray[np.bool_]
    words: tuple[str, ...]
    before: Stage
    after: Stage
    random: Stage
    gain: float
    equivalent: int | None
    tried: int
    target: Target | None
    tour: Tour
    room: Room
    share: float
    reach: Array
    given: Measurements | None
    spread: float
    sigma: float
    sigma_rotation: float
    axes: tuple[str, ...]
    targets: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def postures(self) -> list[dict[str, float]]:
        """Joint name -> value [rad, m], in the order of the visit."""
        return [dict(zip(self.robot.joint_names, map(float, row), strict=True)) for row in self.q]

    def to_json(self) -> dict[str, Any]:
        """The document ``plan.json``: SI units and radians."""
        stages = {"before": self.before, "after": self.after, "random": self.random}
        return {
            "purpose": self.purpose,
            "count": len(self.q),
            "given": len(self.given) if self.given is not None else 0,
            "postures": [
                {"posture": posture, "tool": [float(v) for v in point]}
                for posture, point in zip(self.postures, self.points, strict=True)
            ],
            "gain": self.gain,
            "random_equivalent": self.equivalent,
            "parameters": [
                {"name": p.name, "unit": p.unit, **{name: _number(stage.std[i]) for name, stage in stages.items()}}
                for i, p in enumerate(self.parameters)
            ],
            "observability": {name: dict(stage.observability) for name, stage in stages.items()},
            "task": self._task(stages),
            "undetermined": list(self.words),
            "travel": self.tour.travel,
            "blocked": [k + 1 for k in self.tour.blocked],
            "notes": list(self.notes),
        }

    def _task(self, stages: dict[str, Stage]) -> dict[str, Any] | None:
        if self.target is None:
            return None
        posture = dict(zip(self.robot.joint_names, map(float, self.target.q), strict=True))
        return {"posture": posture, "std": {name: _number(stage.task) for name, stage in stages.items()}}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def plan(
    problem: CalibrationProblem, room: Room, count: int, *, given: Measurements | None, purpose: Purpose,
    target: Target | None, seed: int, candidates: int, notes: tuple[str, ...] = (), progress: Progress | None = None,
) -> MeasurementPlan:  # fmt: skip
    """The ``count`` postures in ``room`` that tell most, by exchange among random candidates and postures near them.

    Raises:
        InputError: fewer postures than a calibration needs.
        InsufficientDataError: no parameter can be determined by this instrument.
    """
    rng = np.random.default_rng(seed)
    measuring, assumed = instrument(problem, given)
    known = _given(problem, given, measuring)
    pool, share = room.postures(max(candidates, 2 * count), rng)
    rows = np.zeros((0, len(known.x))) if target is None else measuring.tool_rows(target.q, known.x, target.basis)
    J = measuring.blocks(pool, known.x)
    unknowns = Unknowns.of(Beforehand.of(problem, measuring.parameters), J, known, rows, count)
    _check(unknowns, measuring, count)
    criterion = unknowns.criterion(purpose)
    search = _Search(measuring, unknowns, criterion, room, known.x)
    q, chosen = search.best(pool, J, count, seed, progress)
    way = tour(q, _unit_travel(room), room.allowed)
    q, chosen = q[way.order], chosen[way.order]
    random = [rng.permutation(len(pool)) for _ in range(_DRAWS)]
    equal, gain = search.compared(J, chosen, random)
    return MeasurementPlan(
        robot=problem.robot, q=q, points=nominal_poses(problem.robot, q)[0], purpose=purpose,
        parameters=measuring.parameters, settled=unknowns.settled, words=unknowns.known.words,
        before=_before(unknowns.stage(J[:0]), given), after=unknowns.stage(chosen),
        random=Stage.median([unknowns.stage(J[drawn[:count]]) for drawn in random]), gain=gain, equivalent=equal,
        tried=len(pool), target=target, tour=way, room=room, share=share,
        reach=nominal_poses(problem.robot, pool[:_SHOWN])[0], given=given,
        spread=float(np.sqrt(known.variance)), sigma=measuring.residuals.sigma,
        sigma_rotation=measuring.residuals.sigma_rotation,
        axes=tuple("xyz"[i] for i in measuring.residuals.axes), targets=measuring.targets,
        notes=tuple(dict.fromkeys((*assumed, *known.notes, *notes))),
    )  # fmt: skip


def _before(stage: Stage, given: Measurements | None) -> Stage:
    """Where nothing was measured the task's error is that of parts as they are drawn, which is no knowledge."""
    return stage if given is not None else replace(stage, task=float("nan"))


def _given(problem: CalibrationProblem, data: Measurements | None, measuring: Instrument) -> Given:
    if data is None:
        return nothing_given(len(measuring.parameters))
    return given_knowledge(problem, data, measuring.parameters)


def _check(unknowns: Unknowns, measuring: Instrument, count: int) -> None:
    """Refuse where nothing can be told, and where the postures are too few for a calibration of all that can."""
    if not unknowns.settled.any() or not unknowns.count:
        said = "; ".join(unknowns.known.words[:3])
        raise InsufficientDataError(f"no parameter can be determined by measuring positions: {said}")
    short = unknowns.count + 1 - unknowns.given.coordinates
    least = max(int(np.ceil(short / measuring.coordinates)), 1)
    if count < least:
        message = f"{count} {'posture is' if count == 1 else 'postures are'} too few for {unknowns.count} unknowns"
        raise InputError(Issue(message, ("--count",), count, f"plan at least {least}, better twice as many"))


def _unit_travel(room: Room) -> Array:
    """Joint travel that counts as one radian: of a slide the length of the arm."""
    size = max(length(room.robot), 1e-3)
    return np.array([1.0 if joint.type == "revolute" else size for joint in room.robot.joints])


@dataclass(frozen=True, eq=False)
class _Search:
    """The choice of postures under one criterion."""

    measuring: Instrument
    unknowns: Unknowns
    criterion: Criterion
    room: Room
    x: Array

    def best(self, pool: Array, J: Array, count: int, seed: int, progress: Progress | None) -> tuple[Array, Array]:
        """The best postures (count, n) and their derivatives: first of the pool, then also of others near them."""
        apart = self._apart(count)
        starts = max(1, min(_STARTS, _STARTED // count))
        start, total = self.unknowns.start, starts + len(_NEAR)
        tell: Callable[[int, int], None] = lambda done, of: progress(done, total) if progress else None  # noqa: E731
        found = exchange(
            self.unknowns.blocks(J),
            start,
            self.criterion,
            count,
            starts=starts,
            seed=seed,
            places=pool / apart,
            progress=tell,
        )
        q, chosen = pool[found.chosen], J[found.chosen]
        rng = np.random.default_rng(seed)
        for k, near in enumerate(_NEAR):
            others = self._near(q, near, rng)
            more = self.measuring.blocks(others, self.x)
            both, moves = np.concatenate([chosen, more]), np.concatenate([q, others])
            found = exchange(
                self.unknowns.blocks(both), start, self.criterion, count, former=np.arange(count), places=moves / apart
            )
            q, chosen = moves[found.chosen], both[found.chosen]
            tell(starts + k + 1, total)
        return q, chosen

    def _apart(self, count: int) -> Array:
        """(n,) two postures differ by more than this in at least one joint: a plan is no row of repeats."""
        room, n = self.room.upper - self.room.lower, self.room.robot.n
        stated = np.array([_APART[joint.type] for joint in self.room.robot.joints])
        return np.asarray(np.maximum(np.minimum(stated, room / (4 * count ** (1 / n))), 1e-9))

    def _near(self, q: Array, near: float, rng: np.random.Generator) -> Array:
        step = near * (self.room.upper - self.room.lower)
        tried = np.repeat(q, max(1, min(_NEW, _MOST_NEW // len(q))), axis=0)
        tried = self.room.rounded(tried + step * rng.normal(size=tried.shape))
        return np.asarray(tried[self.room.allowed(tried)])

    def value(self, J: Array) -> float:
        """The criterion of a plan; infinite where it leaves something open."""
        unknowns, flat = self.unknowns, self.unknowns.blocks(J).reshape(-1, self.unknowns.count)
        M = unknowns.T.T @ (unknowns.start + flat.T @ flat) @ unknowns.T
        values = np.linalg.eigvalsh(M)
        return self.criterion.transformed(unknowns.T).value(inverse(M)) if values[0] > 1e-10 else np.inf

    def compared(self, J: Array, chosen: Array, random: list[Codes]) -> tuple[int | None, float]:
        """How many random postures do the same (median), and how much larger the standard error of as many is."""
        best = self.value(chosen)
        sizes = [self._enough(J, drawn, best) for drawn in random]
        middle = float(np.median(sizes))
        same = float(np.median([self.value(J[drawn[: len(chosen)]]) for drawn in random]))
        logs = self.criterion.logarithmic
        gain = np.exp((same - best) / (2 * self.unknowns.count)) if logs else np.sqrt(same / best)
        return (round(middle) if np.isfinite(middle) else None), float(gain)

    def _enough(self, J: Array, drawn: Codes, best: float) -> float:
        """The least number of the first ``drawn`` postures that is as good as ``best``; infinite where all are not."""
        low, high = 0, len(drawn)
        if self.value(J[drawn]) > best:
            return np.inf
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.value(J[drawn[:middle]]) <= best else (middle, high)
        return float(high)
