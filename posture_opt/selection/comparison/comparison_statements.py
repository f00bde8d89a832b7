"""What a comparison has to say: which arm scatters least, or what a better model of one arm is worth at the task."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from posture_opt.selection.answer.solution_statements import NO_GAIN, part_of
from posture_opt.statements import Quantity, Statement, state
from posture_opt.statements.notation import joint_value
from posture_opt.uncertainty.spread.conditions import conditions

if TYPE_CHECKING:
    from posture_opt.selection.comparison.comparison import Comparison
    from posture_opt.selection.comparison.predicted_error import PredictedError

FIRST = "nominal"
"""The model that others are compared with: the one before calibration."""
_PLANAR_JOINTS = 2  # of arms whose bodies no one asks about
_MOSTLY = 0.5  # of an error radius: a mean error that most of it comes from
_SMALL_GAIN = 0.7  # of the error before: a gain that hardly shows at the task
_EDGE = math.radians(1.0)  # rad or m: a posture that leaves the measured range by less is at its edge
_OTHER_ARM_RATIO = 100.0  # times its own error: another arm
_FILES = ("calibrated", "extended")  # models whose problem file --out writes under their name
_MODELS = {
    "nominal": "the model before calibration", "calibrated": "the calibrated model", "extended": "the extended model",
    "delivered": "the delivered model",
}  # fmt: skip


def model_name(name: str) -> str:
    """A model of an arm in a sentence."""
    return _MODELS.get(name, f"the model {name}")


def comparison_statements(found: Comparison) -> tuple[Statement, ...]:
    """All of them: of models of one arm what planning with the reference gains, of arms which is best."""
    return plan_statements(found) if found.reference else (*_arms(found), *_cross(found), *found.notes)


def plan_statements(found: Comparison | None) -> tuple[Statement, ...]:
    """What models of one arm mean for its task, also inside a calibration or a diagnosis; nothing without a task."""
    if found is None:
        return ()
    if not found.answers_task(found.reference):
        return (_without(found, found.reference),)
    gain = _gain(found) if found.answers_task(FIRST) else [_without(found, FIRST)]
    return (*gain, *_posture(found), *_range(found), *_parts(found))


def _without(found: Comparison, name: str) -> Statement:
    """That a model has no posture for the task."""
    reason = next(iter(found.answers[name].reasons), "no posture was found") if name in found.answers else "not asked"
    return state("selection.plan-impossible", name, model=model_name(name), reason=reason)


def _gain(found: Comparison) -> list[Statement]:
    """The 95 % error radius before and with the reference."""
    old, new = (found.answers[name].judged[found.reference] for name in (FIRST, found.reference))
    name = "plan-error-corrected" if found.same_posture(FIRST, found.reference) else "plan-error"
    radii = {"before": Quantity(old.critical_error), "now": Quantity(new.critical_error)}
    said = [state(f"selection.{name}", found.reference, **radii, model=model_name(found.reference))]
    if old.distance > _MOSTLY * old.critical_error:
        said.append(state("selection.plan-mean-error", mean=Quantity(old.distance)))
    return said


def _posture(found: Comparison) -> list[Statement]:
    """The planned posture, what it holds for, and what is not known of the way there."""
    column = found.answers[found.reference]
    assert column.answer is not None
    (station,), problem = column.stations, column.problem
    joints, scene = problem.robot.joints, column.answer.problem.scene
    values = tuple(f"{joint.name} {joint_value(q, joint.type)}" for joint, q in zip(joints, station.q, strict=True))
    held = conditions(problem.arm)
    unchecked = not scene.active and not scene.switched_off and len(joints) > _PLANAR_JOINTS
    why = "; ".join(problem.robot.shape_notes) or "the shape of the arm is not known"
    return [
        state("selection.plan-posture", posture=", ".join(values)),
        *([state("selection.plan-conditions", conditions=held)] if held else []),
        *scene.statements(column.answer.postures),
        *([state("collision.shape-unknown", why=why)] if unchecked else []),
    ]


def judged_by_reference(found: Comparison) -> PredictedError:
    """What the reference predicts of its own posture."""
    return found.answers[found.reference].judged[found.reference].worst


def _outside(found: Comparison) -> str:
    """The joint that leaves its measured range; empty where none does."""
    away = judged_by_reference(found).from_measured
    return away.joint if away is not None and away.beyond > _EDGE else ""


def _range(found: Comparison) -> list[Statement]:
    """Whether the planned posture is where the arm was measured."""
    away, joint, problem = judged_by_reference(found).from_measured, _outside(found), found.problem
    if away is None:
        return []
    dimension = {one.name: "joint angle" if one.type == "revolute" else "length" for one in problem.robot.joints}
    if not joint:
        turns = "joint angle" if "joint angle" in dimension.values() else "length"
        return [state("selection.plan-inside-measured-range", nearest=Quantity(away.nearest, turns))]
    beyond = Quantity(away.beyond, dimension[joint])
    said = [state("diagnosis.plan-outside-measured-range", joint, beyond=beyond)]
    acting = [e for e in problem.arm.effects if e.target == joint and "approach" not in e.needs]
    if relied := tuple(dict.fromkeys(e.title for e in acting if e.valid_between is None)):
        said.append(state("selection.plan-relies-on-effects", joint, effects=relied))
    answer = found.answers[found.reference].answer
    if problem.narrowed and answer is not None and not answer.problem.within_measured:
        said.append(state("selection.plan-needs-unmeasured-range", joint))
    return said


def _parts(found: Comparison) -> list[Statement]:
    """What of the remaining error is scatter and what is not known, and what to measure against it."""
    parts = judged_by_reference(found).parts
    if parts is None:
        return []
    new = found.answers[found.reference].judged[found.reference].critical_error
    old = found.answers[FIRST].judged[found.reference].critical_error if found.answers_task(FIRST) else math.inf
    sizes = {"scatter": Quantity(parts.scatter_radius), "systematic": Quantity(parts.systematic_radius)}
    unstated = [] if parts.scatter_sigma > 0 else [state("selection.plan-scatter-unstated")]
    if not parts.systematic_sigma > 0:
        return unstated
    sources = tuple(parts.parameters)
    matters = parts.mostly_systematic and (new > _SMALL_GAIN * old or bool(_outside(found)))
    if not matters:
        return [*unstated, state("selection.plan-error-parts", "", sources=sources, **sizes)]
    file = f" --problem {found.reference}.yaml" if found.reference in _FILES else ""
    command = f"plan-measurements{file} --for task"
    systematic = state("selection.plan-mostly-systematic", systematic=sizes["systematic"], sources=sources)
    return [*unstated, systematic, state("selection.measure-for-task", command=command)]


def _arms(found: Comparison) -> list[Statement]:
    """The arm with the smallest standard deviation, how much more the others have, and which cannot do the task."""
    answered, best = found.answered, found.best
    assert best is not None, "without any answer there is no comparison"
    least, part = answered[best].judged[best].sigma_max, part_of(answered[best].stations[0])
    said = [state("selection.arms-best", best, part=part, sigma=Quantity(least))]
    for name, arm in answered.items():
        sigma = arm.judged[name].sigma_max
        more = sigma / least - 1 if least > 0 else math.inf
        if name != best and more <= NO_GAIN:
            said.append(state("selection.arm-equal", name))
        elif name != best:
            said.append(state("selection.arm-more", name, sigma=Quantity(sigma), least=Quantity(least)))
    said += [
        state("selection.arm-cannot", name, reason=next(iter(arm.reasons), "no posture was found"))
        for name, arm in found.arms.items() if name not in answered
    ]  # fmt: skip
    return [*said, *_each_once(one for arm in answered.values() if arm.answer is not None
                               for one in arm.answer.problem.scene.statements(arm.answer.postures))]  # fmt: skip


def _each_once(statements: Iterable[Statement]) -> Iterable[Statement]:
    """Statements without repetitions."""
    return {one.text: one for one in statements}.values()


def is_other_arm(found: Comparison, name: str, judge: str) -> bool:
    """Whether the posture of one arm means nothing to the other: it misses by far more than the arm errs."""
    arm = found.arms[name]
    return judge in arm.judged and arm.judged[judge].distance > _OTHER_ARM_RATIO * arm.judged[name].critical_error


def _cross(found: Comparison) -> list[Statement]:
    """What the last arm predicts of the posture of the first, and which arms are not alike at all."""
    pairs = [(name, judge) for judge in found.arms for name in found.answered if name != judge]
    far = [(name, judge) for name, judge in pairs if is_other_arm(found, name, judge)]
    said = [
        state("selection.arms-different", judge, planned=name, miss=Quantity(found.arms[name].judged[judge].distance))
        for name, judge in far
    ]
    if not any(judge in found.arms[name].judged for name, judge in pairs):
        said.append(state("selection.arms-unlike"))
    (first, arm), *_, (last, other) = found.arms.items()
    if last in arm.judged and other.answer is not None and (first, last) not in far:
        radii = {"before": arm.judged[last].critical_error, "after": other.judged[last].critical_error}
        given = {key: Quantity(radius) for key, radius in radii.items()}
        said.append(state("selection.arm-judged", last, planned=first, **given))
    return said
