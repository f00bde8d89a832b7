"""The report on a comparison: which arm scatters least, and how the answers of each are judged by the others."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from posture_opt.report.figures.comparison import plot_comparison
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.parts.collision_parts import mounting_notes
from posture_opt.report.parts.comparison_parts import FIRST, TITLE, comparison_blocks, comparison_lead, success_text
from posture_opt.report.parts.parts import sentence
from posture_opt.report.text.blocks import Block, Report, Summary, Table
from posture_opt.report.text.words import MODEL_NAMES, PARTS
from posture_opt.statements.notation import decimals_of, joint_unit, joint_value, length, length_unit, percent
from posture_opt.units import fixed

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.comparison.comparison import ComparedAnswer, Comparison

_MAX_REASONS = 4
_MAX_POSTURES = 8  # of one answer
_EQUAL = 5e-4  # of a standard deviation: no report shows the difference
_MAX_PERCENT_RATIO = 10.0  # from here on a ratio reads better than percent
_OTHER_ARM_RATIO = 100.0  # times its own error: another arm


class ComparisonPresenter(Presenter["Comparison"]):
    """Several arms, or several models of one arm, at one task."""

    stem = "comparison"

    def summary(self) -> Summary:
        found = self.result
        if not found.reference:
            facts = [(name, _short(name, arm)) for name, arm in found.arms.items()]
            return Summary(f"Comparison: {self.problem.name}", tuple(facts))
        facts = [
            (
                MODEL_NAMES.get(name, name).capitalize(),
                f"within {length(column.judged[found.reference].critical_error)} of the target (95 % probability)",
            )
            for name, column in found.answered.items()
        ]
        why = [("No posture", sentence(reason)) for reason in found.reasons[:_MAX_REASONS]]
        return Summary(f"{TITLE}: {self.problem.name}", (*facts, *why))

    def document(self) -> Report:
        found = self.result
        if found.reference:
            return Report(self.problem.name or TITLE, comparison_lead(found), comparison_blocks(found))
        blocks = (
            _own_block(found),
            *_judged_blocks(found),
            *_posture_blocks(found),
            *(_reasons_block(name, arm) for name, arm in found.arms.items() if arm.reasons),
        )
        return Report(self.problem.name or "Comparison", _lead(found), blocks)

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
    return f"σ {length(own.sigma_max)}, within {length(own.critical_error)} of the target (95 % probability)"


def _lead(found: Comparison) -> tuple[str, ...]:
    """Which arm is best and by how much; then what the postures are worth by the last arm that judges both."""
    answered, best = found.answered, found.best
    assert best is not None, "without any answer there is no comparison"
    part = PARTS[answered[best].stations[0].critical.within]
    least = answered[best].judged[best].sigma_max
    lines = [f"Smallest standard deviation {part}: {length(least)}, with {best}."]
    lines += [
        f"With {name}: {length(arm.judged[name].sigma_max)}{_ratio(arm.judged[name].sigma_max, least)}."
        for name, arm in answered.items()
        if name != best
    ]
    lines += [f"{name} cannot do the task." for name in found.arms if name not in answered]
    answers = {name: arm.answer for name, arm in answered.items() if arm.answer is not None}
    return (*lines, *_cross_lead(found), *mounting_notes(answers))


def _ratio(sigma: float, least: float) -> str:
    """How much that is beside the least, after a comma; nothing beside one of zero."""
    if sigma <= least * (1 + _EQUAL):
        return ", the same"
    if not least > 0:
        return ""
    ratio = sigma / least
    return f", {percent(ratio - 1)} more" if ratio < _MAX_PERCENT_RATIO else f", {ratio:,.0f} times as much"


def _cross_lead(found: Comparison) -> tuple[str, ...]:
    """What the last arm predicts of the posture of the first: the use of knowing the arm better."""
    (first, arm), *_, (last, other) = found.arms.items()
    if last not in arm.judged or not other.stations or _another_arm(found, first, last):
        return ()
    before, after = arm.judged[last].critical_error, other.judged[last].critical_error
    return (
        f"If {last} describes the arm: planned with {first}, the tool stays within {length(before)} of the target "
        f"(95 % probability); planned with {last}, within {length(after, among=[before])}.",
    )


def _another_arm(found: Comparison, name: str, judge: str) -> bool:
    """Whether the posture of one arm means nothing to the other: it misses by far more than the arm errs."""
    arm = found.arms[name]
    return judge in arm.judged and arm.judged[judge].distance > _OTHER_ARM_RATIO * arm.judged[name].critical_error


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
    return Block("Each arm in its own posture", (_without_empty(headers, rows), *found.notes))


def _judged_blocks(found: Comparison) -> tuple[Block, ...]:
    """The postures of all arms as each of them predicts their errors."""
    blocks, sentences = [], []
    unit, factor = _unit(found)
    for judge in found.arms:
        others = [name for name, arm in found.answered.items() if judge in arm.judged and name != judge]
        far = [name for name in others if _another_arm(found, name, judge)]
        sentences += [
            f"In the posture of {name}, {judge} misses the target by {length(found.arms[name].judged[judge].distance)}."
            for name in far
        ]
        rows = []
        for name, arm in found.answered.items():
            if name == judge or name in set(others) - set(far):
                plan = arm.judged[judge]
                sizes = plan.distance, plan.sigma_max, plan.critical_error
                rows.append((name, *_numbers(sizes, plan.sigma_max, factor), success_text(plan.success_probability)))
        headers = ("planned with", f"mean error [{unit}]", f"σ [{unit}]", f"95 % within [{unit}]", "success")
        if set(others) - set(far):
            blocks.append(Block(f"Errors predicted by {judge}", (_without_empty(headers, rows),)))
    if sentences:
        blocks.append(Block("Different arms", tuple(sentences)))
    if not blocks:
        return (Block("Different arms", ("The arms have different joints: no posture fits the other.",)),)
    return (Block(blocks[0].title, blocks[0].items, "arm_comparison"), *blocks[1:])


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
    more = (f"{left} more postures are in comparison.json.",) if left > 0 else ()
    title = "Posture" if len(rows) == 1 else "Postures"
    return Block(f"{title} of {name}", (Table(("posture", *_joint_heads(arm)), tuple(rows)).transposed(), *more))


def _joint_heads(arm: ComparedAnswer) -> list[str]:
    joints = arm.stations[0].optimisation_problem.robot.joints
    return [f"{joint.name} [{joint_unit(joint.type)[0]}]" for joint in joints]


def _joint_values(station: Solution) -> list[str]:
    joints = station.optimisation_problem.robot.joints
    return [joint_value(q, joint.type).split()[0] for q, joint in zip(station.q, joints, strict=True)]


def _reasons_block(name: str, arm: ComparedAnswer) -> Block:
    return Block(f"Why {name} cannot do the task", tuple(sentence(reason) for reason in arm.reasons))
