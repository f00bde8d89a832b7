"""From the data of a problem file to its parts: sections against the schema, robot, sources of error, notes."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from posture_opt.collision.obstacles.mesh import Mesh
from posture_opt.errors import InputError, Issue, KeyPath, listed
from posture_opt.measurements.header import data_issues
from posture_opt.model.arm import Arm
from posture_opt.model.effects import CatalogueEntry, NoiseEffect
from posture_opt.problem.effects_section import (
    arm_with,
    effect_sources,
    measurement_issues,
    moving_effects,
    noisy_sources,
)
from posture_opt.problem.issues import schema_issues
from posture_opt.problem.named_files import far_points, with_named_files, with_path
from posture_opt.problem.schema import ProblemSpec, entry_at, read_sections
from posture_opt.problem.yaml_source import Plain, ProblemDocument, Section
from posture_opt.robot.corrections import corrected
from posture_opt.robot.format import check_payload
from posture_opt.robot.robot import Robot
from posture_opt.robot.urdf import pitched_rolls
from posture_opt.selection.tasks import Task
from posture_opt.texts import checked
from posture_opt.uncertainty.repeatability import joint_sigmas
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.uncertainty_section import UncertaintySpec

# Lists whose entries speak for themselves: one that cannot be read leaves the others
_SEPARABLE_LISTS: tuple[KeyPath, ...] = (
    ("effects",),
    ("task", "minimize"),
    ("task", "subject_to"),
    ("task", "features"),
    ("robot", "shape"),
    ("robot", "shape", "add"),
    ("robot", "shape", "replace"),
    ("cell", "obstacles"),
    ("data", "distances"),
)

# Values of a joint that replace one that cannot be read, where leaving it out would be a fault of its own
_STAND_IN_VALUES: Section = {"mass": "1 kg", "com": [0, 0, 0]}


@dataclass(frozen=True)
class Readable:
    """Sections that fit the schema, what does not fit left out of them."""

    data: Section  # the sections that are left
    broken: frozenset[str]  # sections of which something was left out
    kept: Mapping[KeyPath, tuple[int, ...]]  # of each list with entries left out, the numbers that the others had

    @classmethod
    def of(cls, data: Mapping[str, Plain], found: Iterable[Issue]) -> Readable:
        keys = [issue.key for issue in found if issue.key]
        left = copy.deepcopy(dict(data))
        entries = {key: path for key in keys for path in _SEPARABLE_LISTS if _is_entry(key, path)}
        kept: dict[KeyPath, tuple[int, ...]] = {}
        for path in dict.fromkeys(entries.values()):
            owner, bad = entry_at(left, path[:-1]), {key[len(path)] for key in keys if _is_entry(key, path)}
            rows = owner[path[-1]]
            kept[path] = tuple(k for k in range(len(rows)) if k not in bad)
            owner[path[-1]] = [rows[k] for k in kept[path]]
        for key in keys:
            if key not in entries:
                _left_out(left, key)
        for issue in schema_issues(left) if keys and "robot" in left else ():  # what could not do without it
            left.pop(str(issue.key[0]) if issue.key else "", None)
        return cls(left, frozenset(str(key[0]) for key in keys), kept)

    def placed(self, issue: Issue) -> Issue:
        """The issue about what is left as one about the file: entries of lists have their own number again."""
        for path, numbers in self.kept.items():
            if _is_entry(issue.key, path):
                number = numbers[int(issue.key[len(path)])]
                return replace(issue, key=(*path, number, *issue.key[len(path) + 1 :]))
        return issue

    def judged(self, issue: Issue) -> bool:
        """Whether the issue does not come from what is left out: only names are judged where a section is broken."""
        return not issue.key or issue.key[0] not in self.broken or len(issue.key) > 2 or issue.key[0] == "effects"


def _is_entry(key: KeyPath, path: KeyPath) -> bool:
    return len(key) > len(path) and key[: len(path)] == path and isinstance(key[len(path)], int)


def _left_out(data: Section, key: KeyPath) -> None:
    # Masses and centres of mass of a joint are replaced by plain ones, as leaving them out would be a fault of its
    # own. Correlations are removed with the σ's that they need.
    section = data.get(str(key[0]))
    if len(key) == 1 or not isinstance(section, dict) or key[1] == "kind":
        data.pop(str(key[0]), None)
    elif key[:2] == ("robot", "joints") and len(key) > 3 and isinstance(row := entry_at(section, key[1:3]), dict):
        row.pop(key[3], None)
        row.update({key[3]: _STAND_IN_VALUES[str(key[3])]} if key[3] in _STAND_IN_VALUES else {})
    else:
        section.pop(str(key[1]), None)
        if key == ("uncertainty", "sigma"):
            section.pop("correlation", None)


T = TypeVar("T")
FAR = 20.0  # So many times off the data sheet a stated scatter is remarked on: an arm may be worn, or badly calibrated


def read_parts(
    document: ProblemDocument, folder: Path, texts: Mapping[str, str]
) -> tuple[ProblemSpec, tuple[Robot, Arm], tuple[Sources, Sources]]:
    """What the document says, the nominal robot and the arm, the stated sources and all sources."""
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
        if task is not None and task.workpiece is not None:
            known, part = task, task.workpiece
            solid = _collect(issues, lambda: part.in_folder(folder), "task", "workpiece")
            task = known.model_copy(update={"workpiece": solid}) if solid else None
        if task is not None and arms:
            stated, arm = task, arms[1]
            task = _collect(issues, lambda: stated.for_robot(arm.robot))
        data, unread = with_named_files(read.data, folder, read_parts)
        issues += unread
        cell = _collect(issues, lambda: read.cell and read.cell.in_folder(folder))
        spec = spec.model_copy(update={"task": task, "data": data, "cell": cell})
        issues += [issue.at("data") for issue in data_issues(spec.data, arms[1].robot)] if arms else []
        issues += far_points(task, arms[1].robot) if arms else []
    if spec is not None and arms is not None:
        read, arm, sound = spec, arms[1], not found and not issues
        sources = _collect(issues, lambda: _sources(read, arm, folder, texts, sound))
    elif "uncertainty" in readable.data:
        uncertainty = UncertaintySpec.model_validate(readable.data["uncertainty"])
        _collect(issues, uncertainty.check, "uncertainty")
    reported = {issue.key for issue in wrong}
    more = [*found, *(readable.placed(issue) for issue in issues if readable.judged(issue))]
    wrong += [issue for issue in more if issue.key not in reported]
    _refuse(wrong, document)
    assert spec is not None
    assert arms is not None
    assert sources is not None
    return spec, arms, sources


def fixed_part(task: Task | None) -> Mesh | None:
    """The workpiece as an obstacle, where it has a shape and a fixed place."""
    part = None if task is None else task.workpiece
    return part.solid(part.lower) if part is not None and part.fixed else None


def part_notes(task: Task | None) -> tuple[str, ...]:
    """How the shape of the workpiece is checked, where it has one."""
    return () if task is None or task.workpiece is None else task.workpiece.notes


def _arms(spec: ProblemSpec, folder: Path, issues: list[Issue]) -> tuple[Robot, Arm] | None:
    nominal = _collect(issues, lambda: spec.robot.nominal(folder), "robot")
    if nominal is None and spec.robot.shape is not None:
        bare = spec.robot.model_copy(update={"shape": None})
        nominal = _collect([], lambda: bare.nominal(folder))
    if nominal is None:
        return None
    known = nominal
    _collect(issues, lambda: check_payload(known), "robot")
    plain = _collect(issues, lambda: corrected(known, spec.robot.corrections), "robot") or known
    arm = _collect(issues, lambda: arm_with(plain, spec.effects, spec.task))
    return known, arm or Arm(plain)


def _sources(
    spec: ProblemSpec, arm: Arm, folder: Path, texts: Mapping[str, str], sound: bool
) -> tuple[Sources, Sources]:
    stated = spec.uncertainty
    if not sound:
        names = {key: value for key, value in stated.sigma.items() if "(" not in key}
        pairs = tuple(pair for pair in stated.correlation if not any("(" in name for name in pair[:2]))
        stated = stated.model_copy(update={"sigma": names, "correlation": pairs, "covariance": None})
    issues: list[Issue] = []
    found = _collect(issues, lambda: stated.build(arm, folder, texts), "uncertainty")
    issues += measurement_issues(stated.measurement, spec.effects) if sound and found else []
    if found is None or issues:
        raise InputError(issues)
    if not sound:
        return found, found
    found = found.plus(effect_sources(arm, moving_effects(spec.effects), folder, texts, stated.covariance))
    return found, noisy_sources(found, arm.robot, spec.effects)


def parse_spec(document: ProblemDocument) -> ProblemSpec:
    """The validated sections of a document."""
    data, unreadable = checked(_given(document))
    _refuse([*document.issues, *unreadable, *schema_issues(data)], document)
    return read_sections(data)


def _given(document: ProblemDocument) -> Section:
    return {key: value for key, value in document.data.items() if value is not None or key == "robot"}


def _refuse(issues: list[Issue], document: ProblemDocument) -> None:
    if issues:
        raise InputError(sorted((document.placed(issue) for issue in issues), key=lambda issue: issue.line))


def _collect(issues: list[Issue], build: Callable[[], T], *section: str) -> T | None:
    """What ``build`` makes, or ``None`` with its issues added; keys in a ``section`` count from the top of the file."""
    try:
        return build()
    except InputError as error:
        issues += [issue if issue.file or not section else issue.at(*section) for issue in error.issues]
        return None


def problem_notes(
    arm: Arm, stated: UncertaintySpec, sources: Sources, effects: Sequence[CatalogueEntry]
) -> tuple[str, ...]:
    """All notes of a problem: on its sources, on numbers that are far off, on the inputs of effects, on noise."""
    noise = dict.fromkeys(e.kind for e in effects if isinstance(e, NoiseEffect) and not e.of_arm)
    of_noise = (
        [f"{', '.join(noise)}: of the measurement alone, no part of the spread of the tool point"] if noise else []
    )
    far = plausibility_notes(arm.robot, stated, sources)
    of_robot = arm.robot.notes if arm.robot.description else ()
    return (*sources.notes, *of_robot, *far, *input_notes(arm), *of_noise, *roll_notes(arm.robot, sources))


def roll_notes(robot: Robot, sources: Sources) -> tuple[str, ...]:
    """Where an error or a correction of a URDF roll is not that of the number in the file."""
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


def plausibility_notes(robot: Robot, stated: UncertaintySpec, sources: Sources) -> tuple[str, ...]:
    """What is far off the robot's data sheet, in sentences for the report; nothing where there is no data sheet."""
    sheet = robot.repeatability
    if sheet is None:
        return ()
    notes, usual_text = [], f"{sheet.value * 1e3:g} mm"
    if stated.repeatability is not None and _far(stated.repeatability / sheet.value):
        given, times = f"{stated.repeatability * 1e3:g} mm", _times(stated.repeatability / sheet.value)
        notes.append(f"the stated repeatability {given} is {times} the data sheet's {usual_text}: is its unit right?")
    named = sources.names if stated.repeatability is None and stated.covariance else tuple(stated.sigma)
    joints = {robot.factors[i].parameter for i in robot.driven} & set(named)
    usual = _sigmas(joint_sigmas(robot, sheet.value)) if joints else {}
    ratios = {n: s / usual[n] for n, s in _sigmas(sources).items() if n in joints and n in usual and s > 0}
    # A covariance is what a calibration leaves unknown, which many rows make as small as one likes.
    far = {name: ratio for name, ratio in ratios.items() if ratio > FAR or (_far(ratio) and name in stated.sigma)}
    if far:
        name = max(far, key=lambda name: max(far[name], 1 / far[name]))
        given = f", {stated.sigma[name]}," if name in stated.sigma else ""
        more = f" (and {len(far) - 1} more are far off too)" if len(far) > 1 else ""
        notes.append(
            f"the standard deviation of {name}{given} is {_times(far[name])} what the data sheet's repeatability "
            f"{usual_text} leaves it{more}: is its unit right?"
        )
    return tuple(notes)


def _sigmas(sources: Sources) -> dict[str, float]:
    """Standard deviation [rad or m] of every source."""
    return dict(zip(sources.names, map(float, sources.sigma), strict=True))


def _far(ratio: float) -> bool:
    return not 1 / FAR <= ratio <= FAR


def _times(ratio: float) -> str:
    return f"{float(f'{ratio:.2g}'):g} times" if ratio > 1 else f"1/{float(f'{1 / ratio:.2g}'):g} of"
