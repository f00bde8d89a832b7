"""The block on the task planned again with the extended arm: what each model would choose, and where that lands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from posture_opt.report.blocks import Block, Facts, Table
from posture_opt.report.diagnosed import MODELS
from posture_opt.report.parts import sentence
from posture_opt.report.replanned_blocks import FIGURE
from posture_opt.report.units_text import joint_value, length, percent
from posture_opt.report.words import PARTS

if TYPE_CHECKING:
    from posture_opt.selection.plan_comparison import Landing, Replanned
    from posture_opt.selection.solution import Solution

_TITLE = "Choose again"
_NOTHING = 1e-7  # m: a miss that the plan corrected for is rounding


def choice_lead(plans: Mapping[str, Replanned]) -> tuple[str, ...]:
    """What it means for the task, in a sentence; nothing where one of the postures is missing."""
    plan = plans.get("nominal")
    if plan is None or plan.landed is None or plan.landing is None:
        return ()
    before, now = plan.landed.critical_error, plan.landing.critical_error
    return (
        f"For the task: with the old model the tool would have come within {length(before)} of its target in 95 of 100 "
        f"visits, with this one within {length(now)}.",
    )


def choice_block(plans: Mapping[str, Replanned], effects: bool = True) -> tuple[Block, ...]:
    """The posture that each model chooses, judged by the extended one; nothing without a task.

    Where it has no ``effects``, the extended arm may be the calibrated one: then it gets no column of its own.
    """
    if not plans:
        return ()
    any_plan = next(iter(plans.values()))
    reasons = tuple(dict.fromkeys(sentence(r) for plan in plans.values() for r in plan.reasons))
    if any_plan.after is None or any_plan.landing is None:
        return (Block(_TITLE, ("The extended arm has no posture for this task.", *reasons)),)
    columns = {name: (plan.before, plan.landed) for name, plan in plans.items()}
    columns["extended"] = (any_plan.after, any_plan.landing)
    items: list[str | Facts | Table] = [*_sentences(columns, PARTS[any_plan.after.critical.within]), *reasons]
    nominal = plans.get("nominal")
    drawn = nominal is not None and nominal.before is not None
    table = _table(columns)
    return (Block(_TITLE, (*items, table if effects else _plain(table)), FIGURE if drawn else ""),)


Columns = Mapping[str, "tuple[Solution | None, Landing | None]"]


def _sentences(columns: Columns, part: str) -> tuple[str, ...]:
    old, new = columns.get("nominal", (None, None))[1], columns["extended"][1]
    assert new is not None
    if old is None:
        return ("The arm as it stood had no posture for this task.",)
    sizes = [old.critical_error]
    return (
        f"With the old model you would have missed the target by {length(old.distance, among=sizes)} {part} in this "
        f"posture, and kept within {length(old.critical_error)} of it in 95 of 100 visits; with this one you keep "
        f"within {length(new.critical_error)}. Every posture is judged by the extended model.",
    )


def _table(columns: Columns) -> Table:
    shown = {name: pair for name, pair in columns.items() if pair[0] is not None}
    first = next(s for s, _ in shown.values() if s is not None)
    rows = [
        (joint.name, *(joint_value(s.q[k], joint.type) for s, _ in shown.values() if s is not None))
        for k, joint in enumerate(first.programme.robot.joints)
    ]
    landings = [landing for _, landing in shown.values()]
    sizes = [g.critical_error for g in landings if g is not None]
    for label, name in (
        ("mean off the target", "distance"),
        ("scatter, largest σ", "sigma_max"),
        ("95 of 100 times within", "critical_error"),
    ):
        rows.append((label, *(_length(math.nan if g is None else float(getattr(g, name)), sizes) for g in landings)))
    odds = [None if g is None else g.success_probability for g in landings]
    if any(p is not None for p in odds):
        rows.append(("meets the clearance", *("" if p is None else _odds(p) for p in odds)))
    return Table(("chosen by the model", *(MODELS[name] for name in shown)), tuple(rows))


def _plain(table: Table) -> Table:
    """The table without the last column if it repeats the one before, else under a name that speaks of no effects."""
    repeats = len(table.headers) > 2 and all(row[-1] == row[-2] for row in table.rows)
    if repeats:
        return Table(table.headers[:-1], tuple(row[:-1] for row in table.rows))
    return Table((*table.headers[:-1], "extended"), table.rows)


def _length(metres: float, among: list[float]) -> str:
    if not math.isfinite(metres):
        return ""
    return length(metres, among=among) if metres > _NOTHING else "0"


def _odds(p: float) -> str:
    return percent(p) if p < 0.9995 else "practically always"
