"""``Problem``: a robot, the sources of its scatter, and what it has to do, ready to be computed with."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from posture_opt.errors import InputError, Issue, KeyPath
from posture_opt.measurements.measurements import DataSpec
from posture_opt.model.arm import Arm
from posture_opt.problem.effects_section import arm_with, effect_sources, input_notes, moving_effects
from posture_opt.problem.issues import schema_issues
from posture_opt.problem.noise_section import measurement_issues, noise_notes, noisy_sources
from posture_opt.problem.plausible import plausibility_notes
from posture_opt.problem.schema import ProblemSpec
from posture_opt.problem.yaml_source import Document, dump_yaml
from posture_opt.robot.robot import Robot
from posture_opt.selection.solvers import Solver
from posture_opt.selection.tasks import Task
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.uncertainty_section import MeasurementSpec, UncertaintySpec

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Problem:
    """What a problem file says, in SI units and radians.

    ``task`` is ``None`` where the file names none; ``notes`` are sentences for the report on what was assumed
    or overridden; ``document`` is the file's plain data, units and all; relative file names start at ``folder``;
    ``origin`` is the file as it was read, ``overridden`` the keys that no longer say what it says; ``attached`` are
    the contents of files that the document names and that stand nowhere else, ``header`` its first lines as comments.
    """

    name: str
    arm: Arm
    sources: Sources
    task: Task | None
    solver: Solver
    effects: tuple[Any, ...]
    measurement: MeasurementSpec | None
    data: DataSpec
    spec: ProblemSpec
    folder: Path
    notes: tuple[str, ...] = ()
    document: Mapping[str, Any] = field(default_factory=dict)
    origin: Document = field(default_factory=lambda: Document({}))
    overridden: frozenset[KeyPath] = frozenset()
    attached: Mapping[str, str] = field(default_factory=dict)
    header: tuple[str, ...] = ()

    @property
    def robot(self) -> Robot:
        """The arm without its effects."""
        return self.arm.robot

    def placed(self, issue: Issue) -> Issue:
        """An issue that computing raised, with the file and line it speaks of; as it is where no file says it."""
        said = issue.key and issue.key[0] in ProblemSpec.model_fields and issue.key[:2] not in self.overridden
        return self.origin.placed(issue) if said else issue

    def with_task(self, kind: str | None = None, **keys: Any) -> Problem:
        """The same problem with the task ``kind`` and other keys of the task replaced, as in the file.

        What the former task says and the new one knows stays: direction, target, clearance.

        Raises:
            InputError: unknown kind or key, or a value that does not fit.
        """
        former = dict(self.document.get("task") or {})
        task = {**former, **({"kind": kind} if kind else {}), **keys}
        for rival, other in (("position", "region"), ("region", "position")):
            if rival in keys and other not in keys:
                task.pop(other, None)
        document = {**self.document, "task": task}
        spec = parse_spec(Document(document))
        notes = self.notes
        if kind and former.get("kind", kind) != kind:
            notes = (*notes, f"the task '{former['kind']}' of the file is overridden by '{kind}'")
        overridden = self.overridden | {("task", key) for key in (*keys, *(["kind"] if kind else []))}
        arm = arm_with(self.robot, self.effects, spec.task)
        former_notes = input_notes(self.arm)
        notes = (*(note for note in notes if note not in former_notes), *input_notes(arm))
        return replace(
            self,
            arm=arm,
            task=spec.task,
            spec=spec,
            document=document,
            notes=notes,
            overridden=frozenset(overridden),
        )

    def with_robot(self, robot: Mapping[str, Any]) -> Problem:
        """The same problem with another ``robot`` section, as in the file.

        Raises:
            InputError: the section does not fit, or the uncertainty names parameters that this robot lacks.
        """
        document = Document({**self.document, "robot": dict(robot)})
        return build_problem(document, self.folder, self.name, attached=self.attached)

    def to_dict(self) -> dict[str, Any]:
        """The plain data of the problem file; ``problem_from_dict`` takes it back."""
        return copy.deepcopy(dict(self.document))

    def to_yaml(self) -> str:
        """The problem file as text, quantities with their units as they were given."""
        return _commented(self.header, dump_yaml(self.to_dict()))

    def files(self, stem: str) -> dict[str, bytes]:
        """File name -> content: the problem file ``stem.yaml`` and what it needs beside it, to be put in any folder."""
        document, beside = self.to_dict(), {}
        names: dict[str, str] = {}
        for section, key, name in (
            ("uncertainty", "covariance", f"{stem}_covariance.csv"),
            ("robot", "file", f"{stem}.urdf"),
        ):
            given = (document.get(section) or {}).get(key)
            if given:
                beside[name] = self._content(given)
                document[section] = {**document[section], key: name}
                names[given] = name
        for effect in document.get("effects") or ():
            given = effect.get("covariance")
            if given:
                name = names.setdefault(given, f"{stem}_effects{len(names) or ''}_covariance.csv")
                beside[name] = self._content(given)
                effect["covariance"] = name
        return {f"{stem}.yaml": _commented(self.header, dump_yaml(document)).encode(), **beside}

    def _content(self, name: str) -> bytes:
        """The content of a file that the document names."""
        if name in self.attached:
            return self.attached[name].encode()
        return (self.folder / Path(name).expanduser()).read_bytes()


def _commented(header: tuple[str, ...], text: str) -> str:
    return "".join(f"# {line}\n" for line in header) + text


def build_problem(
    document: Document, folder: Path, name: str, *, attached: Mapping[str, str] | None = None,
    header: tuple[str, ...] = (),
) -> Problem:  # fmt: skip
    """The problem of a document; ``name`` serves where the document has none, ``attached`` for files that it names.

    Raises:
        InputError: everything wrong with the document, each with file, line and key.
    """
    texts = attached or {}
    spec, arm, sources = _parts(document, folder, texts)
    return Problem(
        name=spec.name or name,
        arm=arm,
        sources=sources,
        task=spec.task,
        solver=spec.solver,
        effects=spec.effects,
        measurement=spec.uncertainty.measurement,
        data=spec.data,
        spec=spec,
        folder=folder,
        notes=(
            *sources.notes,
            *plausibility_notes(arm.robot, spec.uncertainty, sources),
            *input_notes(arm),
            *(noise_notes(spec.effects) if spec.effects else ()),
        ),
        document=document.data,
        origin=document,
        attached=texts,
        header=header,
    )


def _parts(document: Document, folder: Path, texts: Mapping[str, str]) -> tuple[ProblemSpec, Arm, Sources]:
    """What the document says, the arm with its effects, and what is uncertain of it; all issues at once."""
    issues = list(document.issues)
    data, broken = _sections(document, issues)
    spec = ProblemSpec.model_validate(data) if "robot" in data else None
    robot, arm, sources = None, None, None
    if spec is not None:
        robot = _collect(issues, "robot", lambda: spec.robot.build(folder))
    if spec is not None and robot is not None:
        plain = robot
        arm = _collect(issues, "", lambda: arm_with(plain, spec.effects, spec.task))
    if spec is not None and arm is not None and "uncertainty" not in broken:
        extended = arm
        sources = _collect(issues, "uncertainty", lambda: spec.uncertainty.build(extended, folder, texts))
        if sources is not None and spec.effects:
            stated = sources
            sources = _collect(issues, "", lambda: _with_effects(spec, extended, stated, folder, texts))
    elif "uncertainty" in data:
        uncertainty = UncertaintySpec.model_validate(data["uncertainty"])
        _collect(issues, "uncertainty", uncertainty.check)
    _refuse(issues, document)
    assert spec is not None
    assert arm is not None
    assert sources is not None
    return spec, arm, sources


def _with_effects(
    spec: ProblemSpec, arm: Arm, stated: Sources, folder: Path, texts: Mapping[str, str]
) -> Sources:  # fmt: skip
    """The stated sources, those of the effects' estimates, and what effects that move nothing do to them."""
    issues = measurement_issues(spec.uncertainty.measurement, spec.effects)
    if issues:
        raise InputError(issues)
    moving = moving_effects(spec.effects)
    more = effect_sources(arm, moving, folder, texts, spec.uncertainty.covariance)
    return noisy_sources(stated.plus(more), arm.robot, spec.effects)


def parse_spec(document: Document) -> ProblemSpec:
    """The validated sections of a document.

    Raises:
        InputError: everything that does not fit the schema.
    """
    issues = list(document.issues)
    data, _ = _sections(document, issues)
    _refuse(issues, document)
    return ProblemSpec.model_validate(data)


def _sections(document: Document, issues: list[Issue]) -> tuple[dict[str, Any], set[str]]:
    """The sections that fit the schema and the names of those that do not, whose faults join ``issues``."""
    # An optional section with nothing under it counts as left out; a task or robot with nothing in it does not.
    data = {key: value for key, value in document.data.items() if value is not None or key == "robot"}
    found = schema_issues(data)
    issues += found
    broken = {str(issue.key[0]) for issue in found if issue.key}
    return {key: value for key, value in data.items() if key not in broken}, broken


def _refuse(issues: list[Issue], document: Document) -> None:
    if issues:
        raise InputError(sorted((document.placed(issue) for issue in issues), key=lambda issue: issue.line))


def _collect(issues: list[Issue], section: str, build: Callable[[], T]) -> T | None:
    """What ``build`` makes, or ``None`` with its issues added under ``section``."""
    try:
        return build()
    except InputError as error:
        issues += [issue.at(section) if section and not issue.file else issue for issue in error.issues]
        return None
