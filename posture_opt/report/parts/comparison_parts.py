"""What a report says of a predicted spread's two parts, and of how far the task is from what was measured."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from posture_opt.report.text.units_text import joint_unit, length
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.selection.comparison.plan_comparison import Comparison, PredictedError
    from posture_opt.uncertainty.spread.spread_parts import SpreadParts

_EDGE = math.radians(1.0)  # rad or m: a posture that leaves the measured range by less is at its edge
_TINY = 1e-6  # m: no arm is placed better
_FILES = ("calibrated", "extended")  # models whose problem file --out writes under their name


def open_lead(comparison: Comparison, told: bool) -> tuple[str, ...]:
    """A sentence for the lead: where the data leave the arm more open at the task than it scatters, or if ``told``.

    Within the measured range that is worth a line only where the whole error is still large, which ``told`` says.
    """
    predicted_error = _judged(comparison)
    parts = predicted_error.parts
    if parts is None:
        return ()
    scatter, systematic = _sizes(parts)
    if not parts.mostly_systematic:
        words = f"The remaining error is {scatter} of scatter and {systematic} of parameter uncertainty."
        return (words,) if told and parts.systematic_sigma > 0 else ()
    outside = _outside(predicted_error, comparison)
    if not outside and not told:
        return ()
    sources, close = _sources(parts, comparison), _close(comparison)
    if not outside:
        same = f"Most of the remaining error is systematic: {systematic}, mainly from {sources}"
        return (f"{same}; scatter contributes {scatter}. {close}",)
    where = f"The task lies outside the measured range, {outside}"
    return (
        f"{where}: {systematic} of its error is parameter uncertainty, mainly from {sources}; "
        f"scatter contributes {scatter}. {close}",
    )


def parts_sentences(comparison: Comparison) -> tuple[str, ...]:
    """What is scatter and what is not at the posture of the reference, and how far it is from those measured."""
    predicted_error = _judged(comparison)
    parts, distance, words = predicted_error.parts, predicted_error.from_measured, []
    if parts is not None and parts.systematic_sigma > 0:
        scatter, systematic = _sizes(parts)
        close = f" {_close(comparison)}" if parts.mostly_systematic else ""
        words.append(
            f"There, the 95 % radius of the scatter between repeats is {scatter}; that of the systematic part "
            f"(parameter uncertainty and model error) is {systematic}, mainly from "
            f"{_sources(parts, comparison)}.{close}"
        )
    if distance is not None:
        kind = "revolute" if any(j.type == "revolute" for j in comparison.problem.robot.joints) else "prismatic"
        outside = _outside(predicted_error, comparison)
        where = f"outside the measured range, {outside}" if outside else "within the measured range of every joint"
        near = _moved(distance.nearest, kind)
        words.append(f"The posture is {where}; the nearest measured one differs by up to {near} in its joints.")
    return tuple(words)


def _close(comparison: Comparison) -> str:
    """The command that proposes what to measure, on top of what the reference is known by."""
    file = f" --problem {comparison.reference}.yaml" if comparison.reference in _FILES else ""
    return f"'plan-measurements{file} --for task' proposes what to measure."


def _judged(comparison: Comparison) -> PredictedError:
    return comparison.answered[comparison.reference][1]


def _sizes(parts: SpreadParts) -> tuple[str, str]:
    sizes = [parts.scatter_radius, parts.systematic_radius]
    scatter, systematic = (
        length(size, among=sizes) if size > _TINY else f"less than {length(_TINY, among=sizes)}" for size in sizes
    )
    return scatter, systematic


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
    words = list(dict.fromkeys(_source(name, comparison) for name in parts.parameters))
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _source(name: str, comparison: Comparison) -> str:
    effects = comparison.problem.arm.effects
    return next((f"{e.title} of {e.target}" for e in effects if name in e.parameter_names), name)
