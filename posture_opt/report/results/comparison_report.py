"""The report on a comparison: which arm scatters least, and how the answers of each are judged by the others."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING

from posture_opt.report.figures.errors import plot_comparison
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.parts.model_tables import TITLE, comparison_blocks, success_text
from posture_opt.report.parts.parts import joint_cells, joint_heads
from posture_opt.report.text.blocks import Block, Document, Facts, Summary, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.selection.comparison.comparison import FIRST, is_other_arm
from posture_opt.statements.notation import decimals_of, length, length_unit
from posture_opt.units import fixed

if TYPE_CHECKING:
    from posture_opt import Comparison
    from posture_opt.selection.comparison.predicted_error import JudgedAnswer

_MAX_POSTURES = 8  # of one answer


class ComparisonPresenter(Presenter["Comparison"]):
    """Several arms, or several models of one arm, at one task."""

    stem = "comparison"

    def summary(self) -> Summary:
        found, radius = self.result, "within {} of the target (95 % probability)"
        if found.reference:
            facts = [
                (
                    MODEL_NAMES.get(name, name).capitalize(),
                    radius.format(length(column.judged[found.reference].critical_error)),
                )
                for name, column in found.answered.items()
            ]
            why = [("No posture", reason) for reason in found.reasons[:4]]
            return Summary(f"{TITLE}: {self.problem.name}", (*facts, *why))
        facts = []
        for name, arm in found.arms.items():
            own = arm.judged[name] if arm.stations else None
            says = "" if own is None else f"σ {length(own.sigma_max)}, {radius.format(length(own.critical_error))}"
            facts.append((name, says or "cannot do the task"))
        return Summary(f"Comparison: {self.problem.name}", tuple(facts))

    def document(self) -> Document:
        title = TITLE if self.result.reference else "Comparison"
        return Document(self.problem.name or title, self.result.statements, tuple(self.blocks()))

    def blocks(self) -> Iterable[Block]:
        found = self.result
        if found.reference:
            return comparison_blocks(found)
        reasons = tuple((name, reason) for name, arm in found.arms.items() for reason in arm.reasons)
        failed = [Block("No answer", (Table(("arm", "because"), reasons, 2),))] if reasons else []
        return *_judged_blocks(found), *_posture_blocks(found), *failed

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
            chosen, robot = found.answered, found.problem.robot
            judged = [column.judged[found.reference] for column in chosen.values()]
            postures = [column.stations[0].posture for column in chosen.values()]
            return {
                "model": list(chosen),
                **{f"{name} [rad or m]": [posture[name] for posture in postures] for name in robot.joint_names},
                "sigma_max [m]": [plan.sigma_max for plan in judged],
                "critical error [m]": [plan.critical_error for plan in judged],
            }
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


def _judged_blocks(found: Comparison) -> Iterable[Block]:
    """Each arm in its own posture, and the postures of all arms as each of them predicts their errors."""
    # The unit of all lengths is that of the largest error that an arm predicts for itself.
    unit, factor = length_unit([arm.judged[name].critical_error for name, arm in found.answered.items()])
    headers = ("planned with", f"mean error [{unit}]", f"σ [{unit}]", f"95 % within [{unit}]", "success")

    def row(name: str, plan: JudgedAnswer) -> tuple[str, ...]:
        # The standard deviation has three digits, lengths beside it as many decimals.
        decimals, sizes = decimals_of(plan.sigma_max * factor, 3), (plan.distance, plan.sigma_max, plan.critical_error)
        return (name, *(fixed(size * factor, decimals) for size in sizes), success_text(plan.success_probability))

    own = [row(name, arm.judged[name]) for name, arm in found.answered.items()]
    heads = ("arm", *headers[2:])
    yield Block("Each arm in its own posture", (_without_empty(heads, [(one[0], *one[2:]) for one in own]),))
    figure = "arm_comparison"
    for judge in found.arms:
        rows = [
            row(name, arm.judged[judge])
            for name, arm in found.answered.items()
            if judge in arm.judged and (name == judge or not is_other_arm(found, name, judge))
        ]
        if any(one[0] != judge for one in rows):
            yield Block(f"Errors predicted by {judge}", (_without_empty(headers, rows),), figure)
            figure = ""
    if figure:
        yield Block("Different arms", (), figure)


def _without_empty(headers: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    kept = [k for k in range(len(headers)) if any(row[k] for row in rows)]
    return Table(tuple(headers[k] for k in kept), tuple(tuple(row[k] for k in kept) for row in rows))


def _posture_blocks(found: Comparison) -> Iterable[Block]:
    """Joint values: a column an arm where each has one posture of the same joints, else a table an arm."""
    arms = found.answered
    robots = {name: arm.stations[0].optimisation_problem.robot for name, arm in arms.items()}
    values = {name: [joint_cells(robots[name], s.q, 2) for s in arm.stations] for name, arm in arms.items()}
    if len({robot.joint_names for robot in robots.values()}) == 1 and all(len(v) == 1 for v in values.values()):
        rows = zip(joint_heads(next(iter(robots.values()))), *(v[0] for v in values.values()), strict=True)
        yield Block("Postures", (Table(("joint", *arms), tuple(rows)),))
        return
    for name, postures in values.items():
        shown = tuple((str(k), *cells) for k, cells in enumerate(postures[:_MAX_POSTURES], start=1))
        left = len(postures) - _MAX_POSTURES
        more = (Facts((("More postures", f"{left} in comparison.json"),)),) if left > 0 else ()
        table = Table(("posture", *joint_heads(robots[name])), shown).transposed()
        yield Block(f"{'Posture' if len(shown) == 1 else 'Postures'} of {name}", (table, *more))
