"""The report on a comparison: which arm scatters least, and how the answers of each are judged by the others."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from posture_opt.report.figures.comparison import plot_comparison
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.parts.comparison_parts import TITLE, comparison_blocks, success_text
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.selection.comparison.comparison_statements import FIRST, is_other_arm
from posture_opt.statements.notation import decimals_of, joint_unit, joint_value, length, length_unit
from posture_opt.units import fixed

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.comparison.comparison import ComparedAnswer, Comparison

_MAX_REASONS = 4
_MAX_POSTURES = 8  # of one answer


class ComparisonPresenter(Presenter["Comparison"]):
    """Several arms, or several models of one arm, at one task."""

    stem = "comparison"

    def summary(self) -> Summary:
        found = self.result
        if not found.reference:
            facts = [(name, _short(name, arm)) for name, arm in found.arms.items()]
            return Summary(f"Comparison: {self.problem.name}", tuple(facts))
        facts = [
            (MODEL_NAMES.get(name, name).capitalize(), _within(column.judged[found.reference].critical_error))
            for name, column in found.answered.items()
        ]
        why = [("No posture", reason) for reason in found.reasons[:_MAX_REASONS]]
        return Summary(f"{TITLE}: {self.problem.name}", (*facts, *why))

    def document(self) -> Document:
        found = self.result
        if found.reference:
            return Document(self.problem.name or TITLE, found.statements, comparison_blocks(found))
        reasons = tuple((name, reason) for name, arm in found.arms.items() for reason in arm.reasons)
        failed = [Block("No answer", (Table(("arm", "because"), reasons, 2),))] if reasons else []
        blocks = (_own_block(found), *_judged_blocks(found), *_posture_blocks(found), *failed)
        return Document(self.problem.name or "Comparison", found.statements, blocks)

    def drawings(self) -> Drawings:
        """Predicted errors of all answers, by the reference or by each arm."""
        if self.result.reference:
            return comparison_drawings(self.result)
        return {"arm_comparison": partial(plot_comparison, self.result)}

    def columns(self) -> Columns:
        """A row for every pair of an arm and one that judges its posture; of models one each, as the reference judges.

        SI units.
        """
        found = self.result
        if found.reference:
            return _plan_columns(found)
        pairs = [(name, judge, plan) for name, arm in found.arms.items() for judge, plan in arm.judged.items()]
        return {
            "planned with": [name for name, _, _ in pairs],
            "judged by": [judge for _, judge, _ in pairs],
            "sigma_max [m]": [plan.sigma_max for *_, plan in pairs],
            "miss [m]": [plan.distance for *_, plan in pairs],
            "critical error [m]": [plan.critical_error for *_, plan in pairs],
            "success probability": [plan.success_probability for *_, plan in pairs],
        }


def comparison_drawings(comparison: Comparison | None) -> Drawings:
    """Predicted error in the posture of each model, where the one before calibration and the reference have one."""
    if comparison is None or not all(comparison.answers_task(name) for name in (comparison.reference, FIRST)):
        return {}
    return {"predicted_error": partial(plot_comparison, comparison)}


def _plan_columns(found: Comparison) -> Columns:
    """The posture of each model, and its error as the reference predicts it, SI units."""
    chosen = found.answered
    judged = [column.judged[found.reference] for column in chosen.values()]
    return {
        "model": list(chosen),
        **{
            f"{name} [rad or m]": [column.stations[0].posture[name] for column in chosen.values()]
            for name in found.problem.robot.joint_names
        },
        "sigma_max [m]": [plan.sigma_max for plan in judged],
        "critical error [m]": [plan.critical_error for plan in judged],
    }


def _short(name: str, arm: ComparedAnswer) -> str:
    if not arm.stations:
        return "cannot do the task"
    own = arm.judged[name]
    return f"σ {length(own.sigma_max)}, {_within(own.critical_error)}"


def _within(radius: float) -> str:
    return f"within {length(radius)} of the target (95 % probability)"


def _own_block(found: Comparison) -> Block:
    unit, factor = _unit(found)
    rows = []
    for name, arm in found.answered.items():
        own = arm.judged[name]
        rows.append(
            (
                name,
                *_numbers((own.sigma_max, own.critical_error), own.sigma_max, factor),
                success_text(own.success_probability),
            )
        )
    headers = ("arm", f"σ [{unit}]", f"95 % within [{unit}]", "success")
    return Block("Each arm in its own posture", (_without_empty(headers, rows),))


def _judged_blocks(found: Comparison) -> tuple[Block, ...]:
    """The postures of all arms as each of them predicts their errors."""
    blocks: list[Block] = []
    unit, factor = _unit(found)
    headers = ("planned with", f"mean error [{unit}]", f"σ [{unit}]", f"95 % within [{unit}]", "success")
    for judge in found.arms:
        rows = []
        for name, arm in found.answered.items():
            if judge in arm.judged and (name == judge or not is_other_arm(found, name, judge)):
                plan = arm.judged[judge]
                sizes = plan.distance, plan.sigma_max, plan.critical_error
                rows.append((name, *_numbers(sizes, plan.sigma_max, factor), success_text(plan.success_probability)))
        if any(row[0] != judge for row in rows):
            figure = "" if blocks else "arm_comparison"
            blocks.append(Block(f"Errors predicted by {judge}", (_without_empty(headers, rows),), figure))
    return tuple(blocks) or (Block("Different arms", (), "arm_comparison"),)


def _unit(found: Comparison) -> tuple[str, float]:
    """The unit of all lengths, by the largest error that an arm predicts for itself."""
    return length_unit([arm.judged[name].critical_error for name, arm in found.answered.items()])


def _numbers(sizes: Sequence[float], sigma: float, factor: float) -> tuple[str, ...]:
    """Lengths with the decimals that give the standard deviation [m] beside them three digits."""
    decimals = decimals_of(sigma * factor, 3)
    return tuple(fixed(size * factor, decimals) for size in sizes)


def _without_empty(headers: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    """The table without columns in which no arm has anything."""
    kept = [k for k in range(len(headers)) if any(row[k] for row in rows)]
    return Table(tuple(headers[k] for k in kept), tuple(tuple(row[k] for k in kept) for row in rows))


def _posture_blocks(found: Comparison) -> tuple[Block, ...]:
    """Joint values: a column an arm where each has one posture of the same joints, else a table an arm."""
    arms = found.answered
    names = {arm.stations[0].optimisation_problem.robot.joint_names for arm in arms.values()}
    if len(names) == 1 and all(len(arm.stations) == 1 for arm in arms.values()):
        columns = [_joint_values(arm.stations[0]) for arm in arms.values()]
        rows = tuple(zip(_joint_heads(next(iter(arms.values()))), *columns, strict=True))
        return (Block("Postures", (Table(("joint", *arms), rows),)),)
    return tuple(_postures_block(name, arm) for name, arm in arms.items())


def _postures_block(name: str, arm: ComparedAnswer) -> Block:
    """The joint values of an answer; of many, the first ones."""
    rows = [(str(k), *_joint_values(station)) for k, station in enumerate(arm.stations[:_MAX_POSTURES], start=1)]
    left = len(arm.stations) - _MAX_POSTURES
    more = (Facts((("More postures", f"{left} in comparison.json"),)),) if left > 0 else ()
    title = "Posture" if len(rows) == 1 else "Postures"
    return Block(f"{title} of {name}", (Table(("posture", *_joint_heads(arm)), tuple(rows)).transposed(), *more))


def _joint_heads(arm: ComparedAnswer) -> list[str]:
    joints = arm.stations[0].optimisation_problem.robot.joints
    return [f"{joint.name} [{joint_unit(joint.type)[0]}]" for joint in joints]


def _joint_values(station: Solution) -> list[str]:
    joints = station.optimisation_problem.robot.joints
    return [joint_value(q, joint.type).split()[0] for q, joint in zip(station.q, joints, strict=True)]
