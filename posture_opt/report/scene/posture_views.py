"""Interactive views of results: postures of solutions and maps, and errors of an arm marked at their joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.report.scene.arm_geometry import TargetGeometry
from posture_opt.report.scene.arm_view import ArmView, ShownPosture
from posture_opt.report.text.words import PARTS
from posture_opt.robot.robot import BASE, TOOL
from posture_opt.statements.notation import length, place
from posture_opt.uncertainty.budget import Share
from posture_opt.uncertainty.spread import propagate, relative_spread
from posture_opt.units import ERROR_UNITS, plus_minus

if TYPE_CHECKING:
    from posture_opt import Calibration, Comparison, Diagnosis, Solution, Spread, TargetMap
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.selection.maps.map_points import MapPoint
    from posture_opt.selection.problem_data import ProblemData


def owner_of(parameter: str, arm: Arm) -> str:
    """The joint that a source of error belongs to, ``base`` or ``tool``; empty where it belongs to none."""
    robot = arm.robot
    for owner, factors in ((BASE, robot.base), *zip(robot.joint_names, robot.links, strict=True), (TOOL, robot.tool)):
        if any(factor.parameter == parameter for factor in factors):
            return owner
    if parameter in arm.unknown_sides:
        return parameter.removesuffix(".side")
    for found in arm.measured_ranges:
        if parameter == found.name:
            return found.effect.target
    targets = [effect.target for effect in arm.effects if parameter in effect.parameter_names]
    return next((target for target in targets if target in (*robot.joint_names, BASE, TOOL)), "")


def shares_by_owner(shares: Sequence[Share], arm: Arm) -> tuple[tuple[str, float], ...]:
    """The shares of all sources of one owner together, the largest first."""
    total: dict[str, float] = {}
    for share in shares:
        owner = owner_of(share.parameter, arm)
        total[owner] = total.get(owner, 0.0) + share.share
    return tuple(sorted(((owner, size) for owner, size in total.items() if owner), key=lambda entry: -entry[1]))


def solution_postures(solutions: Sequence[Solution], names: Sequence[str], stem: str) -> tuple[ShownPosture, ...]:
    """The postures of some solutions, with tool point, spread, target and shares of the joints."""
    found = []
    for k, (name, one) in enumerate(zip(names, solutions, strict=True), 1):
        sigma = length(one.critical.sigma_max)
        facts = ((f"σ {PARTS[one.critical.within]}", sigma), ("Tool point", place(one.spread.position)))
        shares, target = shares_by_owner(one.budget, one.optimisation_problem.arm), TargetGeometry.of(one.target)
        found.append(ShownPosture(f"{stem}-{k}", f"{name}: {sigma}", one.q, facts, one.spread, target, shares))
    return tuple(found)


def spread_view(found: Spread) -> ArmView:
    """The one posture of a spread, with the direction of the task where there is one and the shares of the joints."""
    seen = found.for_task
    facts = [("Tool point", place(found.position))]
    if seen is not None:
        sigma = length(seen.critical.sigma_max)
        facts.insert(0, (f"σ {PARTS[seen.critical.within]}", sigma))
    target = None if seen is None else TargetGeometry("anywhere", found.position, found.position, seen.direction, None)
    budget = found.budget if seen is None else seen.budget
    arm = found.tool_point.arm
    shares = shares_by_owner(budget, arm)
    posture = ShownPosture("posture", "posture", np.array(found.q), tuple(facts), found, target, shares)
    return ArmView(arm.robot, (posture,), "Posture", getattr(found.problem, "scene", None))


def target_key(point: MapPoint) -> str:
    """By which tables name a target of the view."""
    return f"target {place(point.position)}"


def target_view(found: TargetMap, sizes: Sequence[float], what: str) -> ArmView | None:
    """The postures coloured by ``sizes`` (N,) [m], of which ``what`` says what they are, the one with the smallest size
    first; None where no target has one."""
    postures = []
    for point, size in zip(found.map_points, sizes, strict=True):
        if point.feasible:
            at, long = place(point.position), length(size)
            facts = ((what.capitalize(), long), ("Target", at))
            spread = relative_spread(found.problem, point.q, found.target.lever)
            target = TargetGeometry.of(replace(found.target, lower=point.position, upper=point.position))
            shown = ShownPosture(target_key(point), f"{at}: {long}", point.q, facts, spread, target)
            postures.append((shown, float(size)))
    if not postures:
        return None
    best = min(postures, key=lambda posture: posture[1])  # by the sizes of the report, not by rounded ones
    ordered = [best, *(posture for posture in postures if posture is not best)]
    return ArmView.coloured(found.problem, "Target", ordered, what)


def task_posture(problem: ProblemData, comparison: Comparison | None, measured: Array) -> tuple[Array, Spread | None]:
    """The posture (n,) [rad or m] for the task by the reference of a comparison, with its spread."""
    if comparison is not None and comparison.answers_task(comparison.reference):
        (station,) = comparison.answers[comparison.reference].stations
        return station.q, station.spread
    scale = np.maximum(np.ptp(measured, axis=0), 1e-9)
    q = measured[np.argmin(np.linalg.norm((measured - np.median(measured, axis=0)) / scale, axis=1))]
    known = np.any(np.diag(problem.sources.covariance) > 0)
    return q, propagate(problem, q) if known else None


def correction_marks(found: Calibration, problem: ProblemData) -> tuple[tuple[str, str], ...]:
    """The most significant correction of each joint, where it exceeds three standard errors."""
    marks: dict[str, str] = {}
    z = np.nan_to_num(np.abs(found.z))
    for k in np.argsort(-z):
        parameter = found.parameters[k]
        owner = owner_of(parameter.name, problem.arm)
        # Corrections below three standard errors are not marked.
        if owner and owner not in marks and z[k] > 3.0 and found.fixed[k]:
            size = plus_minus(float(found.x[k]), float(found.std[k]), *ERROR_UNITS[parameter.unit])
            marks[owner] = f"{parameter.name}\n{'+' if found.x[k] > 0 else ''}{size}"
    return tuple(marks.items())[:5]


def cause_marks(found: Diagnosis, finding: Finding) -> tuple[tuple[str, str], ...]:
    """A cause at its joint, at the base or the tool; of all geometry together, the most significant corrections."""
    problem = found.extended
    cause, owners = finding.cause, (*problem.robot.joint_names, BASE, TOOL)
    named = (cause.target, cause.moved_joint, owner_of(cause.target, problem.arm))
    owner = next((name for name in named if name in owners), "")
    size = finding.size_text
    if owner:
        return ((owner, f"{finding.label}\n{size}" if size else finding.label),)
    geometric = finding.effect is None and finding.noise is None
    return correction_marks(found.calibration, problem) if geometric else ()
