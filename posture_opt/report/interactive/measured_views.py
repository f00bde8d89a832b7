"""The interactive views of what was measured, or is to be: rows, planned postures, and causes of error on the arm."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.figures.residuals import chosen_rows
from posture_opt.report.interactive.arm_view import ArmView, Mark, ShownPosture
from posture_opt.report.interactive.owners import owner_of
from posture_opt.report.parts.diagnosis_causes import finding_words, view_key
from posture_opt.report.parts.diagnosis_sizes import headline_of
from posture_opt.report.text.units_text import length, length_unit, place, quantity
from posture_opt.robot.shape import BASE, TOOL
from posture_opt.uncertainty.spread.spread import propagate

if TYPE_CHECKING:
    from posture_opt.calibration.calibration import Calibration
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.report.results.calibration_report import CalibrationPresenter
    from posture_opt.report.results.compensation_report import CompensationPresenter
    from posture_opt.report.results.diagnosis_report import DiagnosisPresenter
    from posture_opt.report.results.measurement_plan_report import MeasurementPlanPresenter
    from posture_opt.selection.comparison.plan_comparison import Comparison
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.uncertainty.spread.spread import Spread

_ROWS = 200  # of measurements that are shown
_CLEAR = 3.0  # standard errors: corrections that are marked on the arm
_MOST = 5  # joints whose corrections are marked


def measurement_plan(shown: MeasurementPlanPresenter) -> ArmView:
    """The planned postures in the order of the tour."""
    plan = shown.result
    postures = tuple(
        ShownPosture(f"posture-{k}", f"posture {k}", q, (("Tool point", place(point)),))
        for k, (q, point) in enumerate(zip(plan.q, plan.points, strict=True), 1)
    )
    scene = getattr(plan.problem, "scene", None)
    return ArmView(plan.robot, postures, "Posture", scene, points=True, line=True)


def compensation(shown: CompensationPresenter) -> ArmView:
    """The compensated rows, coloured by what is left of their error."""
    found = shown.result
    unit, factor = length_unit(found.left.tolist())
    rows = chosen_rows(len(found), _ROWS)
    postures = tuple(
        ShownPosture(
            f"line-{found.targets.line[k]}",
            f"line {found.targets.line[k]}: {length(float(found.left[k]))} left",
            found.q[k],
            (("Off as given", length(float(found.off[k]))), ("Left", length(float(found.left[k])))),
            value=round(factor * float(found.left[k]), 5),
        )
        for k in rows
    )
    robot, scene = found.problem.robot, getattr(found.problem, "scene", None)
    return ArmView(robot, postures, "Target", scene, points=True, values=f"left [{unit}]")


def calibration(shown: CalibrationPresenter) -> ArmView:
    """The corrections, each at its joint, and the measured rows, coloured by what calibration leaves of their error."""
    found, calibrated = shown.result, shown.models["calibrated"]
    data = found.request.data
    before, after = (np.linalg.norm(errors, axis=1) for errors in (found.errors_nominal, found.errors))
    rows = found.kept_rows[chosen_rows(len(found.kept_rows), _ROWS)]
    unit, factor = length_unit(after[rows].tolist())
    q, spread = _shown_posture(calibrated, shown.comparison, data.q)
    first = ShownPosture(
        "corrections", "corrections of the arm", q, spread=spread, marks=_corrections(found, calibrated)
    )
    measured = tuple(
        ShownPosture(
            f"line-{data.line[k]}",
            f"line {data.line[k]}: {length(float(after[k]))} off after calibration",
            data.q[k],
            (("Error before calibration", length(float(before[k]))), ("Error after", length(float(after[k])))),
            value=round(factor * float(after[k]), 5),
        )
        for k in rows
    )
    values = f"error after calibration [{unit}]"
    return ArmView(calibrated.robot, (first, *measured), "Shown", calibrated.scene, points=True, values=values)


def diagnosis(shown: DiagnosisPresenter) -> ArmView:
    """Every cause at the joint that it is of, with its size: all of them, and each by itself."""
    found, extended = shown.result, shown.result.extended
    q, spread = _shown_posture(extended, shown.comparison, found.request.data.q)
    marks = [_marks(found, extended, finding) for finding in found.effects]
    single = [own for own in marks if len(own) == 1] or marks
    every = tuple(mark for own in single for mark in own)
    postures = [ShownPosture("causes", "all causes" if every else "no cause found", q, spread=spread, marks=every)]
    for finding, own in zip(found.effects, marks, strict=True):
        words, size = finding_words(finding, found.problem), headline_of(found, finding)
        facts = (("Cause", words), *([("Size", size)] if size else []))
        postures.append(ShownPosture(view_key(found, finding), words, q, facts, spread, marks=own))
    return ArmView(extended.robot, tuple(postures), "Cause", extended.scene)


def _shown_posture(problem: ProblemData, comparison: Comparison | None, measured: Array) -> tuple[Array, Spread | None]:
    """The posture for the task by the arm that was found, with its spread; else a measured row amid the others."""
    if comparison is not None and comparison.reference in comparison.answered:
        solution = comparison.answered[comparison.reference][0]
        return solution.q, solution.spread
    scale = np.maximum(np.ptp(measured, axis=0), 1e-9)
    q = measured[np.argmin(np.linalg.norm((measured - np.median(measured, axis=0)) / scale, axis=1))]
    known = np.any(np.diag(problem.sources.covariance) > 0)
    return q, propagate(problem, q) if known else None


def _marks(found: Diagnosis, problem: ProblemData, finding: Finding) -> tuple[Mark, ...]:
    """The cause at its joint, at the base or the tool; of all geometry together, the clearest corrections."""
    cause, owners = finding.cause, (*problem.robot.joint_names, BASE, TOOL)
    named = (cause.target, cause.moved_joint, owner_of(cause.target, problem.arm))
    owner = next((name for name in named if name in owners), "")
    size = headline_of(found, finding)
    if owner:
        return (Mark(owner, f"{cause.label}\n{size}" if size else cause.label),)
    geometric = finding.effect is None and finding.noise is None
    return _corrections(found.calibration, problem) if geometric else ()


def _corrections(found: Calibration, problem: ProblemData) -> tuple[Mark, ...]:
    """The clearest correction of each joint, where it stands out of its standard error."""
    told: dict[str, Mark] = {}
    z = np.nan_to_num(np.abs(found.z))
    for k in np.argsort(-z):
        parameter = found.parameters[k]
        owner = owner_of(parameter.name, problem.arm)
        if owner and owner not in told and z[k] > _CLEAR and found.fixed[k]:
            size = quantity(float(found.x[k]), parameter.unit)
            told[owner] = Mark(owner, f"{parameter.name} {'+' if found.x[k] > 0 else ''}{size}")
    return tuple(told.values())[:_MOST]
