"""Comparison of plans in a report: the postures of several models of one arm, and the errors in them.

The error has two parts, scatter and what is systematic; and the task may be outside of what was measured.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from posture_opt.errors import enumerated
from posture_opt.report.parts.collision_parts import mounting_notes
from posture_opt.report.parts.parts import input_facts, sentence
from posture_opt.report.text.blocks import Block, Later, Table
from posture_opt.report.text.words import MODEL_NAMES, PARTS
from posture_opt.statements.notation import joint_unit, joint_value, length, short_probability, stated_length
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.selection.comparison.comparison import ComparedAnswer, Comparison
    from posture_opt.selection.comparison.predicted_error import PredictedError
    from posture_opt.uncertainty.spread.spread_parts import SpreadParts

TITLE = "Comparison of plans"
FIRST = "nominal"
_PLANAR_JOINTS = 2  # of arms whose bodies no one asks about
_MOSTLY = 0.5  # of an error radius: a mean error that most of it comes from
_SMALL_GAIN = 0.7  # of the error before: a gain that hardly shows at the task
_ROUNDING_M = 1e-7  # m: a miss that the plan corrected for is rounding
_EDGE = math.radians(1.0)  # rad or m: a posture that leaves the measured range by less is at its edge
_TINY_M = 1e-6  # m: no arm is placed better
_BARRED_NOTE = "do not drive there before it is stated what the arm stands on, and the posture is planned again"
_UNSTATED_SCATTER = "Scatter between repeats comes on top: the file states none (uncertainty: {repeatability: 0.1 mm})."
_FILES = ("calibrated", "extended")  # models whose problem file --out writes under their name
_MODELS = {
    "nominal": "the model before calibration",
    "calibrated": "the calibrated model",
    "extended": "the extended model",
    "delivered": "the delivered model",
}


def comparison_lead(comparison: Comparison | None) -> tuple[str, ...]:
    """What it means for the task, in a sentence; which posture is missing, where one is."""
    if comparison is None or not all(comparison.answers_task(name) for name in (comparison.reference, FIRST)):
        return _unsolved_lead(comparison)
    chosen = comparison.answers[comparison.reference]
    judged = {name: comparison.answers[name].judged[comparison.reference] for name in (FIRST, comparison.reference)}
    old, new = (one.critical_error for one in judged.values())
    before, now, model = _length(old, [old, new]), _length(new, [old, new]), _model(comparison.reference)
    outside = _outside(_judged(comparison), comparison)
    far = " (extrapolated)" if outside else ""
    text = f"Task, as {model} predicts: 95 % error radius {before}"
    if comparison.same_posture(FIRST, comparison.reference):
        text += (
            f" with the commands of {_MODELS[FIRST]}, {now}{far} with those of {model}. The posture is the same, and "
        )
        text += f"the gain that of the corrected commands{_in_range(comparison, 'it')}"
    else:
        mean = judged[FIRST].distance
        part = f" ({_length(mean, [old, new])} mean error, gone with corrected commands)"
        text += (
            f" in the posture planned before calibration{part if mean > _MOSTLY * old else ''}, {now}{far} in the one "
        )
        text += f"planned with {model}{_in_range(comparison, 'that posture')}"
    assert chosen.answer is not None
    unknown = chosen.answer.problem.scene.stands_anywhere
    ground = mounting_notes({comparison.reference: chosen.answer})
    open_ = _open_lead(comparison, small_gain=new > _SMALL_GAIN * old)
    if unknown or outside:  # whether anyone may drive there comes before where it is
        return (f"{text}.", *ground, *open_, _planned_posture(chosen))
    return (f"{text}. {_planned_posture(chosen)}", *open_, *ground)


def _planned_posture(column: ComparedAnswer) -> str:
    """The joint values of a plan, and the payload and sides of approach that it holds for, in sentences."""
    (station,), joints = column.stations, column.problem.robot.joints
    values = [f"{j.name} {joint_value(q, j.type)}" for q, j in zip(station.q, joints, strict=True)]
    conditions = "".join(f" It holds for {words}." for _, words in input_facts(column.problem))
    scene = column.problem.scene
    if not scene.active and not scene.switched_off and len(joints) > _PLANAR_JOINTS:
        conditions += " Collisions are not checked, as the shape of the arm is not known: "
        barred = scene.stands_anywhere and column.answer is not None and column.answer.mounting_note
        conditions += f"{_BARRED_NOTE if barred else 'approach slowly'}."
    return f"Planned posture: {enumerated(values)}.{conditions}"


def _unsolved_lead(comparison: Comparison | None) -> tuple[str, ...]:
    """That the task has no posture with the reference, and the first reason; nothing where it has one."""
    if comparison is None or comparison.answers_task(comparison.reference):
        return ()
    why = "".join(f" {sentence(reason)}" for reason in comparison.reasons[:1])
    return (f"Task: {_model(comparison.reference)} has no posture for it.{why}",)


def _in_range(comparison: Comparison, subject: str) -> str:
    """How far the planned posture, ``subject`` of the clause, is from those measured; empty outside of their range.

    That it lies outside is said by a sentence of its own.
    """
    predicted = _judged(comparison)
    if predicted.from_measured is None or _outside(predicted, comparison):
        return ""
    return f"; {subject} is within the joint ranges measured, {_nearest(predicted, comparison)} from the nearest one"


def _nearest(predicted: PredictedError, comparison: Comparison) -> str:
    """The largest difference of a joint from the nearest measured posture."""
    assert predicted.from_measured is not None
    kind = "revolute" if any(j.type == "revolute" for j in comparison.problem.robot.joints) else "prismatic"
    return f"up to {_moved(predicted.from_measured.nearest, kind)} in a joint"


def comparison_blocks(comparison: Comparison | None, names: Mapping[str, str] = MODEL_NAMES) -> tuple[Block, ...]:
    """The posture of each model, its predicted errors, or why there is none; nothing without a task.

    Args:
        comparison: of named models; ``names`` are their column headers.
    """
    if comparison is None:
        return ()
    if not comparison.answers_task(comparison.reference):
        judge, reasons = _model(comparison.reference), map(sentence, comparison.reasons)
        return (Block(TITLE, (f"{_capital(judge)} has no posture for this task.", *reasons), brief=()),)
    figure = "predicted_error" if comparison.answers_task(FIRST) else ""
    return (Block(TITLE, Later(partial(_comparison_items, comparison, names)), figure),)


def _comparison_items(comparison: Comparison, names: Mapping[str, str]) -> tuple[str | Table, ...]:
    """The postures and errors of all models, with what they mean."""
    columns, reference = distinct_columns(comparison), comparison.reference
    return (
        *_sentences(columns, reference),
        *_parts_sentences(comparison),
        *map(sentence, comparison.reasons),
        comparison_table(columns, reference, names),
    )


def distinct_columns(comparison: Comparison) -> dict[str, ComparedAnswer]:
    """The answers by the name of the model; one that repeats the one before it in the table is left out."""
    columns: dict[str, ComparedAnswer] = {}
    reference = comparison.reference
    for name, column in comparison.answered.items():
        former = next(reversed(columns.values()), None)
        sizes = [] if former is None else [former.judged[reference].critical_error]
        if former is None or _cells(former, reference, sizes) != _cells(column, reference, sizes):
            columns[name] = column
    return columns


def comparison_table(
    columns: Mapping[str, ComparedAnswer], reference: str, names: Mapping[str, str] = MODEL_NAMES
) -> Table:
    """A column a model: joints, σ as itself and as the reference predicts it, errors, probability of success."""
    sizes = [column.judged[reference].critical_error for column in columns.values()]
    cells = [_cells(column, reference, sizes) for column in columns.values()]
    labels = [joint.name for joint in next(iter(columns.values())).problem.robot.joints]
    labels += ["largest σ, as planned", "largest σ, as judged", "mean error", "95 % error radius"]
    labels += ["scatter alone", "systematic (constant) part", "success probability"]
    rows = [row for row in zip(labels, *cells, strict=True) if any(row[1:])]
    return Table(("planned with the model", *(names.get(name, name) for name in columns)), tuple(rows))


def _cells(column: ComparedAnswer, reference: str, sizes: list[float]) -> tuple[str, ...]:
    (station,), judged = column.stations, column.judged[reference]
    joints = [joint_value(q, joint.type) for q, joint in zip(station.q, column.problem.robot.joints, strict=True)]
    errors = (column.sigma_max, judged.sigma_max, judged.distance, judged.critical_error)
    parts = judged.worst.parts
    scatter, constant = "", ""
    if parts is not None:
        scatter = _length(parts.scatter_radius, sizes) if parts.scatter_sigma > 0 else "none stated"
        constant = _length(parts.systematic_radius, sizes)
    shown = (*(_length(value, sizes) for value in errors), scatter, constant)
    return (*joints, *shown, success_text(judged.success_probability))


def success_text(p: float | None) -> str:
    """A probability of success for a table; empty without one."""
    return "" if p is None else short_probability(p)


def _sentences(columns: dict[str, ComparedAnswer], reference: str) -> tuple[str, ...]:
    judge = _model(reference)
    if FIRST not in columns:
        return (f"{_capital(_model(FIRST))} has no posture for this task.",)
    old, new = columns[FIRST].judged[reference], next(reversed(columns.values())).judged[reference]
    part, before = PARTS[columns[FIRST].stations[0].critical.within], old.critical_error
    return (
        f"Planned before calibration, the mean error {part} is {length(old.distance, among=[before])} and the 95 % "
        f"error radius {length(before)}; planned with {judge}, the radius is {length(new.critical_error)}. Every "
        f"posture is evaluated with {judge}.",
    )


def _model(name: str) -> str:
    return _MODELS.get(name, f"the model {name}")


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _length(metres: float, among: list[float]) -> str:
    if not math.isfinite(metres):
        return ""
    return length(metres if metres > _ROUNDING_M else 0.0, among=among)


def _open_lead(comparison: Comparison, small_gain: bool) -> tuple[str, ...]:
    """A sentence for the lead: where the posture is extrapolated, where the data leave the arm more open at the task
    than it scatters, where the gain is small, or where no scatter is part of the radius.

    Within the measured range that is worth a line only where the whole error is still large, by ``small_gain``.
    """
    predicted_error = _judged(comparison)
    parts, extrapolated = predicted_error.parts, _extrapolated(predicted_error, comparison)
    if parts is None:
        return (extrapolated,) if extrapolated else ()
    scatter, systematic = _sizes(parts)
    if not parts.mostly_systematic:
        words = f"The remaining error is {scatter} of scatter and {systematic} of parameter uncertainty."
        return tuple(filter(None, (extrapolated, words if small_gain and parts.systematic_sigma > 0 else "")))
    if not extrapolated and not small_gain:
        return () if parts.scatter_sigma > 0 else (_UNSTATED_SCATTER,)
    sources, close = _sources(parts, comparison), _close(comparison)
    if not extrapolated:
        same = f"Most of the remaining error is systematic: {systematic}, mainly from {sources}"
        return (f"{same}; {_scatter_words(parts, scatter)}. {close}",)
    return (
        f"{extrapolated} {systematic} of the error is parameter uncertainty, mainly from {sources}; "
        f"{_scatter_words(parts, scatter)}. {close}",
    )


def _extrapolated(predicted_error: PredictedError, comparison: Comparison) -> str:
    """That the planned posture is outside of what was measured, and which effects of that joint it relies on there.

    Empty where it is within the measured range.
    """
    outside, away = _outside(predicted_error, comparison), predicted_error.from_measured
    if not outside or away is None:
        return ""
    effects = [e for e in comparison.problem.arm.effects if e.target == away.joint and "approach" not in e.needs]
    relied = dict.fromkeys(effect.title for effect in effects if effect.valid_between is None)
    condition = (
        f", and the radius holds only if the {enumerated(relied)} of {away.joint} goes on there" if relied else ""
    )
    chosen = comparison.answers[comparison.reference].answer
    assert chosen is not None  # a posture is judged
    if comparison.problem.narrowed and not chosen.problem.within_measured:
        return (
            "Extrapolated: no posture for this task was found within the ranges in which effects were measured, and "
            f"the planned one leaves them, {outside}{condition}. Measure there, or place the task where the arm was "
            "measured, before relying on it."
        )
    before = ": do not rely on it before measuring there" if relied else ""
    return f"Extrapolated: the planned posture lies outside the measured range, {outside}{condition}{before}."


def _parts_sentences(comparison: Comparison) -> tuple[str, ...]:
    """What is scatter and what is not at the posture of the reference, and how far it is from those measured."""
    predicted_error = _judged(comparison)
    parts, distance, words = predicted_error.parts, predicted_error.from_measured, []
    if parts is not None and parts.systematic_sigma > 0:
        scatter, systematic = _sizes(parts)
        close = f" {_close(comparison)}" if parts.mostly_systematic else ""
        scattered = f"the 95 % radius of the scatter between repeats is {scatter}"
        scattered = scattered if parts.scatter_sigma > 0 else "the file states no scatter between repeats"
        words.append(
            f"There, {scattered}; the 95 % radius of the systematic part (parameter uncertainty and model error) is "
            f"{systematic}, mainly from {_sources(parts, comparison)}.{close}"
        )
    if distance is not None:
        outside = _outside(predicted_error, comparison)
        where = f"outside the measured range, {outside}" if outside else "within the measured range of every joint"
        near = _nearest(predicted_error, comparison)
        words.append(f"The posture is {where}; the nearest measured one differs by {near}.")
    return tuple(words)


def _close(comparison: Comparison) -> str:
    """The command that proposes what to measure, on top of what the reference is known by."""
    file = f" --problem {comparison.reference}.yaml" if comparison.reference in _FILES else ""
    return f"'plan-measurements{file} --for task' proposes what to measure."


def _judged(comparison: Comparison) -> PredictedError:
    return comparison.answers[comparison.reference].judged[comparison.reference].worst


def _sizes(parts: SpreadParts) -> tuple[str, str]:
    sizes = [parts.scatter_radius, parts.systematic_radius]
    scatter, systematic = (
        length(size, among=sizes) if size > _TINY_M else f"less than {stated_length(_TINY_M)}" for size in sizes
    )
    return scatter, systematic


def _scatter_words(parts: SpreadParts, scatter: str) -> str:
    """What scatter contributes; that none is stated, where that is why it is zero."""
    return f"scatter contributes {scatter}" if parts.scatter_sigma > 0 else "the file states no scatter between repeats"


def _outside(predicted_error: PredictedError, comparison: Comparison) -> str:
    """By how much the posture leaves the measured range of a joint, ``elbow by 12 deg``; empty where it does not."""
    distance = predicted_error.from_measured
    if distance is None or not distance.joint or distance.beyond <= _EDGE:
        return ""
    kind = next(joint.type for joint in comparison.problem.robot.joints if joint.name == distance.joint)
    return f"{distance.joint} by {_moved(distance.beyond, kind)}"


def _moved(value: float, kind: str) -> str:
    unit, factor = joint_unit(kind)
    return f"{number(value * factor, 2)} {unit}"


def _sources(parts: SpreadParts, comparison: Comparison) -> str:
    """What the systematic part comes from: parameters by their names, effects by what they are."""
    return enumerated(dict.fromkeys(_source(name, comparison) for name in parts.parameters))


def _source(name: str, comparison: Comparison) -> str:
    effects = comparison.problem.arm.effects
    return next((f"{e.title} of {e.target}" for e in effects if name in e.parameter_names), name)
