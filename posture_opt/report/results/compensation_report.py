"""The report on compensated targets: how far off they were, what is left, and by how much the joints changed.

"Off" is the expected error of the joint values as given, by what is known of the arm; "left" what remains of it after
compensation together with what is uncertain.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.model.arm_state import REFERENCE_TEMPERATURE
from posture_opt.numerics import Array, rms
from posture_opt.report.figures.errors import plot_compensation
from posture_opt.report.figures.residuals import chosen_rows
from posture_opt.report.page.presenter import Columns, Plots, Presenter
from posture_opt.report.page.save import Files
from posture_opt.report.parts.parts import distance_facts, note_facts, robot_facts
from posture_opt.report.scene.arm_view import VIEWED_ROWS, ArmView, ShownPosture
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.statements.notation import angle, count, length, length_unit
from posture_opt.units import ERROR_UNITS, number

if TYPE_CHECKING:
    from posture_opt.compensation.compensation import Compensation
    from posture_opt.selection.problem_data import ProblemData

_MAX_ROWS = 40
_ORIGINS = {
    "given": "given; the compensated ones stay as near to them as the target allows",
    "given as targets": "given, and the targets are where the nominal arm would be with them",
    "first row": "none were given: near the first row, with its tool axis and further requirements",
    "task": "none were given: near the posture of the task, with its tool axis and further requirements",
}


def gain_blocks(problem: ProblemData, found: Compensation) -> tuple[Block, Block]:
    """Errors before and after, in position and orientation; what the arm is computed with."""
    unit, factor = length_unit([rms(found.off), rms(found.left)])
    sizes = [("position, RMS", rms), ("position, largest", lambda v: float(np.max(v)))]
    rows = [(f"{label} [{unit}]", *_numbers([f(v) for v in (found.off, found.left)], factor)) for label, f in sizes]
    if found.oriented:
        factor, unit = ERROR_UNITS["rad"]
        turned = (found.before.turned, found.after.rms_turned)
        rows.append((f"orientation, RMS [{unit}]", *(number(factor * rms(v), 2) for v in turned)))
    table = Table(("", "as given", "compensated"), tuple(rows))
    changes = []
    for joint, v in zip(found.problem.robot.joints, np.abs(found.q - found.near).max(axis=0), strict=True):
        # The largest change over the rows; zero below the digits that are written.
        turns = joint.type == "revolute"
        size = 0.0 if v < (found.digits.turn if turns else found.digits.slide) else float(v)
        changes.append(f"{joint.name} {angle(size) if turns else length(size)}")
    facts = (
        *robot_facts(problem),
        *_computed_for(found),
        ("Joints", _ORIGINS[found.origin]),
        ("Largest change", ", ".join(changes)),
        *distance_facts(problem.scene, found.clearance),
        *note_facts(problem.sources.notes),
    )
    return Block("Before and after", (table,), "compensation"), Block("Problem", (Facts(facts),))


def _numbers(metres: Sequence[float], factor: float) -> list[str]:
    largest = factor * max(metres)
    return [number(factor * value, 3, largest) if value > 1e-9 else "0" for value in metres]


def _computed_for(found: Compensation) -> list[tuple[str, str]]:
    arm, rows = found.problem.arm, found.targets
    asked = {need for effect in arm.effects for need in (*effect.asks, *effect.needs)}
    texts = []
    if asked & {"masses", "payload"}:
        texts.append(f"a payload of {_range(rows.payload, arm.inputs.payload)} kg")
    if "temperature" in asked:
        texts.append(f"{_range(rows.temperature, REFERENCE_TEMPERATURE + arm.inputs.temperature)} degC")
    if "approach" in asked:
        stated = "the columns of the file, else " if bool(np.any(rows.side)) else ""
        texts.append(f"the side of arrival from {stated}the row before")
    return [("Computed for", ", ".join(texts))] if texts else []


def _range(values: Array | None, stated: float) -> str:
    low, high = (stated, stated) if values is None else (float(np.min(values)), float(np.max(values)))
    return f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"


def rows_block(found: Compensation) -> Block:
    """The rows with their compensated joint values."""
    unit, factor = length_unit([rms(found.off), rms(found.left)])
    headers = ("line", *(head for _, head, _ in found.headers), f"off [{unit}]", f"left [{unit}]")
    rows = tuple(
        (
            str(found.targets.line[k]),
            *(found.digits.text(joint, v, f) for (joint, _, f), v in zip(found.headers, found.q[k], strict=True)),
            *_numbers([float(v[k]) for v in (found.off, found.left)], factor),
        )
        for k in range(min(len(found), _MAX_ROWS))
    )
    more = [Facts((("More rows", f"{len(found) - _MAX_ROWS} in compensated.csv"),))] if len(found) > _MAX_ROWS else []
    views = tuple(f"line-{row[0]}" for row in rows)
    return Block("Compensated joint values", (Table(headers, rows, text_columns=0, views=views), *more))


class CompensationPresenter(Presenter["Compensation"]):
    """Compensated targets; ``compensated.csv`` has the joint values to command."""

    stem = "compensation"
    plots: ClassVar[Plots] = {"compensation": plot_compensation}
    delivers: ClassVar[tuple[str, ...]] = ("compensated.csv",)

    def summary(self) -> Summary:
        found = self.result
        among = [rms(found.off), rms(found.left)]
        turned = [("Orientation left", f"{angle(rms(found.after.rms_turned))} (RMS)")] if found.oriented else []
        facts = (
            ("As given", f"{length(among[0], among=among)} off (RMS)"),
            ("Compensated", f"{length(among[1], among=among)} expected (RMS)"),
            *turned,
            ("Largest change", angle(float(np.abs(found.q - found.near).max()))),
        )
        return Summary(f"{count(len(found), 'compensated target')}: {found.problem.name}", facts)

    def document(self) -> Document:
        found, name = self.result, self.problem.name
        title = f"Compensated targets: {name}" if name else "Compensated targets"
        return Document(title, found.statements, (*gain_blocks(self.problem, found), rows_block(found)))

    def view(self) -> ArmView:
        """The compensated rows, coloured by what is left of their error."""
        found, postures = self.result, []
        for k in chosen_rows(len(found), VIEWED_ROWS):
            off, left, line = float(found.off[k]), float(found.left[k]), found.targets.line[k]
            facts = (("Off as given", length(off)), ("Left", length(left)))
            shown = ShownPosture(f"line-{line}", f"line {line}: {length(left)} left", found.q[k], facts)
            postures.append((shown, left))
        return ArmView.coloured(found.problem, "Target", postures, "left")

    def columns(self) -> Columns:
        found = self.result
        joints = {head: found.q[:, j] / factor for j, (_, head, factor) in enumerate(found.headers)}
        errors = {"off [mm]": 1e3 * found.off, "left [mm]": 1e3 * found.left}
        return {"line": found.targets.line.tolist(), **joints, **errors}

    def files(self) -> Files:
        return {"compensated.csv": self.result.to_csv().encode()}
