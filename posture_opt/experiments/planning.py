"""From a problem and the room of its arm to a plan of measurements."""

from __future__ import annotations

import numpy as np

from posture_opt.calibration.parameters import CalibrationProblem
from posture_opt.errors import InputError, InsufficientDataError, Issue
from posture_opt.experiments.candidate_postures import Room, length
from posture_opt.experiments.information import (
    Given,
    Instrument,
    given_knowledge,
    instrument,
    nothing_given,
    visit_variance,
)
from posture_opt.experiments.knowledge_stages import Beforehand, Stage, Unknowns
from posture_opt.experiments.measurement_plan import MeasurementPlan, Purpose, Target
from posture_opt.experiments.plan_search import Search
from posture_opt.experiments.visiting_order import tour
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.nominal_points import nominal_poses
from posture_opt.numerics import Array, Progress

_DRAWS = 21  # random plans of the same size that the chosen one is compared with
_SHOWN = 1500  # random postures that are kept to be drawn


def plan(
    problem: CalibrationProblem, room: Room, count: int, *, given: Measurements | None, purpose: Purpose,
    target: Target | None, seed: int, candidates: int, repeats: int = 1, notes: tuple[str, ...] = (),
    progress: Progress | None = None,
) -> MeasurementPlan:  # fmt: skip
    """The ``count`` postures in ``room`` that tell most, by exchange among random candidates and postures near them.

    Raises:
        InputError: fewer postures than a calibration needs.
        InsufficientDataError: no parameter can be determined by this instrument.
        NoSolutionError: hardly any posture is allowed.
    """
    rng = np.random.default_rng(seed)
    measuring, assumed = instrument(problem, given, repeats)
    pool, share = room.postures(max(candidates, 2 * count), rng)
    known = _given(problem, given, measuring, visit_variance(problem, measuring.residuals.sigma, pool))
    rows = np.zeros((0, len(known.x))) if target is None else measuring.tool_rows(target.q, known.x, target.basis)
    J = measuring.blocks(pool, known.x)
    unknowns = Unknowns.of(Beforehand.of(problem, measuring.parameters), J, known, rows, count)
    _check(unknowns, measuring, count)
    search = Search(measuring, unknowns, unknowns.criterion(purpose), room, known.x)
    q, chosen = search.best(pool, J, count, seed, progress)
    way = tour(q, _unit_travel(room), room.allowed)
    q, chosen = q[way.order], chosen[way.order]
    random = [J[rng.permutation(len(pool))] for _ in range(_DRAWS)]
    equivalent, gain = search.compared(chosen, random)
    residuals = measuring.residuals
    return MeasurementPlan(
        robot=problem.robot, q=q, points=nominal_poses(problem.robot, q)[0], repeats=repeats, purpose=purpose,
        parameters=measuring.parameters, settled=unknowns.settled, words=unknowns.known.words,
        before=unknowns.before(J), after=unknowns.stage(chosen),
        random=Stage.median([unknowns.stage(drawn[:count]) for drawn in random]), gain=gain, equivalent=equivalent,
        tried=len(pool), draws=_DRAWS, target=target, tour=way, room=room, share=share,
        reach=nominal_poses(problem.robot, pool[:_SHOWN])[0], given=given, spread=float(np.sqrt(known.variance)),
        sigma=residuals.sigma, sigma_rotation=residuals.sigma_rotation,
        axes=tuple("xyz"[i] for i in residuals.axes), targets=measuring.targets,
        notes=tuple(dict.fromkeys((*assumed, *known.notes, *notes))),
    )  # fmt: skip


def _given(problem: CalibrationProblem, data: Measurements | None, measuring: Instrument, variance: float) -> Given:
    if data is None:
        return nothing_given(len(measuring.parameters), variance)
    return given_knowledge(problem, data, measuring.parameters, variance)


def _check(unknowns: Unknowns, measuring: Instrument, count: int) -> None:
    """Refuse where nothing can be told, and where the postures are too few for a calibration of all that can."""
    if not unknowns.settled.any() or not unknowns.count:
        said = "; ".join(unknowns.known.words[:3])
        raise InsufficientDataError(f"no parameter can be determined by measuring positions: {said}")
    short = unknowns.count + 1 - unknowns.given.coordinates
    least = max(int(np.ceil(short / measuring.coordinates / measuring.repeats)), 1)
    if count < least:
        message = f"{count} {'posture is' if count == 1 else 'postures are'} too few for {unknowns.count} unknowns"
        raise InputError(Issue(message, ("--count",), count, f"plan at least {least}, better twice as many"))


def _unit_travel(room: Room) -> Array:
    """Joint travel that counts as one radian: of a slide the length of the arm."""
    size = max(length(room.robot), 1e-3)
    return np.array([1.0 if joint.type == "revolute" else size for joint in room.robot.joints])
