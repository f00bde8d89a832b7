"""The report on a comparison of arms: which one scatters least, its postures, and how each is judged by the other."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from posture_opt.report.figures.arm_comparison import plot_arm_comparison
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.parts.parts import sentence
from posture_opt.report.text.blocks import Block, Report, Summary, Table
from posture_opt.report.text.units_text import decimals_of, joint_unit, joint_value, length, length_unit, percent
from posture_opt.report.text.words import PARTS
from posture_opt.units import fixed

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.comparison.arm_comparison import ArmComparison, ComparedArm, JudgedPlan

_SHOWN = 8  # postures of one answer
_SAME = 5e-4  # of a standard deviation: what no report tells apart
_TIMES = 10.0  # from here on a ratio reads better than percent
_FAR = 100.0  # times its own error: another arm
_CERTAIN = 0.9995


class ArmComparisonPresenter(Presenter["ArmComparison"]):
    """Several arms, or several models of one arm, at one task."""

    document = "comparison"

    def summary(self) -> Summary:
        facts = [(name, _short(name, arm)) for name, arm in self.result.arms.items()]
        return Summary(f"Comparison: {self.problem.name}", tuple(facts))

    def report(self) -> Report:
        found = self.result
        blocks = (
            _own_block(found),
            *_judged_blocks(found),
            *_posture_blocks(found),
            *(_reasons_block(name, arm) for name, arm in found.arms.items() if arm.reasons),
        )
        return Report(self.problem.name or "Comparison", _lead(found), blocks)

    def drawings(self) -> Drawings:
        """Where the postures of all arms land, as each of them predicts it."""
        return {"arm_comparison": partial(plot_arm_comparison, self.result)}

    def columns(self) -> Columns:
        """A row for every pair of an arm and one that judges its posture, SI units."""
        pairs = [(name, judge, plan) for name, arm in self.result.arms.items() for judge, plan in arm.judged.items()]
        return {
            "planned with": [name for name, _, _ in pairs],
            "judged by": [judge for _, judge, _ in pairs],
            "sigma_max [m]": [plan.sigma_max for *_, plan in pairs],
            "miss [m]": [plan.distance for *_, plan in pairs],
            "critical error [m]": [plan.critical_error for *_, plan in pairs],
            "success probability": [plan.success_probability for *_, plan in pairs],
        }


def _short(name: str, arm: ComparedArm) -> str:
    if not arm.stations:
        return "cannot do the task"
    own = arm.judged[name]
    return f"σ {length(own.sigma_max)}, within {length(own.critical_error)} of the target (95 % probability)"


def _lead(found: ArmComparison) -> tuple[str, ...]:
    """Which arm is best and by how much; then what the postures are worth by the last arm that judges both."""
    answered, best = found.answered, found.best
    assert best is not None, "without any answer there is no comparison"
    part = PARTS[answered[best].stations[0].critical.within]
    least = answered[best].judged[best].sigma_max
    lines = [f"Smallest standard deviation {part}: {length(least)}, with {best}."]
    lines += [
        f"With {name}: {length(arm.judged[name].sigma_max)}, {_ratio(arm.judged[name].sigma_max, least)}."
        for name, arm in answered.items()
        if name != best
    ]
    lines += [f"{name} cannot do the task." for name in found.arms if name not in answered]
    return (*lines, *_cross_lead(found))


def _ratio(sigma: float, least: float) -> str:
    if sigma <= least * (1 + _SAME):
        return "the same"
    ratio = sigma / least if least > 0 else float("inf")
    return f"{percent(ratio - 1)} more" if ratio < _TIMES else f"{ratio:,.0f} times as much"


def _cross_lead(found: ArmComparison) -> tuple[str, ...]:
    """What the last arm predicts of the posture of the first: the use of knowing the arm better."""
    (first, arm), *_, (last, other) = found.arms.items()
    if last not in arm.judged or not other.stations or _another_arm(found, first, last):
        return ()
    before, after = arm.judged[last].critical_error, other.judged[last].critical_error
    return (
        f"If {last} describes the arm: planned with {first}, the tool stays within {length(before)} of the target "
        f"(95 % probability); planned with {last}, within {length(after, among=[before])}.",
    )


def _another_arm(found: ArmComparison, name: str, judge: str) -> bool:
    """Whether the posture of one arm means nothing to the other: it misses by far more than the arm errs."""
    arm = found.arms[name]
    return judge in arm.judged and arm.judged[judge].distance > _FAR * arm.judged[name].critical_error


def _own_block(found: ArmComparison) -> Block:
    unit, factor = _unit(found)
    rows = []
    for name, arm in found.answered.items():
        own = arm.judged[name]
        rows.append((name, *_numbers((own.sigma_max, own.critical_error), own.sigma_max, factor), _success(own)))
    headers = ("arm", f"σ [{unit}]", f"95 % within [{unit}]", "success")
    return Block("Each arm in its own posture", (_without_empty(headers, rows), *found.notes))


def _judged_blocks(found: ArmComparison) -> tuple[Block, ...]:
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
                rows.append((name, *_numbers(sizes, plan.sigma_max, factor), _success(plan)))
        headers = ("planned with", f"mean error [{unit}]", f"σ [{unit}]", f"95 % within [{unit}]", "success")
        if set(others) - set(far):
            blocks.append(Block(f"Errors predicted by {judge}", (_without_empty(headers, rows),)))
    if sentences:
        blocks.append(Block("Different arms", tuple(sentences)))
    if not blocks:
        return (Block("Different arms", ("The arms have different joints: no posture fits the other.",)),)
    return (Block(blocks[0].title, blocks[0].items, "arm_comparison"), *blocks[1:])


def _unit(found: ArmComparison) -> tuple[str, float]:
    """The unit of all lengths, by the largest error that an arm predicts for itself."""
    return length_unit([arm.judged[name].critical_error for name, arm in found.answered.items()])


def _numbers(sizes: Sequence[float], sigma: float, factor: float) -> tuple[str, ...]:
    """Lengths with the decimals that give the standard deviation [m] beside them three digits."""
    decimals = decimals_of(sigma * factor, 3)
    return tuple(fixed(size * factor, decimals) for size in sizes)


def _success(plan: JudgedPlan) -> str:
    p = plan.success_probability
    return "" if p is None else percent(p) if p < _CERTAIN else "> 99.9 %"


def _without_empty(headers: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    """The table without columns in which no arm has anything."""
    kept = [k for k in range(len(headers)) if any(row[k] for row in rows)]
    return Table(tuple(headers[k] for k in kept), tuple(tuple(row[k] for k in kept) for row in rows))


def _posture_blocks(found: ArmComparison) -> tuple[Block, ...]:
    """Joint values: a column an arm where each has one posture of the same joints, else a table an arm."""
    arms = found.answered
    names = {arm.stations[0].optimisation_problem.robot.joint_names for arm in arms.values()}
    if len(names) == 1 and all(len(arm.stations) == 1 for arm in arms.values()):
        columns = [_joint_values(arm.stations[0]) for arm in arms.values()]
        rows = tuple(zip(_joint_heads(next(iter(arms.values()))), *columns, strict=True))
        return (Block("Postures", (Table(("joint", *arms), rows),)),)
    return tuple(_postures_block(name, arm) for name, arm in arms.items())


def _postures_block(name: str, arm: ComparedArm) -> Block:
    """The joint values of an answer; of many, the first ones."""
    rows = [(str(k), *_joint_values(station)) for k, station in enumerate(arm.stations[:_SHOWN], start=1)]
    left = len(arm.stations) - _SHOWN
    more = (f"{left} more postures are in comparison.json.",) if left > 0 else ()
    title = "Posture" if len(rows) == 1 else "Postures"
    return Block(f"{title} of {name}", (Table(("posture", *_joint_heads(arm)), tuple(rows)).transposed(), *more))


def _joint_heads(arm: ComparedArm) -> list[str]:
    joints = arm.stations[0].optimisation_problem.robot.joints
    return [f"{joint.name} [{joint_unit(joint.type)[0]}]" for joint in joints]


def _joint_values(station: Solution) -> list[str]:
    joints = station.optimisation_problem.robot.joints
    return [joint_value(q, joint.type).split()[0] for q, joint in zip(station.q, joints, strict=True)]


def _reasons_block(name: str, arm: ComparedArm) -> Block:
    return Block(f"Why {name} cannot do the task", tuple(sentence(reason) for reason in arm.reasons))
