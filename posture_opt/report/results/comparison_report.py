"""The comparison of models of one arm in a report: what each chooses for the task, and where that lands."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from posture_opt.report.figures.comparison import plot_landing
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.parts.comparison_parts import open_lead, parts_sentences
from posture_opt.report.parts.parts import sentence
from posture_opt.report.text.blocks import Block, Report, Summary, Table
from posture_opt.report.text.units_text import joint_value, length, percent
from posture_opt.report.text.words import MODEL_NAMES, PARTS

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.selection.comparison.plan_comparison import Comparison, PredictedError

_TITLE = "Comparison of plans"
_FIRST = "nominal"
_TOLD = 4  # reasons
_HARDLY = 0.7  # of the error before: a gain that hardly shows at the task
_NOTHING = 1e-7  # m: a miss that the plan corrected for is rounding
_MODELS = {
    "nominal": "the model before calibration",
    "calibrated": "the calibrated model",
    "extended": "the extended model",
    "delivered": "the delivered model",
}
Answers = dict[str, "tuple[Solution, PredictedError]"]


def comparison_lead(comparison: Comparison | None) -> tuple[str, ...]:
    """What it means for the task, in a sentence; nothing where one of the postures is missing."""
    columns = {} if comparison is None else comparison.answered
    if comparison is None or _FIRST not in columns or comparison.reference not in columns:
        return ()
    before, now = (columns[name][1].critical_error for name in (_FIRST, comparison.reference))
    lead = (
        f"Task: 95 % error radius {_length(before, [before, now])} with the posture planned before calibration, "
        f"{_length(now, [before, now])} with the posture planned with {_MODELS[comparison.reference]}."
    )
    return (lead, *open_lead(comparison, told=now > _HARDLY * before))


def comparison_blocks(comparison: Comparison | None, names: Mapping[str, str] = MODEL_NAMES) -> tuple[Block, ...]:
    """The posture of each model, its predicted errors, or why there is none; nothing without a task.

    Args:
        comparison: of named models; ``names`` heads their columns.
    """
    if comparison is None:
        return ()
    reasons, judge = tuple(sentence(reason) for reason in comparison.reasons), _MODELS[comparison.reference]
    if comparison.reference not in comparison.answered:
        return (Block(_TITLE, (f"{_capital(judge)} has no posture for this task.", *reasons)),)
    columns = distinct_columns(comparison)
    items: tuple[str | Table, ...] = (
        *_sentences(columns, comparison.reference),
        *parts_sentences(comparison),
        *reasons,
        comparison_table(columns, names),
    )
    return (Block(_TITLE, items, "predicted_error" if _FIRST in columns else ""),)


def distinct_columns(comparison: Comparison) -> Answers:
    """The answers by the name of the model; one that repeats the one before it in the table is left out."""
    columns: Answers = {}
    for name, answer in comparison.answered.items():
        former = next(reversed(columns.values()), None)
        if former is None or _cells(former, [former[1].critical_error]) != _cells(answer, [former[1].critical_error]):
            columns[name] = answer
    return columns


def comparison_table(columns: Answers, names: Mapping[str, str] = MODEL_NAMES) -> Table:
    """A column a model: joints, σ as itself and as the reference predicts it, errors, probability of success."""
    sizes = [predicted_error.critical_error for _, predicted_error in columns.values()]
    cells = [_cells(answer, sizes) for answer in columns.values()]
    first = next(solution for solution, _ in columns.values())
    labels = [joint.name for joint in first.optimisation_problem.robot.joints]
    labels += ["largest σ, as planned", "largest σ, as judged", "mean error"]
    labels += [
        "95 % error radius",
        "scatter alone",
        "systematic (constant) part",
        "success probability",
    ]
    rows = [row for row in zip(labels, *cells, strict=True) if any(row[1:])]
    return Table(("planned with the model", *(names[name] for name in columns)), tuple(rows))


def _cells(answer: tuple[Solution, PredictedError], sizes: list[float]) -> tuple[str, ...]:
    solution, predicted_error = answer
    joints = [
        joint_value(q, joint.type)
        for q, joint in zip(solution.q, solution.optimisation_problem.robot.joints, strict=True)
    ]
    errors = (
        solution.critical.sigma_max,
        predicted_error.sigma_max,
        predicted_error.distance,
        predicted_error.critical_error,
    )
    parts, p_success = predicted_error.parts, predicted_error.success_probability
    of_it = ("", "") if parts is None else (parts.scatter_radius, parts.systematic_radius)
    texts = (value if isinstance(value, str) else _length(value, sizes) for value in (*errors, *of_it))
    return (*joints, *texts, "" if p_success is None else _success(p_success))


def _sentences(columns: Answers, reference: str) -> tuple[str, ...]:
    judge = _MODELS[reference]
    if _FIRST not in columns:
        return (f"{_capital(_MODELS[_FIRST])} has no posture for this task.",)
    old, new = columns[_FIRST][1], next(reversed(columns.values()))[1]
    part, before = PARTS[columns[_FIRST][0].critical.within], old.critical_error
    return (
        f"Planned before calibration, the mean error {part} is {length(old.distance, among=[before])} and the 95 % "
        f"error radius {length(before)}; planned with {judge}, the radius is {length(new.critical_error)}. Every "
        f"posture is evaluated with {judge}.",
    )


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _length(metres: float, among: list[float]) -> str:
    if not math.isfinite(metres):
        return ""
    return length(metres, among=among) if metres > _NOTHING else "0"


def _success(p: float) -> str:
    return percent(p) if p < 0.9995 else "> 99.9 %"


class ComparisonPresenter(Presenter["Comparison"]):
    """One task planned with several models of an arm."""

    document = "comparison"

    def summary(self) -> Summary:
        chosen = self.result.answered
        facts = [
            (
                MODEL_NAMES[name].capitalize(),
                f"within {length(predicted_error.critical_error)} of the target (95 % probability)",
            )
            for name, (_, predicted_error) in chosen.items()
        ]
        why = [("No posture", sentence(reason)) for reason in self.result.reasons[:_TOLD]]
        return Summary(f"{_TITLE}: {self.problem.name}", (*facts, *why))

    def report(self) -> Report:
        return Report(self.problem.name or _TITLE, comparison_lead(self.result), comparison_blocks(self.result))

    def drawings(self) -> Drawings:
        """Predicted error in the posture of each model."""
        return comparison_drawings(self.result)

    def columns(self) -> Columns:
        """The posture of each model, and where it lands as the reference predicts, SI units."""
        chosen = self.result.answered.values()
        names = [joint.name for joint in self.problem.robot.joints]
        return {
            "model": list(self.result.answered),
            **{f"{name} [rad or m]": [solution.posture[name] for solution, _ in chosen] for name in names},
            "sigma_max [m]": [predicted_error.sigma_max for _, predicted_error in chosen],
            "critical error [m]": [predicted_error.critical_error for _, predicted_error in chosen],
        }


def comparison_drawings(comparison: Comparison | None) -> Drawings:
    """Predicted error in the posture of each model, where the one before calibration and the reference have one."""
    if comparison is None or not {_FIRST, comparison.reference} <= set(comparison.answered):
        return {}
    return {"predicted_error": partial(plot_landing, comparison, distinct_columns(comparison))}
