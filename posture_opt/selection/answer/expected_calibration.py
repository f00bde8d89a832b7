"""What a calibration would leave unknown of the errors that stay: an estimate before anything is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.joint_ranges import drawn_between
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.uncertainty.sources.sources import Sources

if TYPE_CHECKING:
    from posture_opt.selection.problem_data import ProblemData

_MEASURED_POSTURES = 30  # as many as ISO 9283 takes repeats; a 6R arm's parameters need far fewer
_DRAWN_PER_POSTURE = 10  # times as many, of which those are kept that are clear of collisions
_INSTRUMENT_SIGMA_M = 0.05e-3  # m: a laser tracker with its target in a nest, where the file states no instrument


@dataclass(frozen=True)
class Calibrating:
    """Random postures at which the tool point would be measured.

    Args:
        postures: how many; instrument: standard deviation of each measured coordinate [m].
        assumed: whether the instrument is an assumption, because the file states none.
    """

    postures: int
    instrument: float
    assumed: bool

    @classmethod
    def of(cls, problem: ProblemData) -> Calibrating:
        """With the instrument of positions that the problem states; 0.05 mm is assumed where it states none."""
        stated = 0.0 if problem.measurement is None else problem.measurement.position
        return cls(_MEASURED_POSTURES, stated or _INSTRUMENT_SIGMA_M, not stated)


@dataclass(frozen=True)
class KnownAfter:
    """The sources of error after a calibration, and what was measured for it.

    Args:
        sources: with the part that stays reduced; scatter from repeat to repeat is as before.
        postures: that are measured; ``instrument``: standard deviation of a coordinate [m], ``assumed`` where the
            file states none.
    """

    sources: Sources
    postures: int
    instrument: float
    assumed: bool


def after_calibration(problem: ProblemData, plan: Calibrating) -> KnownAfter | None:
    """The sources with the part that stays reduced to what the measurements leave of it; None where nothing stays.

    The constant part Σ is updated by every measured point, ``Σ ← Σ − ΣJᵀ(JΣJᵀ + R)⁻¹JΣ`` with J (3, k) the sensitivity
    of the tool point and ``R = s²I + J S Jᵀ`` of instrument and scatter: linear least squares with the stated σ's as
    priors (Bar-Shalom, Li and Kirubarajan 2001, section 3.2). Frames are taken as the problem states them.
    """
    sources = problem.sources
    remaining = sources.constant
    if not np.any(np.diag(remaining) > 0):
        return None
    for q in _postures(problem, plan.postures):
        J = _sensitivity(problem, q)
        noise = plan.instrument**2 * np.eye(3) + J @ sources.scatter @ J.T
        gain = np.linalg.solve(J @ remaining @ J.T + noise, J @ remaining)
        remaining = remaining - remaining @ J.T @ gain
        remaining = (remaining + remaining.T) / 2
    known = Sources(sources.names, remaining + sources.scatter, sources.notes, sources.scatter)
    return KnownAfter(known, plan.postures, plan.instrument, plan.assumed)


def _postures(problem: ProblemData, count: int) -> Array:
    """(N, n) random postures within the limits, clear of collisions where enough of them are."""
    drawn = np.random.default_rng(0).uniform(
        *drawn_between(problem.robot), (_DRAWN_PER_POSTURE * count, problem.robot.n)
    )
    clear = drawn[is_clear(problem.scene, drawn)] if problem.scene.active else drawn
    return (clear if len(clear) >= count else drawn)[:count]


def _sensitivity(problem: ProblemData, q: Array) -> Array:
    """(3, k) shift of the tool point per unit of each source, world."""
    values = q.tolist()
    twists = problem.arm.twists(problem.sources.names, values, problem.arm.reach(values).walk)
    return np.array([shift for shift, _ in twists], dtype=float).T
