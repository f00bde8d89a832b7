"""The report on what changed on a calibrated arm: its size, its rivals, and what could be detected."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.errors import enumerated
from posture_opt.report.figures.row_errors import plot_recheck_changes, plot_recheck_rows
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.page.save import Files
from posture_opt.report.parts.parts import note_facts, robot_facts
from posture_opt.report.results.measurement_plan_report import postures_block
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.statements.notation import count, length, percent, shift, stated_length
from posture_opt.units import ERROR_UNITS, number

if TYPE_CHECKING:
    from posture_opt.changes.visibility import Visibility
    from posture_opt.changes.what_changed import LikelyChange, Recheck

_MAX_ROWS = 8
_NO_MOTION_M = 1e-8  # a change that moves the tool less moves it by rounding only


def size_cell(change: LikelyChange) -> str:
    """The size of a change, of a frame with its vector."""
    size = enumerated(map(str, change.sizes))
    mean = change.estimate.mean.tolist()
    return size if len(mean) == 1 else f"{size}: {shift(mean[:3])}"


def changes_block(found: Recheck) -> Block:
    """The likeliest changes with their size, and what each of them moves the tool by."""
    rows = [("unchanged", "", "", percent(found.unchanged))]
    for change in found.changes[:_MAX_ROWS]:
        moved = number(1e3 * change.shift, 2) if change.shift >= _NO_MOTION_M else "0"
        rows.append((change.name, size_cell(change), moved, percent(change.probability)))
    table = Table(("what", "size", "tool moves [mm]", "probability"), tuple(rows), text_columns=2)
    p = found.probabilities
    together = (("No change", p.unchanged), ("One change", p.one), ("More, or unexplained", p.several))
    return Block(
        "What may have changed",
        (table, Facts(tuple((label, f"probability {percent(value)}") for label, value in together))),
        "recheck_changes",
    )


def visible_block(found: Recheck) -> Block:
    """How large each change must be to be detected with a probability of 90 %."""
    rows = tuple(
        (v.name, percent(v.power), number(1e3 * v.shift, 2) if v.seen else "", _size_seen(v)) for v in found.visible
    )
    headers = ("what", "power at 0.1 mm", "seen from [mm]", "seen from")
    text = (
        "Power: probability of detecting a 0.1 mm motion of the tool (RMS); seen from: the size with a power of 90 %."
    )
    return Block("What these rows can show", (text, Table(headers, rows)), "recheck_rows")


def _size_seen(visible: Visibility) -> str:
    """The size from which the change is detected; nothing of a frame, which has several."""
    if not visible.seen:
        return "not seen"
    factor, unit = ERROR_UNITS[visible.unit]
    return f"{number(factor * visible.size, 2)} {unit}".rstrip() if math.isfinite(visible.size) else ""


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

    def summary(self) -> Summary:
        """Verdict, the likeliest change, errors before and after."""
        found, among = self.result, [self.result.before, self.result.after]
        first = found.changes[0]
        facts = (
            ("Verdict", found.verdict),
            ("Unchanged", f"probability {percent(found.unchanged)}"),
            ("Likeliest change", f"{first.name}, {size_cell(first)} ({percent(first.probability)})"),
            ("RMS error", f"{length(among[0], among=among)} before, {length(among[1], among=among)} after"),
        )
        return Summary(f"Recheck with {count(len(found.data), 'row')}: {self.problem.name}", facts)

    def document(self) -> Document:
        """Changes, postures to measure next, what could be detected, data."""
        found = self.result
        further = (postures_block(found.plan),) if found.plan is not None else ()
        blocks = (changes_block(found), *further, visible_block(found), measured_block(found))
        return Document(found.problem.name or "Recheck", found.statements, blocks)

    def drawings(self) -> Drawings:
        """Probabilities of the changes, and the errors of the rows."""
        return {
            "recheck_changes": partial(plot_recheck_changes, self.result),
            "recheck_rows": partial(plot_recheck_rows, self.result),
        }

    def files(self) -> Files:
        """``plan.csv`` with the postures to measure next, where there are some."""
        plan = self.result.plan
        return {} if plan is None else {"plan.csv": plan.to_csv().encode()}

    def delivered(self) -> tuple[str, ...]:
        """``plan.csv`` where it is written."""
        return tuple(self.files())

    def columns(self) -> Columns:
        """Every possible change with its probability and the motion of the tool by it [mm], the likeliest first."""
        changes = self.result.changes
        return {
            "kind": [c.kind for c in changes],
            "target": [c.target for c in changes],
            "probability": [c.probability for c in changes],
            "tool moves [mm]": [1e3 * c.shift for c in changes],
        }
