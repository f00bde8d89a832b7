"""``Comparison``: one task planned with several models, each answer judged by each of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.result import Result
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.answer.solution_statements import NO_GAIN, part_of
from posture_opt.selection.comparison.predicted_error import JudgedAnswer, PredictedError
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.search.engine import clusters
from posture_opt.statements import Quantity, Statement, state
from posture_opt.statements.notation import joint_value
from posture_opt.uncertainty.sources import conditions

FIRST = "nominal"
"""The model that others are compared with: the one before calibration."""
_EDGE = math.radians(1.0)  # rad or m: a posture that leaves the measured range by less is at its edge
_FILES = ("calibrated", "extended")  # models whose problem file --out writes under their name
_MODELS = {
    "nominal": "the model before calibration", "calibrated": "the calibrated model", "extended": "the extended model",
    "delivered": "the delivered model",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class ComparedAnswer:
    """A column of a comparison: the answer planned with one model, or why there is none, and its judgements."""

    problem: ProblemData
    answer: Solution | None = None
    # Name of a model -> its prediction; models of arms with other joints have no entry.
    judged: Mapping[str, JudgedAnswer] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()

    @property
    def stations(self) -> tuple[Solution, ...]:
        """One posture, one a feature, or one a listed point of a path."""
        return () if self.answer is None else self.answer.stations

    @property
    def sigma_max(self) -> float:
        """Largest standard deviation that the model itself predicts of its answer [m]."""
        return max(station.critical.sigma_max for station in self.stations)

    def to_json(self) -> dict[str, Any]:
        if self.answer is None:
            return {"status": "infeasible", "reasons": list(self.reasons)}
        return {
            "status": self.answer.status,
            "postures": [station.posture for station in self.stations],
            "sigma_max": self.sigma_max,
            "judged_by": {name: judged.to_json() for name, judged in self.judged.items()},
            "reasons": [],
        }

    def judged_json(self, reference: str) -> dict[str, Any] | None:
        """The one posture, the σ that its model predicts [m], and the reference's prediction; None without one."""
        if self.answer is None:
            return None
        (station,), predicted = self.stations, self.judged[reference].worst
        parts, distance = predicted.parts, predicted.from_measured
        return {
            "posture": station.posture,
            "predicted_sigma_max": self.sigma_max,
            **self.judged[reference].to_json(),
            "miss": predicted.miss.tolist(),
            **({} if parts is None else {"spread": parts.to_json()}),
            **({} if distance is None else {"from_measured": distance.to_json()}),
        }


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    """One task for several arms, or for several models of one arm: a matrix of answers and models that judge them.

    The entry ``answers[planned].judged[judge]`` is what the model ``judge`` predicts of the postures that were planned
    with the model ``planned``.

    Args:
        answers: the columns, by the name of the arm or model that they were planned with.
        reference: of models of one arm, the one that knows it best; empty where arms are compared.
        notes: on what was not the same.
    """

    answers: Mapping[str, ComparedAnswer]
    reference: str = ""
    notes: tuple[Statement, ...] = ()

    @property
    def arms(self) -> Mapping[str, ComparedAnswer]:
        """The answers by the arm that they were planned with."""
        return self.answers

    @property
    def problem(self) -> ProblemData:
        """The reference, or the first arm, with the task."""
        return self.answers[self.reference or next(iter(self.answers))].problem

    @property
    def answered(self) -> dict[str, ComparedAnswer]:
        """The arms or models that have an answer."""
        return {name: compared for name, compared in self.answers.items() if compared.answer is not None}

    def answers_task(self, name: str) -> bool:
        """Whether a model or arm has an answer."""
        return name in self.answers and self.answers[name].answer is not None

    @property
    def judges(self) -> tuple[str, ...]:
        """Models that judge an answer in a report: the reference alone where there is one."""
        if self.reference:
            return (self.reference,)
        return tuple(name for name in self.answers if any(name in found.judged for found in self.answered.values()))

    @property
    def best(self) -> str | None:
        """Model that predicts the smallest spread for itself, the first in a tie; None without any answer."""
        if not self.answered:
            return None
        sigmas = {name: compared.judged[name].sigma_max for name, compared in self.answered.items()}
        least = min(sigmas.values())
        return next(name for name, sigma in sigmas.items() if sigma <= least * (1 + 1e-12))

    def same_posture(self, one: str, other: str) -> bool:
        """Whether two models plan one posture, but for their corrections and whole turns."""
        (first,), (second,) = self.answers[one].stations, self.answers[other].stations
        ignored = () if second.engine is None else second.engine.indifferent
        return len(clusters(np.array([first.q, second.q]), self.problem.robot, ignored=ignored)[0]) == 1

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons of missing answers, each once."""
        return tuple(dict.fromkeys(reason for compared in self.answers.values() for reason in compared.reasons))

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """Statements, the answer first."""
        return comparison_statements(self)

    def fields_json(self) -> dict[str, Any]:
        """The document ``comparison.json``, with a reference the part ``posture`` of others: SI units and radians."""
        if self.reference:
            judged = {name: compared.judged_json(self.reference) for name, compared in self.answers.items()}
            return {**judged, "reasons": list(self.reasons)}
        task = self.problem.task
        return {
            "name": self.problem.name,
            "task": None if task is None else task.kind,
            "arms": {name: compared.to_json() for name, compared in self.answers.items()},
            "best": self.best,
            "notes": [str(note) for note in self.notes],
        }


def model_name(name: str) -> str:
    return _MODELS.get(name, f"the model {name}")


def comparison_statements(found: Comparison) -> tuple[Statement, ...]:
    """Statements of models of one arm, or of several arms."""
    return plan_statements(found) if found.reference else (*_arms(found), *_cross(found), *found.notes)


def plan_statements(found: Comparison | None) -> tuple[Statement, ...]:
    """What models of one arm mean for its task, also inside a calibration or a diagnosis."""
    if found is None:
        return ()
    if not found.answers_task(found.reference):
        return (_without(found, found.reference),)
    gain = _gain(found) if found.answers_task(FIRST) else [_without(found, FIRST)]
    return (*gain, *_posture(found), *_range(found), *_parts(found))


def _without(found: Comparison, name: str) -> Statement:
    reason = next(iter(found.answers[name].reasons), "no posture was found") if name in found.answers else "not asked"
    return state("selection.plan-impossible", name, model=model_name(name), reason=reason)


def _gain(found: Comparison) -> list[Statement]:
    old, new = (found.answers[name].judged[found.reference] for name in (FIRST, found.reference))
    name = "plan-error-corrected" if found.same_posture(FIRST, found.reference) else "plan-error"
    radii = {"before": Quantity(old.critical_error), "now": Quantity(new.critical_error)}
    said = [state(f"selection.{name}", found.reference, **radii, model=model_name(found.reference))]
    if old.distance > 0.5 * old.critical_error:
        said.append(state("selection.plan-mean-error", mean=Quantity(old.distance)))
    return said


def _posture(found: Comparison) -> list[Statement]:
    column = found.answers[found.reference]
    assert column.answer is not None
    (station,), problem = column.stations, column.problem
    joints, scene = problem.robot.joints, column.answer.problem.scene
    values = tuple(f"{joint.name} {joint_value(q, joint.type)}" for joint, q in zip(joints, station.q, strict=True))
    held = conditions(problem.arm)
    # No one asks about the bodies of planar arms.
    unchecked = not scene.active and not scene.switched_off and len(joints) > 2
    why = "; ".join(problem.robot.shape_notes) or "the shape of the arm is not known"
    return [
        state("selection.plan-posture", posture=", ".join(values)),
        *([state("selection.plan-conditions", conditions=held)] if held else []),
        *scene.statements(column.answer.postures),
        *([state("collision.shape-unknown", why=why)] if unchecked else []),
    ]


def judged_by_reference(found: Comparison) -> PredictedError:
    """The reference's prediction of its own posture."""
    return found.answers[found.reference].judged[found.reference].worst


def _outside(found: Comparison) -> str:
    away = judged_by_reference(found).from_measured
    return away.joint if away is not None and away.beyond > _EDGE else ""


def _range(found: Comparison) -> list[Statement]:
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
    # A smaller gain hardly shows at the task.
    matters = parts.mostly_systematic and (new > 0.7 * old or bool(_outside(found)))
    if not matters:
        return [*unstated, state("selection.plan-error-parts", "", sources=sources, **sizes)]
    file = f" --problem {found.reference}.yaml" if found.reference in _FILES else ""
    command = f"plan-measurements{file} --for task"
    systematic = state("selection.plan-mostly-systematic", systematic=sizes["systematic"], sources=sources)
    return [*unstated, systematic, state("selection.measure-for-task", command=command)]


def _arms(found: Comparison) -> list[Statement]:
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
    answers = [arm.answer for arm in answered.values() if arm.answer is not None]
    cautions = [one for answer in answers for one in answer.problem.scene.statements(answer.postures)]
    return [*said, *{one.text: one for one in cautions}.values()]


def is_other_arm(found: Comparison, name: str, judge: str) -> bool:
    """Whether the posture of one arm misses on the other by far more than the arm errs."""
    arm = found.arms[name]
    return judge in arm.judged and arm.judged[judge].distance > 100.0 * arm.judged[name].critical_error


def _cross(found: Comparison) -> list[Statement]:
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
