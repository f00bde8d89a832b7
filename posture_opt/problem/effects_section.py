"""The ``effects`` section of a problem file: the robot with them, under the inputs that the task states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from posture_opt.errors import BadValueError, InputError, Issue, KeyPath, one_of
from posture_opt.model.arm import Arm
from posture_opt.model.arm_state import ArmState
from posture_opt.model.inputs import REFERENCE_TEMPERATURE, Inputs
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.tasks import Task
from posture_opt.uncertainty.covariance_file import read_covariance
from posture_opt.uncertainty.sources import Sources, covariance_issues

if TYPE_CHECKING:
    from posture_opt.model.effects import CatalogueEntry, Effect


def arm_with(robot: Robot, effects: tuple[CatalogueEntry, ...], task: Task | None) -> Arm:
    """The arm with the effects of the file, under the inputs that the task states.

    Raises:
        InputError: effects that this robot cannot have, or inputs of unknown joints; keys from the top of the file.
    """
    issues = _task_issues(robot, task)
    for index, effect in enumerate(effects):
        try:
            effect.check_robot(robot)
            _check_masses(robot, effect)
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
    if not effects:
        return ()
    from posture_opt.model.effects import Effect

    return tuple(effect for effect in effects if isinstance(effect, Effect))


def effect_sources(
    arm: Arm, effects: tuple[Effect, ...], folder: Path, attached: Mapping[str, str], read: str | None
) -> Sources:
    """What the covariance files of the effects say; ``read`` is the one that the uncertainty has read already.

    Raises:
        InputError: as `read_covariance`.
    """
    found = Sources()
    files = dict.fromkeys(e.covariance for e in effects if e.covariance and e.covariance != read)
    for file in files:
        assert file is not None
        index = next(k for k, effect in enumerate(effects) if effect.covariance == file)
        names, covariance = _read(arm, folder / file, attached.get(file), ("effects", index, "covariance"))
        issues = covariance_issues(names, covariance)
        if issues:
            raise InputError([replace(issue, key=("effects", index, "covariance"), value=file) for issue in issues])
        found = found.plus(Sources(names, (covariance + covariance.T) / 2))
    return found


def _read(arm: Arm, path: Path, text: str | None, key: KeyPath) -> tuple[tuple[str, ...], Array]:
    dimensions = {name: "length" if f.kind == "translate" else "angle" for name, f in arm.robot.parameters.items()}
    try:
        return read_covariance(path, {**dimensions, **arm.dimensions}, text)
    except InputError as error:
        raise InputError([i if i.file else replace(i, key=key, value=path.name) for i in error.issues]) from None


def effects_section(
    entries: Sequence[Mapping[str, Any]], effects: Sequence[CatalogueEntry], names: Sequence[str], file: str
) -> list[dict[str, Any]]:
    """The entries of a file with the covariance ``file`` of the sources ``names`` in place of their own."""
    section = []
    for entry, effect in zip(entries, effects, strict=True):
        plain = {key: value for key, value in entry.items() if key != "covariance"}
        own = {name for moving in moving_effects([effect]) for name in moving.parameter_names}
        section.append({**plain, "covariance": file} if own & set(names) else plain)
    return section


def input_notes(arm: Arm) -> tuple[str, ...]:
    """What was assumed of the inputs of the effects."""
    unknown = sorted({effect.target for effect in arm.effects if "approach" in effect.needs})
    unknown = [joint for joint in unknown if joint not in arm.inputs.stated]
    notes = []
    if unknown:
        told = f"task: {{approach: {{{unknown[0]}: 1}}}} tells it"
        notes.append(f"from which side {', '.join(unknown)} will arrive is not known: it counts as scatter ({told})")
    left = [effect for effect in arm.effects if not effect.for_planning]
    timed = {effect.kind for effect in left if "time" in effect.needs}
    if timed:
        time = float(arm.inputs.time)
        when = f"{time:g} s after the first measurement" if time else "at its beginning (task: {time: 2 h} tells when)"
        notes.append(f"{', '.join(sorted(timed))}: planned as {when}")
    read = {effect.kind for effect in left} - timed
    if read:
        notes.append(f"{', '.join(sorted(read))}: the place of the task is taken as the instrument reads it")
    return tuple(notes)


def _task_issues(robot: Robot, task: Task | None) -> list[Issue]:
    if task is None:
        return []
    return [
        Issue(
            "the robot has no such joint", ("task", "approach", name), name, one_of(name, robot.joint_names, "joints")
        )
        for name in task.approach
        if name not in robot.joint_names
    ]


def _check_masses(robot: Robot, effect: CatalogueEntry) -> None:
    """Refuse an effect of gravity on links whose masses nobody states."""
    if (
        any("masses" in moving.asks for moving in moving_effects([effect]))
        and not ArmState(robot, [0.0] * robot.n).weighed
    ):
        message = "masses or centres of mass of some links are not stated"
        raise BadValueError(message, "add mass and com to the joints")


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
