"""``FitRequest``: what a calibration or a diagnosis was asked, and what it says of the errors that stay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.fitted_arm import NEGLIGIBLE
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.sources.sources import Sources


@dataclass(frozen=True, eq=False, repr=False)
class FitRequest:
    """The arm as it is stated, what was measured, and what to make of it.

    Args:
        folds: of the cross-validation.
        test: other measurements that are predicted, with base and tool fitted again if ``refit_frames``.
        plan: whether the task is planned again with the arm that is found, when that is asked for.
        seed: of that plan; None for the problem's.
    """

    problem: ProblemData
    data: Measurements
    folds: int = 5
    test: Measurements | None = None
    refit_frames: bool = False
    plan: bool = True
    seed: int | None = None


def places_in_robot(parameters: Sequence[Parameter]) -> dict[str, int]:
    """Name in the robot -> place among the parameters of a fit; of several targets the first is the tool point.

    Args:
        parameters: of a fit; those of effects and touched points are left out.
    """
    return {
        f"tool.{p.name.rpartition('.')[2]}" if p.group == "tool" else p.name: i
        for i, p in enumerate(parameters)
        if p.group in ("geometry", "base", "tool") and p.code <= 0
    }


def persistent_sources(robot: Robot, stated: Sources, names: Sequence[str], covariance: Array) -> Sources:
    """What is still uncertain of errors that stay: the estimates, and stated σ's that the data had no part in.

    Args:
        stated: the sources of the problem.
        names: (k,) of the parameters that were fitted; covariance: (k, k) of their estimates, SI.

    Returns:
        Sources that stay from repeat to repeat, with their covariance [rad², m², rad m].
    """
    parameters = robot.parameters
    least = np.array([NEGLIGIBLE["rad" if parameters[name].kind == "rotate" else "m"] for name in names])
    kept = [i for i in range(len(names)) if covariance[i, i] > least[i] ** 2]
    found = Sources(tuple(names[i] for i in kept), nearest_semidefinite(covariance[np.ix_(kept, kept)]))
    moved = {name.rpartition(".")[0] for name in names if name.endswith(".roll")}
    others = [
        i
        for i, name in enumerate(stated.names)
        if name not in names
        and stated.constant[i, i] > 0
        # The value of a joint with an origin of six moves the tool as its origin does, which was fitted.
        and not (name.rpartition(".")[0] in moved and name.rpartition(".")[2] in ("theta", "d"))
    ]
    return found.plus(Sources(tuple(stated.names[i] for i in others), stated.constant[np.ix_(others, others)]))


def nearest_semidefinite(covariance: Array) -> Array:
    """The covariance (k, k) with negative eigenvalues set to zero, which are rounding.

    In correlations, which have no units.

    Source: Higham (1988), the nearest positive semidefinite matrix in the Frobenius norm, of the correlations.
    """
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0, sigma, 1.0)  # what moves nothing that was measured has no variance at all
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    found = (vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(sigma, sigma)
    return np.asarray((found + found.T) / 2)
