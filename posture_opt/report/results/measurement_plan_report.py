"""The report on what to measure next: the postures, what can be expected of them, and against what.

Three stages are compared: before (stated σ's and given rows), planned (with the postures of the plan) and random (the
median of plans of as many random postures under the same requirements).
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.errors import listed
from posture_opt.report.figures.plan import plot_plan_errors, plot_plan_points
from posture_opt.report.interactive.arm_view import ArmView, ShownPosture
from posture_opt.report.measured_parts.plan_parts import is_listed, planned_block
from posture_opt.report.page.presenter import Columns, Drawings, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts.collision_parts import mounting_lead
from posture_opt.report.parts.parts import sentence
from posture_opt.report.text.blocks import Block, Report, Summary, Table
from posture_opt.statements.notation import (
    angle,
    count,
    joint_unit,
    length,
    length_unit,
    percent,
    place,
)
from posture_opt.units import ERROR_UNITS, fixed, number

if TYPE_CHECKING:
    from posture_opt.experiments.expected_errors import ExpectedErrors
    from posture_opt.experiments.measurement_plan import MeasurementPlan

_MAX_ROWS = 60
_MAX_HEADER_WIDTH = 100
_ZERO_INDEX = 1e-6  # an index below it says that something is open
_UNKNOWN = "unknown"
_FOR = {"parameters": "for the parameters", "task": "for the task", "recheck": "for telling changes apart"}
_INDEX_WORDS = {
    "O1": "geometric mean of the singular values, a pose",
    "O2": "smallest over largest",
    "O3": "smallest",
    "O4": "smallest squared over largest",
    "O5": "harmonic, of the squares",
}


def measurement_plan_report(plan: MeasurementPlan) -> Report:
    """What is planned, what it brings, the parameters, the postures in the order of their visit."""
    problem = problem_of(plan)
    blocks = (
        planned_block(problem, plan),
        gain_block(plan),
        parameters_block(plan),
        observability_block(plan),
        postures_block(plan),
    )
    first, last = mounting_lead(plan.workspace.scene, plan.q)
    return Report(problem.name or "Measurement plan", (*first, *answer(plan), *last), blocks)


def answer(plan: MeasurementPlan) -> tuple[str, ...]:
    """What the plan brings, in one or two sentences.

    The first says how many random postures the plan is worth; about as many means that planning is not needed for this
    arm. The second is the expected error at the posture of the task, left out without one. A warning follows where no
    height of the table is stated.
    """
    n = len(plan.q)
    chosen = f"{n} planned postures are" if n > 1 else "1 planned posture is"
    what = _FOR[plan.purpose]
    if plan.equivalent is None:
        first = f"{chosen} worth more than {plan.tried} random ones {what}."
    elif plan.equivalent <= n:
        first = f"{chosen} worth about as many random ones {what}: random postures suffice for this arm."
    else:
        first = f"{chosen} worth about {plan.equivalent} random ones {what}."
    table = "The height of the table is not stated: add link_height before running these postures on the robot."
    warned = () if plan.keeps_height else (table,)
    if plan.target is None or math.isnan(plan.after.task):
        return (first, *warned)
    known = [plan.after.task] if math.isnan(plan.before.task) else [plan.before.task, plan.after.task]
    unit, factor = length_unit(known)
    before = f" ({number(factor * plan.before.task)} {unit} without these measurements)" if len(known) > 1 else ""
    counted = {"across": "across the direction ", "along": "along the direction "}.get(plan.target.within, "")
    return (
        first,
        f"Expected RMS error {counted}at the posture of the task, from parameter uncertainty: "
        f"{number(factor * plan.after.task)} {unit}{before}.",
        *warned,
    )


def gain_block(plan: MeasurementPlan) -> Block:
    """The figures of merit before, after, and with random postures: parameters determined, error at the task [mm]."""
    known = [int(np.sum(np.isfinite(stage.std))) for stage in (plan.before, plan.after, plan.random)]
    rows = [("parameters determined", *(str(n) for n in known))]
    if plan.target is not None:
        rows.append(("error at the task [mm]", *(_value(s.task * 1e3) for s in _stages(plan))))
    n = len(plan.q)
    given = "the given rows and " if plan.given is not None else ""
    text = (
        f"Before: from {given}the stated σ's. "
        f"Random: the median of {count(plan.draws, 'plan')} of {count(n, 'random posture')} that keep clear as well. "
    )
    what = "error at the task" if plan.purpose == "task" else "standard errors (geometric mean)"
    text += f"The {what} would be {_larger(plan.gain)} with random ones." if plan.gain > 1.005 else ""
    return Block("What it brings", (text, Table(("", "before", "planned", "random"), tuple(rows))), "plan_points")


def _larger(gain: float) -> str:
    """A ratio above 1 in words: percent below 2, times from there on."""
    return f"{percent(gain - 1)} larger" if gain < 2 else f"{number(gain, 2)} times as large"


def _stages(plan: MeasurementPlan) -> tuple[ExpectedErrors, ExpectedErrors, ExpectedErrors]:
    """Before, planned and random, in the order of the columns."""
    return plan.before, plan.after, plan.random


def _value(value: float) -> str:
    """A number, or "unknown" where it is not determined."""
    return _UNKNOWN if math.isnan(value) else number(value)


def parameters_block(plan: MeasurementPlan) -> Block:
    """Expected standard errors of every parameter in mrad or mm, at the three stages.

    Parameters that no stage determines, or that are exact already, are left out; what no posture can separate with
    this instrument is named below the table.
    """
    rows = []
    for i, p in enumerate(plan.parameters):
        if is_listed(plan, i):
            factor, unit = ERROR_UNITS[p.unit]
            rows.append((p.name, unit, *(_value(stage.std[i] * factor) for stage in _stages(plan))))
    table = Table(("parameter", "unit", "before", "planned", "random"), tuple(rows), text_columns=2)
    text = f"Expected standard errors; '{_UNKNOWN}': not determined."
    if plan.purpose == "task":
        text += " They are a by-product of a plan for the task: a plan for parameters makes them small."
    words = [sentence(word.replace("was measured", "is measured")) for word in plan.undetermined]
    never = ["No posture can separate these with this instrument:", *words] if words else []
    return Block("Parameters", (text, table, *never), "plan_errors")


def observability_block(plan: MeasurementPlan) -> Block:
    """The observability indices O1 to O5 at the three stages; larger is better.

    Of the singular values σ₁ ≥ … ≥ σₗ of the scaled Jacobian of m rows: O1 ``(σ₁ … σₗ)^(1/l) / sqrt(m)``, O2
    ``σₗ/σ₁``, O3 ``σₗ``, O4 ``σₗ²/σ₁``, O5 ``1 / Σ σ⁻²``.
    """
    names = plan.after.observability
    rows = tuple((f"{n}, {_INDEX_WORDS[n]}", *(_index(s.observability[n]) for s in _stages(plan))) for n in names)
    text = (
        "Indices of the Jacobian of the measurements, scaled so that each parameter moves the tool point equally; "
        "larger is better. O1 weighs all directions, O2 to O5 the worst."
    )
    return Block("Observability", (text, Table(("index", "before", "planned", "random"), rows)))


def _index(value: float) -> str:
    """An index, 0 below a millionth: some combination is not determined."""
    return number(value) if value > _ZERO_INDEX else "0"


def postures_block(plan: MeasurementPlan) -> Block:
    """The postures in order, with the tool point.

    One row a posture: joints [deg or mm] to two decimals and the nominal tool point [mm], world frame. Rows beyond the
    largest number are in ``plan.csv`` only.
    """
    units = [joint_unit(joint.type) for joint in plan.robot.joints]
    headers = [f"{j.name} [{unit}]" for j, (unit, _) in zip(plan.robot.joints, units, strict=True)]
    if (
        len("  ".join([*headers, "no.", *3 * ["-1000.0"]])) > _MAX_HEADER_WIDTH
    ):  # they will be broken: between words, then
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
    more += ["The joints of the second arm, whose tool is touched, stand in plan.csv."] if plan.second else []
    return Block("Postures, in the order of measurement", (*_travel(plan), table, *more))


def _travel(plan: MeasurementPlan) -> list[str]:
    """Joint travel of the tour, the sides of approach, and moves whose straight line in joint space collides."""
    tour = plan.tour
    if len(plan.q) < 2:
        return []
    text = f"Joint travel in this order: {angle(tour.travel)}"
    text += f" (sum of the largest joint motion of each move; {angle(tour.unordered)} as selected)."
    text += f" {_sides(plan)}"
    last = [f"{len(plan.q)} to 1"] if tour.back and plan.repeats > 1 else []
    if not tour.blocked and not last:
        return [f"{text} Straight joint moves between them keep clear of {_clear_of(plan)}."]
    legs = ", ".join([*(f"{k + 1} to {k + 2}" for k in tour.blocked), *last])
    return [f"{text} Straight joint moves collide on the way from {legs}: add via points."]


def _clear_of(plan: MeasurementPlan) -> str:
    """What the moves of a plan were checked against, and that nobody knows what the arm stands on."""
    scene = plan.workspace.scene
    names = listed(["the arm itself", *(obstacle.name for obstacle in scene.obstacles)])
    return names if plan.keeps_height else f"{names} only: what the arm stands on is not stated (cell: mounting)"


def _sides(plan: MeasurementPlan) -> str:
    """From which sides the joints arrive."""
    shares = dict(zip(plan.robot.joint_names, plan.tour.sides, strict=True))
    one_sided = [name for name, share in shares.items() if share in (0.0, 1.0)]
    if one_sided:
        return f"Always approached from the same side: {', '.join(one_sided)}."
    low, high = min(shares.values()), max(shares.values())
    share = f"in positive direction in {percent(low)} to {percent(high)} of the moves"
    return f"Every joint is approached from both sides ({share})."


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

    def document(self) -> Report:
        """The whole report."""
        return measurement_plan_report(self.result)

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
        """The postures in the order of the visit, joints [deg or mm], and the nominal tool point [mm], world frame."""
        plan = self.result
        joints = [(joint.name, *joint_unit(joint.type)) for joint in plan.robot.joints]
        postures = {f"{name} [{unit}]": plan.q[:, k] * factor for k, (name, unit, factor) in enumerate(joints)}
        return {**postures, **{f"{c} [mm]": 1e3 * plan.points[:, k] for k, c in enumerate("xyz")}}

    def files(self) -> Files:
        """``plan.csv`` for the measurement, ``plan_points.csv`` with the tool points for setting up the instrument."""
        return {"plan.csv": self.result.to_csv().encode(), "plan_points.csv": points_csv(self.result).encode()}
