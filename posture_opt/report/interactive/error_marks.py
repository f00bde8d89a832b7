"""Errors of an arm in the interactive view: corrections marked at their joints, in the posture for the task."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.interactive.arm_view import Mark
from posture_opt.report.interactive.source_owners import owner_of
from posture_opt.robot.shape import BASE, TOOL
from posture_opt.uncertainty.spread.spread import propagate
from posture_opt.units import ERROR_UNITS, plus_minus

if TYPE_CHECKING:
    from posture_opt.calibration.calibration import Calibration
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.selection.comparison.comparison import Comparison
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.uncertainty.spread.spread import Spread

_MIN_MARKED_Z = 3.0  # standard errors: smaller corrections are not marked
_MAX_MARKS = 5  # joints


def task_posture(problem: ProblemData, comparison: Comparison | None, measured: Array) -> tuple[Array, Spread | None]:
    """The posture (n,) [rad or m] for the task by the reference of a comparison, with its spread.

    Without one: the measured posture, of ``measured`` (N, n) [rad or m], that is nearest to their median, each joint
    in units of its range. The spread is None where the problem has no uncertainty.
    """
    if comparison is not None and comparison.answers_task(comparison.reference):
        (station,) = comparison.answers[comparison.reference].stations
        return station.q, station.spread
    scale = np.maximum(np.ptp(measured, axis=0), 1e-9)
    q = measured[np.argmin(np.linalg.norm((measured - np.median(measured, axis=0)) / scale, axis=1))]
    known = np.any(np.diag(problem.sources.covariance) > 0)
    return q, propagate(problem, q) if known else None


def correction_marks(found: Calibration, problem: ProblemData) -> tuple[Mark, ...]:
    """The most significant correction of each joint, where it exceeds three standard errors.

    At most five joints are marked, the most significant first; a mark has the parameter and its signed change with its
    standard error.
    """
    marks: dict[str, Mark] = {}
    z = np.nan_to_num(np.abs(found.z))
    for k in np.argsort(-z):
        parameter = found.parameters[k]
        owner = owner_of(parameter.name, problem.arm)
        if owner and owner not in marks and z[k] > _MIN_MARKED_Z and found.fixed[k]:
            size = plus_minus(float(found.x[k]), float(found.std[k]), *ERROR_UNITS[parameter.unit])
            marks[owner] = Mark(owner, f"{parameter.name}\n{'+' if found.x[k] > 0 else ''}{size}")
    return tuple(marks.values())[:_MAX_MARKS]


def cause_marks(found: Diagnosis, finding: Finding) -> tuple[Mark, ...]:
    """A cause at its joint, at the base or the tool; of all geometry together, the most significant corrections.

    Nothing where a cause belongs to no part of the arm.
    """
    problem = found.extended
    cause, owners = finding.cause, (*problem.robot.joint_names, BASE, TOOL)
    named = (cause.target, cause.moved_joint, owner_of(cause.target, problem.arm))
    owner = next((name for name in named if name in owners), "")
    size = finding.size_text
    if owner:
        return (Mark(owner, f"{finding.label}\n{size}" if size else finding.label),)
    geometric = finding.effect is None and finding.noise is None
    return correction_marks(found.calibration, problem) if geometric else ()
