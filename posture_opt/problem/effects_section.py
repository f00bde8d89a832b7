"""The ``effects`` section of a problem file: the robot with them, and what they do to its sources of error."""

# Effects that move the tool point become parts of the arm. Those that only scatter (noise) add variances and
# correlations to the sources, or change the σ of the instrument.

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeGuard

from posture_opt.errors import BadValueError, InputError, Issue, one_of
from posture_opt.files import located
from posture_opt.model.arm import Arm
from posture_opt.model.arm_state import REFERENCE_TEMPERATURE, ArmState, Inputs
from posture_opt.model.effects import CatalogueEntry, Effect, NoiseEffect
from posture_opt.robot.robot import Robot
from posture_opt.selection.tasks import Task
from posture_opt.uncertainty.sources import Sources, covariance_issues
from posture_opt.uncertainty.uncertainty_section import MeasurementSpec, read_covariance


def arm_with(robot: Robot, effects: tuple[CatalogueEntry, ...], task: Task | None) -> Arm:
    """The arm with the effects of the file, under the inputs that the task states."""
    issues = _task_issues(robot, None if task is None else task.for_robot(robot))
    for index, effect in enumerate(effects):
        try:
            effect.check_robot(robot)
            asked = isinstance(effect, Effect) and "masses" in effect.asks
            if asked and not ArmState(robot, [0.0] * robot.n).weighed:
                message = "masses or centres of mass of some links are not stated"
                raise BadValueError(message, "add mass and com to the joints")
        except BadValueError as error:
            issues.append(error.issue(("effects", index), effect.kind))
    names = [effect.name for effect in effects]
    for index, name in enumerate(names):
        if name in names[:index]:
            issues.append(Issue(f"{name} is given twice", ("effects", index), name, "keep one of them"))
    if issues:
        raise InputError(issues)
    return Arm(robot, moving_effects(effects), _inputs(robot, task))


def moving_effects(effects: Sequence[CatalogueEntry]) -> tuple[Effect, ...]:
    """Those of a file's effects that move the tool point; the others spread it, or its measurements."""
    return tuple(effect for effect in effects if isinstance(effect, Effect))


def effect_sources(
    arm: Arm, effects: tuple[Effect, ...], folder: Path, attached: Mapping[str, str], read: str | None
) -> Sources:
    """The covariances of the effects' parameters, from the files that the effects name."""
    dimensions = {name: "length" if f.kind == "translate" else "angle" for name, f in arm.robot.parameters.items()}
    found, done = Sources(), {read}
    for index, file in enumerate(effect.covariance for effect in effects):
        if not file or file in done:
            continue
        done.add(file)
        try:
            names, C = read_covariance(located(folder, file), {**dimensions, **arm.dimensions}, attached.get(file))
            if issues := covariance_issues(names, C):
                raise InputError(issues)
        except InputError as error:
            key = ("effects", index, "covariance")
            raise InputError([i if i.file else replace(i, key=key, value=file) for i in error.issues]) from None
        found = found.plus(Sources(names, (C + C.T) / 2))
    return found


def noisy_sources(sources: Sources, robot: Robot, effects: Sequence[CatalogueEntry]) -> Sources:
    """The sources with the scatter that effects add from repeat to repeat, and the correlations that they state."""
    # ``C_ab = C_ab + ρ sqrt(C_aa C_bb)`` for a stated correlation ρ of the parameters a and b
    issues: list[Issue] = []
    for index, effect in enumerate(effects):
        if not isinstance(effect, NoiseEffect):
            continue
        scatter = effect.scatter(robot)
        sources = sources.plus(Sources.scattering(scatter)) if scatter else sources
        for a, b, rho in effect.correlation:
            fault = _pair_fault(sources, a, b)
            if fault is not None:
                issues.append(replace(fault, key=("effects", index), value=effect.name))
                continue
            i, j = sources.names.index(a), sources.names.index(b)
            covariance, variance = sources.covariance.copy(), sources.constant
            covariance[i, j] += rho * (variance[i, i] * variance[j, j]) ** 0.5
            covariance[j, i] = covariance[i, j]
            sources = replace(sources, covariance=covariance)
            contradictions = covariance_issues(sources.names, sources.constant)
            issues += [replace(issue, key=("effects", index), value=effect.name) for issue in contradictions]
    if issues:
        raise InputError(issues)
    return sources


def measurement_issues(stated: MeasurementSpec | None, effects: Sequence[CatalogueEntry]) -> list[Issue]:
    """Effects that change an instrument's σ where none is stated."""
    add = {"position": "{position: 0.05 mm}", "orientation": "{position: 0.05 mm, orientation: 0.1 mrad}"}
    return [
        Issue(
            f"{effect.name} changes the σ of the instrument, and none is stated", ("effects", index), effect.kind,
            f"add uncertainty: {{measurement: {add[effect.changed_sigma]}}}",
        )
        for index, effect in enumerate(effects)
        if isinstance(effect, NoiseEffect) and effect.of_stated and not getattr(stated, effect.changed_sigma, None)
    ]  # fmt: skip


def of_a_type(effect: CatalogueEntry) -> TypeGuard[NoiseEffect]:
    """Whether an effect says how robots of a type differ: once one was measured, the errors of that one are known."""
    return isinstance(effect, NoiseEffect) and bool(effect.correlation)


def _task_issues(robot: Robot, task: Task | None) -> list[Issue]:
    if task is None:
        return []
    joints = robot.joint_names
    issues = [
        Issue("the robot has no such joint", ("task", "approach", name), name, one_of(name, joints, "joints"))
        for name in task.approach
        if name not in joints
    ]
    for place, terms in (("minimize", task.minimize), ("subject_to", task.subject_to)):
        said: dict[tuple[str, ...], int] = {}
        for index, term in enumerate(terms):
            try:
                term.check(robot)
                if place == "minimize" and term.held(robot):
                    raise BadValueError(f"{term.kind} is no quantity to minimise", "move it to subject_to")
                for subject in term.subjects:
                    if subject in said:
                        first = f"{place}[{said[subject]}]"
                        message = f"{term.subjects[subject]} is stated twice, first in {first}"
                        raise BadValueError(message, "keep one of the two")
            except BadValueError as error:
                issues.append(error.issue(("task", place, index), term.kind))
            said |= dict.fromkeys(term.subjects, index)
    return issues


def _inputs(robot: Robot, task: Task | None) -> Inputs:
    if task is None:
        return Inputs(payload=robot.payload)
    warmth = 0.0 if task.temperature is None else task.temperature - REFERENCE_TEMPERATURE
    return Inputs(
        payload=robot.payload if task.payload is None else task.payload,
        approach=[float(task.approach.get(name, 0)) for name in robot.joint_names],
        temperature=warmth,
        time=task.time or 0.0,
        stated=tuple(task.approach),
    )


def _pair_fault(sources: Sources, a: str, b: str) -> Issue | None:
    """Why two parameters cannot be correlated: one has no σ, or they are correlated already; None where they can."""
    at = {name: k for k, name in enumerate(sources.names)}
    for name in (a, b):
        if name not in at or sources.constant[at[name], at[name]] <= 0:
            return Issue(f"'{name}' has no σ to be correlated", hint=f"add uncertainty: {{sigma: {{{name}: 0.1 mm}}}}")
    if sources.constant[at[a], at[b]] != 0:
        return Issue(f"the correlation of {a} and {b} is stated twice", hint="keep one, here or under uncertainty")
    return None
