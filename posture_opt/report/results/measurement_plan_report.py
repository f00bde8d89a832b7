"""The report on what to measure next: the postures, what can be expected of them, and against what.

Three stages are compared: before (stated σ's and given rows), planned (with the postures of the plan) and random (the
median of plans of as many random postures under the same requirements).
"""

from __future__ import annotations

import math
from collections import Counter
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.report.figures.plan import plot_plan_errors, plot_plan_points
from posture_opt.report.interactive.arm_view import ArmView, ShownPosture
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts.collision_parts import clear_words
from posture_opt.report.parts.parts import note_facts, robot_facts
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.statements.notation import angle, angle_error, count, joint_unit, length, percent, place, stated_length
from posture_opt.units import ERROR_UNITS, fixed, number

if TYPE_CHECKING:
    from posture_opt.experiments.expected_errors import ExpectedErrors
    from posture_opt.experiments.measurement_plan import MeasurementPlan

_MAX_ROWS = 60
_MAX_HEADER_WIDTH = 100
_ZERO_INDEX = 1e-6  # an index below it says that something is open
_MIN_NOTED_RATIO = 1.1  # times the instrument's σ: from there on it is reported
_UNKNOWN = "unknown"
_STAGES = ("before", "planned", "random")
_PURPOSES = {
    "parameters": "the parameters of the arm: smallest volume of their confidence ellipsoid (D-optimal)",
    "task": "the task: smallest variance of the tool point at its posture, in the critical direction (L-optimal)",
    "recheck": "a recheck: possible changes, each by 0.3 mm at the tool, distinguished best (D-optimal)",
}
_INDEX_WORDS = {
    "O1": "geometric mean of the singular values, a pose",
    "O2": "smallest over largest",
    "O3": "smallest",
    "O4": "smallest squared over largest",
    "O5": "harmonic, of the squares",
}


def planned_block(plan: MeasurementPlan) -> Block:
    """What is measured, where the arm may go, what was assumed."""
    problem, room = problem_of(plan), plan.workspace
    facts = [("Plan for", _PURPOSES[plan.purpose]), ("Measured", _measured(plan))]
    facts += [("Targets", ", ".join(plan.targets))] if plan.targets else []
    facts += [("Rounds", str(plan.repeats))] if plan.repeats > 1 else []
    facts += [("Given", f"{count(len(plan.given), 'row')} measured already")] if plan.given is not None else []
    if plan.spread > _MIN_NOTED_RATIO:
        facts.append(("Arm's scatter", f"{length(plan.arm_scatter, 2)} per coordinate, included"))
    facts.append(("Kept clear", clear_words(room.scene)))
    facts += [("Height", f"links and tool point above {stated_length(room.height)}")] if room.height > -math.inf else []
    facts.append(("Allowed", f"{percent(plan.share)} of the random postures tried"))
    notes = note_facts((*problem.notes, *plan.notes))
    return Block("What is planned", (Facts((*robot_facts(problem), *facts, *notes)),))


def _measured(plan: MeasurementPlan) -> str:
    """Axes with the σ of the instrument, or the instruments with their postures; how many postures."""
    if plan.instruments:
        return ", ".join(f"{n} for {name}" for name, n in Counter(plan.instruments).most_common())
    turning = plan.given is not None and plan.given.kind.unit == "rad"
    sigma = angle_error(plan.sigma) if turning else stated_length(plan.sigma)
    turned = f", orientation σ {angle_error(plan.sigma_rotation)}" if plan.sigma_rotation else ""
    return f"{', '.join(plan.axes)} (σ {sigma}{turned}) at {count(len(plan.q), 'posture')}"


def gain_block(plan: MeasurementPlan) -> Block:
    """The figures of merit before, after, and with random postures: parameters determined, error at the task [mm]."""
    rows = [("parameters determined", *(str(int(np.sum(np.isfinite(s.std)))) for s in _stages(plan)))]
    if plan.target is not None:
        rows.append(("error at the task [mm]", *(_value(s.task * 1e3) for s in _stages(plan))))
    rows.append(("standard error, relative", "", "1", number(plan.gain)))
    given = "given rows and " * (plan.given is not None)
    text = f"Before: {given}stated σ's. Random: median of {count(plan.draws, 'plan')} of as many random postures."
    return Block("What it brings", (text, Table(("", *_STAGES), tuple(rows))), "plan_points")


def _stages(plan: MeasurementPlan) -> tuple[ExpectedErrors, ExpectedErrors, ExpectedErrors]:
    """Before, planned and random, in the order of the columns."""
    return plan.before, plan.after, plan.random


def _value(value: float) -> str:
    """A number, or "unknown" where it is not determined."""
    return _UNKNOWN if math.isnan(value) else number(value)


def parameters_block(plan: MeasurementPlan) -> Block:
    """Expected standard errors [mrad or mm] at the three stages, of the parameters that some stage determines."""
    rows = []
    for i in plan.listed:
        factor, unit = ERROR_UNITS[plan.parameters[i].unit]
        rows.append((plan.parameters[i].name, unit, *(_value(stage.std[i] * factor) for stage in _stages(plan))))
    table = Table(("parameter", "unit", *_STAGES), tuple(rows), text_columns=2)
    return Block("Parameters", (f"Expected standard errors; '{_UNKNOWN}': not determined.", table), "plan_errors")


def observability_block(plan: MeasurementPlan) -> Block:
    """The observability indices O1 to O5 at the three stages.

    Of the singular values σ₁ ≥ … ≥ σₗ of the scaled Jacobian of m rows: O1 ``(σ₁ … σₗ)^(1/l) / sqrt(m)``, O2
    ``σₗ/σ₁``, O3 ``σₗ``, O4 ``σₗ²/σ₁``, O5 ``1 / Σ σ⁻²``.
    """
    names = plan.after.observability
    rows = tuple((f"{n}, {_INDEX_WORDS[n]}", *(_index(s.observability[n]) for s in _stages(plan))) for n in names)
    text = "Of the Jacobian, scaled so that each parameter moves the tool point equally; larger is better."
    return Block("Observability", (text, Table(("index", *_STAGES), rows)), brief=())


def _index(value: float) -> str:
    """An index, 0 below a millionth: some combination is not determined."""
    return number(value) if value > _ZERO_INDEX else "0"


def postures_block(plan: MeasurementPlan) -> Block:
    """The postures in order: joints [deg or mm], nominal tool point [mm]; those beyond the table are in the file."""
    units = [joint_unit(joint.type) for joint in plan.robot.joints]
    headers = [f"{j.name} [{unit}]" for j, (unit, _) in zip(plan.robot.joints, units, strict=True)]
    if len("  ".join([*headers, "no.", *3 * ["-1000.0"]])) > _MAX_HEADER_WIDTH:  # they are broken between words
        headers = [head.replace("_", " ") for head in headers]
    factors = np.array([factor for _, factor in units])
    what = {name: cells for name, cells in (("instrument", plan.instruments), ("at", plan.places)) if any(cells)}
    rows = tuple(
        (str(k + 1), *(fixed(float(v)) for v in q * factors), *(fixed(float(v), 1) for v in 1e3 * point),
         *(cells[k] for cells in what.values()))
        for k, (q, point) in enumerate(zip(plan.q[:_MAX_ROWS], plan.points, strict=False))
    )  # fmt: skip
    more = [f"and {len(plan.q) - _MAX_ROWS} more in plan.csv"] if len(plan.q) > _MAX_ROWS else []
    views = tuple(f"posture-{row[0]}" for row in rows)
    table = Table(("no.", *headers, "x [mm]", "y [mm]", "z [mm]", *what), rows, text_columns=0, views=views)
    travel = f"{angle(plan.tour.travel)} in this order, {angle(plan.tour.unordered)} as selected"
    facts = [Facts((("Joint travel", travel),))] if len(plan.q) > 1 else []
    return Block("Postures, in the order of measurement", (*facts, table, *more), stays=True)


def points_csv(plan: MeasurementPlan) -> str:
    """Where the nominal tool point comes to lie, world [mm], for the eye and for the instrument."""
    rows = [f"{k}, {', '.join(fixed(1e3 * float(v)) for v in point)}" for k, point in enumerate(plan.points, start=1)]
    return "\n".join(["posture, x [mm], y [mm], z [mm]", *rows]) + "\n"


class MeasurementPlanPresenter(Presenter["MeasurementPlan"]):
    """Which postures to measure next; ``plan.csv`` has their joint values and empty columns for the readings."""

    stem = "plan"
    delivers: ClassVar[tuple[str, ...]] = ("plan.csv",)

    def summary(self) -> Summary:
        """Purpose, worth in random postures, parameters determined, error at the task, joint travel."""
        plan = self.result
        known = [int(np.sum(np.isfinite(stage.std))) for stage in (plan.before, plan.after)]
        worth = f"{plan.equivalent} random ones" if plan.equivalent else f"more than {plan.tried} random ones"
        task = [] if plan.target is None or math.isnan(plan.after.task) else [("At the task", length(plan.after.task))]
        facts = (
            ("Plan for", plan.purpose),
            ("Worth", worth),
            ("Parameters determined", f"{known[1]} of {len(plan.parameters)} ({known[0]} before)"),
            *task,
            ("Joint travel", angle(plan.tour.travel)),
        )
        return Summary(f"Plan of {count(len(plan.q), 'posture')} to measure: {self.problem.name}", facts)

    def document(self) -> Document:
        """What it brings, the postures in order, the parameters, what is planned."""
        plan = self.result
        makers = (gain_block, postures_block, parameters_block, planned_block, observability_block)
        return Document(self.problem.name or "Measurement plan", plan.statements, tuple(make(plan) for make in makers))

    def drawings(self) -> Drawings:
        """Where the tool goes, and what can be expected of it."""
        return {
            "plan_points": partial(plot_plan_points, self.result),
            "plan_errors": partial(plot_plan_errors, self.result),
        }

    def view(self) -> ArmView:
        """The planned postures in the order of the tour."""
        plan = self.result
        postures = tuple(
            ShownPosture(f"posture-{k}", f"posture {k}", q, (("Tool point", place(point)),))
            for k, (q, point) in enumerate(zip(plan.q, plan.points, strict=True), 1)
        )
        scene = getattr(plan.problem, "scene", None)
        return ArmView(plan.robot, postures, "Posture", scene, points=True, line=True)

    def columns(self) -> Columns:
        """The postures in order, joints [deg or mm], and the nominal tool point [mm], world frame."""
        plan = self.result
        joints = [(joint.name, *joint_unit(joint.type)) for joint in plan.robot.joints]
        postures = {f"{name} [{unit}]": plan.q[:, k] * factor for k, (name, unit, factor) in enumerate(joints)}
        return {**postures, **{f"{c} [mm]": 1e3 * plan.points[:, k] for k, c in enumerate("xyz")}}

    def files(self) -> Files:
        """``plan.csv`` for the measurement, ``plan_points.csv`` with the tool points for setting up the instrument."""
        return {"plan.csv": self.result.to_csv().encode(), "plan_points.csv": points_csv(self.result).encode()}
