"""From the data of a problem file to its parts: sections against the schema, robot, sources of error, notes.

All that is wrong with a file is reported in one run: a section that cannot be read leaves the others to be checked,
and checks that depend on it are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from posture_opt.collision.obstacles.mesh import Mesh
from posture_opt.errors import InputError, Issue, listed
from posture_opt.measurements.header import data_issues
from posture_opt.model.arm import Arm
from posture_opt.model.effects import CatalogueEntry, NoiseEffect
from posture_opt.problem.camera_files import with_camera_files
from posture_opt.problem.effects_section import (
    arm_with,
    effect_sources,
    measurement_issues,
    moving_effects,
    noisy_sources,
)
from posture_opt.problem.issues import schema_issues
from posture_opt.problem.path_file import far_points, with_path
from posture_opt.problem.plain_data import Section
from posture_opt.problem.readable import Readable
from posture_opt.problem.schema import ProblemSpec, read_sections
from posture_opt.problem.second_arms import with_second_arms
from posture_opt.problem.yaml_source import ProblemDocument
from posture_opt.robot.corrections import corrected
from posture_opt.robot.format import check_payload
from posture_opt.robot.robot import Repeatability, Robot
from posture_opt.robot.urdf import pitched_rolls
from posture_opt.selection.tasks import Task
from posture_opt.texts import checked
from posture_opt.uncertainty.sources.repeatability import joint_sigmas
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.sources.uncertainty_section import UncertaintySpec

T = TypeVar("T")
FAR = 20.0
"""So many times off the data sheet a stated scatter is remarked on: an arm may be worn, or badly calibrated."""


def read_parts(
    document: ProblemDocument, folder: Path, texts: Mapping[str, str]
) -> tuple[ProblemSpec, tuple[Robot, Arm], tuple[Sources, Sources]]:
    """What the document says, the nominal robot and the arm, the stated sources and all sources.

    Args:
        document: the data with the lines of their keys.
        folder: where relative file names start; ``texts`` contents of files that exist nowhere else.

    Raises:
        InputError: everything wrong with the document, in the order of its lines.
    """
    data, unreadable = checked(_given(document))
    wrong = [*document.issues, *unreadable]
    found = schema_issues(data)
    readable = Readable.of(data, found)
    issues: list[Issue] = []
    spec = read_sections(readable.data) if "robot" in readable.data else None
    arms, sources = None, None
    if spec is not None:
        read = spec
        arms = _arms(read, folder, issues)
        task = _collect(issues, lambda: with_path(read.task, folder))
        task = _collect(issues, lambda: _with_workpiece(task, folder))
        task = task.for_robot(arms[1].robot) if task is not None and arms else task
        data = _collect(issues, lambda: with_camera_files(read.data, folder)) or read.data
        files = data
        data = _collect(issues, lambda: with_second_arms(files, folder, read_parts)) or data
        cell = _collect(issues, lambda: read.cell and read.cell.in_folder(folder))
        spec = spec.model_copy(update={"task": task, "data": data, "cell": cell})
        issues += [issue.at("data") for issue in data_issues(spec.data, arms[1].robot)] if arms else []
        issues += far_points(task, arms[1].robot) if arms else []
    if spec is not None and arms is not None:
        read, arm, sound = spec, arms[1], not found and not issues
        sources = _collect(issues, lambda: _sources(read, arm, folder, texts, sound))
    elif "uncertainty" in readable.data:
        uncertainty = UncertaintySpec.model_validate(readable.data["uncertainty"])
        _collect(issues, lambda: _at("uncertainty", uncertainty.check))
    reported = {issue.key for issue in wrong}
    more = [*found, *(readable.placed(issue) for issue in issues if readable.judged(issue))]
    wrong += [issue for issue in more if issue.key not in reported]
    _refuse(wrong, document)
    assert spec is not None
    assert arms is not None
    assert sources is not None
    return spec, arms, sources


def _with_workpiece(task: Task | None, folder: Path) -> Task | None:
    """The task with the file of its workpiece read.

    Raises:
        InputError: it cannot be used, by its key.
    """
    if task is None or task.workpiece is None:
        return task
    part = task.workpiece
    return task.model_copy(update={"workpiece": _at("task", lambda: _at("workpiece", lambda: part.in_folder(folder)))})


def fixed_part(task: Task | None) -> Mesh | None:
    """The workpiece as an obstacle, where it has a shape and a fixed place."""
    part = None if task is None else task.workpiece
    return part.solid(part.lower) if part is not None and part.fixed else None


def part_notes(task: Task | None) -> tuple[str, ...]:
    """How the shape of the workpiece is checked, where it has one."""
    return () if task is None or task.workpiece is None else task.workpiece.notes


def _arms(spec: ProblemSpec, folder: Path, issues: list[Issue]) -> tuple[Robot, Arm] | None:
    """The nominal robot, and the arm with corrections and effects; where one of these cannot be used, without it.

    What is wrong is added to ``issues``; there is no arm where there is no nominal robot. A shape that cannot be used
    is left out, so that the joints are still there for what names them.
    """
    nominal = _collect(issues, lambda: _at("robot", lambda: spec.robot.nominal(folder)))
    if nominal is None and spec.robot.shape is not None:
        bare = spec.robot.model_copy(update={"shape": None})
        nominal = _collect([], lambda: bare.nominal(folder))
    if nominal is None:
        return None
    known = nominal
    _collect(issues, lambda: _at("robot", lambda: check_payload(known)))
    plain = _collect(issues, lambda: _at("robot", lambda: corrected(known, spec.robot.corrections))) or known
    arm = _collect(issues, lambda: arm_with(plain, spec.effects, spec.task))
    return known, arm or Arm(plain)


def _sources(
    spec: ProblemSpec, arm: Arm, folder: Path, texts: Mapping[str, str], sound: bool
) -> tuple[Sources, Sources]:
    """The stated sources, with the estimates of effects among them, and these with what noise effects do to them.

    Args:
        sound: whether the file has no issues so far; else only the names are checked that are none of an effect.

    Raises:
        InputError: parameters, files or correlations that cannot be used; keys from the top of the file.
    """
    if not sound:
        stated = spec.uncertainty
        names = {key: value for key, value in stated.sigma.items() if "(" not in key}
        pairs = tuple(pair for pair in stated.correlation if not any("(" in name for name in pair[:2]))
        bare = stated.model_copy(update={"sigma": names, "correlation": pairs, "covariance": None})
        found = _at("uncertainty", lambda: bare.build(arm, folder, texts))
        return found, found
    stated_sources = _at("uncertainty", lambda: spec.uncertainty.build(arm, folder, texts))
    issues = measurement_issues(spec.uncertainty.measurement, spec.effects)
    if issues:
        raise InputError(issues)
    stated_sources = stated_sources.plus(
        effect_sources(arm, moving_effects(spec.effects), folder, texts, spec.uncertainty.covariance)
    )
    return stated_sources, noisy_sources(stated_sources, arm.robot, spec.effects)


def parse_spec(document: ProblemDocument) -> ProblemSpec:
    """The validated sections of a document.

    Raises:
        InputError: everything that does not fit the schema.
    """
    data, unreadable = checked(_given(document))
    _refuse([*document.issues, *unreadable, *schema_issues(data)], document)
    return read_sections(data)


def _given(document: ProblemDocument) -> Section:
    """The sections of a document; an optional one with nothing under it counts as left out."""
    return {key: value for key, value in document.data.items() if value is not None or key == "robot"}


def _refuse(issues: list[Issue], document: ProblemDocument) -> None:
    """Raises the issues, if there are any, with file and line, in the order of the lines."""
    if issues:
        raise InputError(sorted((document.placed(issue) for issue in issues), key=lambda issue: issue.line))


def _collect(issues: list[Issue], build: Callable[[], T]) -> T | None:
    """What ``build`` makes, or ``None`` with its issues added."""
    try:
        return build()
    except InputError as error:
        issues += error.issues
        return None


def _at(section: str, build: Callable[[], T]) -> T:
    """What ``build`` makes; keys of its issues, relative to the section, count from the top of the file."""
    try:
        return build()
    except InputError as error:
        raise InputError([issue if issue.file else issue.at(section) for issue in error.issues]) from error


def problem_notes(
    arm: Arm, stated: UncertaintySpec, sources: Sources, effects: Sequence[CatalogueEntry]
) -> tuple[str, ...]:
    """All notes of a problem: on its sources, on numbers that are far off, on the inputs of effects, on noise.

    Notes are remarks, not errors: the problem is computed as it is written.
    """
    return (
        *sources.notes,
        *plausibility_notes(arm.robot, stated, sources),
        *input_notes(arm),
        *noise_notes(effects),
        *roll_notes(arm.robot, sources),
    )


def roll_notes(robot: Robot, sources: Sources) -> tuple[str, ...]:
    """Where an error or a correction of a URDF roll is not that of the number in the file.

    A URDF's ``rpy`` is applied as Rz(yaw) Ry(pitch) Rx(roll); where the pitch is not zero, the roll that errors are of
    turns about another axis than the file's number suggests.
    """
    moved = [name for name in pitched_rolls(robot) if name in sources.names or robot.parameters[name].nominal]
    if not moved:
        return ()
    verb = "is a turn" if len(moved) == 1 else "are turns"
    which = "of its origin is applied" if len(moved) == 1 else "of their origins is applied"
    return (f"{listed(moved)} {verb} about x before the pitch {which}: at right angles to the axes of pitch and yaw",)


def input_notes(arm: Arm) -> tuple[str, ...]:
    """What was assumed of the inputs of the effects: sides of approach, time, and how the instrument reads places."""
    unknown = sorted({effect.target for effect in arm.effects if "approach" in effect.needs})
    unknown = [joint for joint in unknown if joint not in arm.inputs.stated]
    notes = []
    if unknown:
        hint = f"task: {{approach: {{{unknown[0]}: 1}}}} states it"
        notes.append(f"from which side {', '.join(unknown)} will arrive is not known: it counts as scatter ({hint})")
    left = [effect for effect in arm.effects if not effect.for_planning]
    timed = {effect.kind for effect in left if "time" in effect.needs}
    if timed:
        time = float(arm.inputs.time)
        when = f"{time:g} s after the first measurement" if time else "at its beginning (task: {time: 2 h} says when)"
        notes.append(f"{', '.join(sorted(timed))}: planned as {when}")
    read = {effect.kind for effect in left} - timed
    if read:
        notes.append(f"{', '.join(sorted(read))}: the place of the task is taken as the instrument reads it")
    return tuple(notes)


def noise_notes(effects: Sequence[CatalogueEntry]) -> tuple[str, ...]:
    """Which effects have no part in the spread of the tool point."""
    kinds = [e.kind for e in effects if isinstance(e, NoiseEffect) and not e.of_arm]
    if not kinds:
        return ()
    return (f"{', '.join(dict.fromkeys(kinds))}: of the measurement alone, no part of the spread of the tool point",)


def plausibility_notes(robot: Robot, stated: UncertaintySpec, sources: Sources) -> tuple[str, ...]:
    """What is far off the robot's data sheet, in sentences for the report; nothing where there is no data sheet.

    "Far" is a factor of more than ``FAR`` either way: mostly a wrong unit.
    """
    sheet = robot.repeatability
    if sheet is None:
        return ()
    notes = []
    if stated.repeatability is not None and _far(stated.repeatability / sheet.value):
        given, times = f"{stated.repeatability * 1e3:g} mm", _times(stated.repeatability / sheet.value)
        notes.append(
            f"the stated repeatability {given} is {times} the data sheet's {_sheet(sheet)}: is its unit right?"
        )
    own = {robot.factors[i].parameter for i in robot.driven}
    named = sources.names if stated.repeatability is None and stated.covariance else tuple(stated.sigma)
    if own & set(named):
        notes += _joint_notes(
            robot, sheet, stated, {n: s for n, s in _sigmas(sources).items() if n in own & set(named)}
        )
    return tuple(notes)


def _joint_notes(robot: Robot, sheet: Repeatability, stated: UncertaintySpec, sigma: dict[str, float]) -> list[str]:
    """The σ of a joint that is farthest off what the data sheet's repeatability gives, in one note.

    Args:
        sheet: repeatability of the data sheet; ``sigma`` of the joints [rad or m].
    """
    usual = _sigmas(joint_sigmas(robot, sheet.value))
    ratios = {name: value / usual[name] for name, value in sigma.items() if name in usual and value > 0}
    # A covariance is what a calibration leaves unknown, which many rows make as small as one likes.
    far = {name: ratio for name, ratio in ratios.items() if ratio > FAR or (_far(ratio) and name in stated.sigma)}
    if not far:
        return []
    name = max(far, key=lambda name: max(far[name], 1 / far[name]))
    given = f", {stated.sigma[name]}," if name in stated.sigma else ""
    more = f" (and {len(far) - 1} more are far off too)" if len(far) > 1 else ""
    return [
        f"the standard deviation of {name}{given} is {_times(far[name])} what the data sheet's repeatability "
        f"{_sheet(sheet)} leaves it{more}: is its unit right?"
    ]


def _sigmas(sources: Sources) -> dict[str, float]:
    """Standard deviation [rad or m] of every source."""
    return dict(zip(sources.names, map(float, sources.sigma), strict=True))


def _far(ratio: float) -> bool:
    """Whether a ratio is more than ``FAR`` away from 1, either way."""
    return not 1 / FAR <= ratio <= FAR


def _times(ratio: float) -> str:
    """A ratio to two digits in words: 30 times, 1/40 of."""
    return f"{float(f'{ratio:.2g}'):g} times" if ratio > 1 else f"1/{float(f'{1 / ratio:.2g}'):g} of"


def _sheet(sheet: Repeatability) -> str:
    """The repeatability of a data sheet in mm."""
    return f"{sheet.value * 1e3:g} mm"
