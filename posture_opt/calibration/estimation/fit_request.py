"""What a calibration or a diagnosis was asked, how far along it is, and what stays uncertain after it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np

from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Progress
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import NEGLIGIBLE, ProblemData
from posture_opt.uncertainty.sources import Sources


@dataclass(frozen=True, eq=False, repr=False)
class FitRequest:
    """The arm as it is stated, what was measured, and what to make of it."""

    problem: ProblemData
    data: Measurements
    folds: int = 5  # of the cross-validation
    # other measurements that are predicted, with base and tool fitted again if ``refit_frames``
    test: Measurements | None = None
    refit_frames: bool = False
    plan: bool = True  # whether the task is planned again with the arm that is found, when that is asked for
    seed: int | None = None  # of that plan; None for the problem's


def places_in_robot(parameters: Sequence[Parameter]) -> dict[str, int]:
    """Name in the robot -> place among the parameters of a fit; of several targets the first is the tool point."""
    return {
        f"tool.{p.name.rpartition('.')[2]}" if p.group == "tool" else p.name: i
        for i, p in enumerate(parameters)
        if p.group in ("geometry", "base", "tool") and p.code <= 0
    }


def persistent_sources(robot: Robot, stated: Sources, names: Sequence[str], covariance: Array) -> Sources:
    """What is still uncertain of errors that stay: the estimates, and stated σ's that the data had no part in.

    names (k,) of the parameters that were fitted; covariance: (k, k) of their estimates, SI.

    Returns Sources that stay from repeat to repeat, with their covariance [rad², m², rad m].
    """
    parameters = robot.parameters
    least = np.array([NEGLIGIBLE["rad" if parameters[name].kind == "rotate" else "m"] for name in names])
    kept = np.flatnonzero(np.diag(covariance) > least**2).tolist()
    found = Sources(tuple(names[i] for i in kept), nearest_semidefinite(covariance[np.ix_(kept, kept)]))
    # The value of a joint with an origin of six moves the tool as its origin does, which was fitted.
    moved = {name.rpartition(".")[0] for name in names if name.endswith(".roll")}
    fitted = {*names, *(f"{joint}.{value}" for joint in moved for value in ("theta", "d"))}
    others = [i for i, name in enumerate(stated.names) if name not in fitted and stated.constant[i, i] > 0]
    return found.plus(Sources(tuple(stated.names[i] for i in others), stated.constant[np.ix_(others, others)]))


def nearest_semidefinite(covariance: Array) -> Array:
    """The covariance (k, k) with negative eigenvalues set to zero, which are rounding.

    Source: Higham (1988), the nearest positive semidefinite matrix in the Frobenius norm, of the correlations.
    """
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0, sigma, 1.0)  # what moves nothing that was measured has no variance at all
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    found = (vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(sigma, sigma)
    return np.asarray((found + found.T) / 2)


PROGRESS_TOTAL = 100


class Stages:
    """Shares a bar between stages of known shares; within a stage steps are reported as so many of so many.

    progress: receives (done, 100); None for no report. shares: of each stage, in the order in which they come.
    """

    def __init__(self, progress: Progress | None, *shares: int) -> None:
        self._progress, self._shares, self._done = progress, list(shares), 0

    def next(self) -> Progress:
        """Ends the stage before and begins the next one, whose steps are reported to what is returned."""
        begin, share = self._done, self._shares.pop(0)
        self._done += share
        self._report(begin)

        def report_step(done: int, total: int) -> None:
            self._report(begin + share * min(done, total) // max(total, 1))

        return report_step

    def rounds(self, progress: Progress) -> Callable[[], None]:
        """Reports rounds whose number is unknown: each takes a third of what is left of the stage."""
        done = count(1)
        return lambda: progress(round(1000 * (1 - (2 / 3) ** next(done))), 1000)

    def end(self) -> None:
        self._report(PROGRESS_TOTAL)

    def _report(self, done: int) -> None:
        if self._progress is not None:
            self._progress(done, PROGRESS_TOTAL)
