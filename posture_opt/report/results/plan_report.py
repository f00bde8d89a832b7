"""Reports on what to measure next, and on what changed on a calibrated arm.

A plan compares three stages: before (stated σ's and given rows), planned, and random (the median of plans of as many
random postures under the same requirements).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.errors import enumerated
from posture_opt.report.figures.errors import plot_recheck_changes, plot_recheck_rows
from posture_opt.report.figures.plan import plot_plan_errors, plot_plan_points
from posture_opt.report.page.presenter import Columns, Plots, Presenter, problem_of
from posture_opt.report.page.save import Files
from posture_opt.report.parts import parts
from posture_opt.report.parts.parts import clear_words, note_facts, robot_facts
from posture_opt.report.scene.arm_view import ArmView, ShownPosture
from posture_opt.report.text.blocks import Block, Facts, Summary, Table
from posture_opt.statements.notation import (
    angle,
    angle_error,
    count,
    length,
    percent,
    place,
    shift,
    stated_length,
)
from posture_opt.units import ERROR_UNITS, fixed, number

if TYPE_CHECKING:
    from posture_opt import MeasurementPlan, Recheck
    from posture_opt.changes.what_changed import LikelyChange
    from posture_opt.experiments.information import ExpectedErrors

_MAX_ROWS = 60
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
    # Reported from 1.1 times the instrument's σ on.
    if plan.spread > 1.1:
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
    return plan.before, plan.after, plan.random


def _value(value: float) -> str:
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
    """The observability indices O1 to O5 at the three stages. Of the singular values σ₁ ≥ … ≥ σₗ of the scaled Jacobian
    of m rows: O1 ``(σ₁ … σₗ)^(1/l) / sqrt(m)``, O2 ``σₗ/σ₁``, O3 ``σₗ``, O4 ``σₗ²/σ₁``, O5 ``1 / Σ σ⁻²``."""
    names = plan.after.observability
    rows = tuple(
        (f"{n}, {_INDEX_WORDS[n]}", *(number(v) if (v := s.observability[n]) > 1e-6 else "0" for s in _stages(plan)))
        for n in names
    )
    text = "Of the Jacobian, scaled so that each parameter moves the tool point equally; larger is better."
    return Block("Observability", (text, Table(("index", *_STAGES), rows)), brief=())


def postures_block(plan: MeasurementPlan) -> Block:
    """The postures in order: joints [deg or mm], nominal tool point [mm]; those beyond the table are in the file."""
    headers = parts.joint_heads(plan.robot)
    if len("  ".join([*headers, "no.", *3 * ["-1000.0"]])) > 100:  # they are broken between words
        headers = [head.replace("_", " ") for head in headers]
    what = {name: cells for name, cells in (("instrument", plan.instruments), ("at", plan.places)) if any(cells)}
    rows = tuple(
        (str(k + 1), *parts.joint_cells(plan.robot, q, 2), *(fixed(float(v), 1) for v in 1e3 * point),
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
    title = "Measurement plan"
    plots: ClassVar[Plots] = {"plan_points": plot_plan_points, "plan_errors": plot_plan_errors}
    delivers: ClassVar[tuple[str, ...]] = ("plan.csv",)

    def summary(self) -> Summary:
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

    def blocks(self) -> Iterable[Block]:
        makers = (gain_block, postures_block, parameters_block, planned_block, observability_block)
        return (make(self.result) for make in makers)

    def view(self) -> ArmView:
        """The planned postures in the order of the tour."""
        plan = self.result
        every = enumerate(zip(plan.q, (place(point) for point in plan.points), strict=True), 1)
        postures = (ShownPosture(f"posture-{k}", f"posture {k}", q, (("Tool point", at),)) for k, (q, at) in every)
        scene = getattr(plan.problem, "scene", None)
        return ArmView(plan.robot, tuple(postures), "Posture", scene, points=True, line=True)

    def columns(self) -> Columns:
        return {**parts.joint_columns(self.result.robot, self.result.q), **parts.point_columns(self.result.points)}

    def files(self) -> Files:
        return {"plan.csv": self.result.to_csv().encode(), "plan_points.csv": points_csv(self.result).encode()}


def size_cell(change: LikelyChange) -> str:
    """The size of a change, of a frame with its vector."""
    size = enumerated(map(str, change.sizes))
    mean = change.estimate.mean.tolist()
    return size if len(mean) == 1 else f"{size}: {shift(mean[:3])}"


def changes_block(found: Recheck) -> Block:
    """The likeliest changes with their size, and what each of them moves the tool by."""
    rows, p = [("unchanged", "", "", percent(found.unchanged))], found.probabilities
    for change in found.changes[:8]:
        # Less than 1e-8 m is rounding.
        moved = number(1e3 * change.shift, 2) if change.shift >= 1e-8 else "0"
        rows.append((change.name, size_cell(change), moved, percent(change.probability)))
    table = Table(("what", "size", "tool moves [mm]", "probability"), tuple(rows), text_columns=2)
    together = {"No change": p.unchanged, "One change": p.one, "More, or unexplained": p.several}
    facts = tuple((label, f"probability {percent(value)}") for label, value in together.items())
    return Block("What may have changed", (table, Facts(facts)), "recheck_changes")


def visible_block(found: Recheck) -> Block:
    """How large each change must be to be detected with a probability of 90 %; of a frame, which has several sizes, the
    motion alone."""
    rows = []
    for v in found.visible:
        factor, unit = ERROR_UNITS[v.unit]
        size = f"{number(factor * v.size, 2)} {unit}".rstrip() if math.isfinite(v.size) else ""
        seen = (number(1e3 * v.shift, 2), size) if v.seen else ("", "not seen")
        rows.append((v.name, percent(v.power), *seen))
    headers = ("what", "power at 0.1 mm", "seen from [mm]", "seen from")
    power = "Power: probability of detecting a 0.1 mm motion of the tool (RMS)"
    text = f"{power}; seen from: the size with a power of 90 %."
    return Block("What these rows can show", (text, Table(headers, tuple(rows))), "recheck_rows")


def measured_block(found: Recheck) -> Block:
    """Rows, instrument, and the arm that was held against them."""
    sigma = position_sigma(found.problem, found.data)
    facts = (
        ("Measured", f"{count(len(found.data), 'row')} ({Path(found.data.file).name or 'table'})"),
        ("Instrument", f"σ {stated_length(sigma)} per coordinate" if sigma else "no σ stated"),
        *robot_facts(found.problem),
        *note_facts(found.notes),
    )
    return Block("Data", (Facts(facts),))


class RecheckPresenter(Presenter["Recheck"]):
    """What changed on a calibrated arm."""

    stem = "recheck"
    title = "Recheck"
    plots: ClassVar[Plots] = {"recheck_changes": plot_recheck_changes, "recheck_rows": plot_recheck_rows}

    def summary(self) -> Summary:
        found, among = self.result, [self.result.before, self.result.after]
        first = found.changes[0]
        facts = (
            ("Verdict", found.verdict),
            ("Unchanged", f"probability {percent(found.unchanged)}"),
            ("Likeliest change", f"{first.name}, {size_cell(first)} ({percent(first.probability)})"),
            ("RMS error", f"{length(among[0], among=among)} before, {length(among[1], among=among)} after"),
        )
        return Summary(f"Recheck with {count(len(found.data), 'row')}: {self.problem.name}", facts)

    def blocks(self) -> Iterable[Block]:
        found = self.result
        further = () if found.plan is None else (postures_block(found.plan),)
        return changes_block(found), *further, visible_block(found), measured_block(found)

    def files(self) -> Files:
        plan = self.result.plan
        return {} if plan is None else {"plan.csv": plan.to_csv().encode()}

    def delivered(self) -> tuple[str, ...]:
        return tuple(self.files())

    def columns(self) -> Columns:
        changes = self.result.changes
        named = {name: [getattr(c, name) for c in changes] for name in ("kind", "target", "probability")}
        return {**named, "tool moves [mm]": [1e3 * c.shift for c in changes]}
