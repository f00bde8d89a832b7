"""A problem: what its file says, changed by its keys, and written."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from posture_opt import explorer_of
from posture_opt.errors import Issue, KeyPath
from posture_opt.files import located, named_content
from posture_opt.limits import MAX_URDF_BYTES
from posture_opt.model.effects import Effect
from posture_opt.problem.effects_section import arm_with, moving_effects, noisy_sources
from posture_opt.problem.fitting import (
    arm_of,
    commented,
    fitted_document,
    fitted_effects,
    fitted_robots,
    released_document,
    rounded,
    sources_text,
    with_workpiece,
)
from posture_opt.problem.named_files import named_files, second_document, with_path
from posture_opt.problem.parts import fixed_part, input_notes, parse_spec, part_notes, problem_notes, read_parts
from posture_opt.problem.schema import ProblemSpec, kept_of_task, replaced_data
from posture_opt.problem.yaml_source import Plain, ProblemDocument, Section
from posture_opt.robot.meshes import with_whole_paths
from posture_opt.robot.posture import Posture
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import FittedArm, ProblemData
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.uncertainty_section import UncertaintySpec

if TYPE_CHECKING:
    from posture_opt.calibration.calibration import Calibration
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.measurements.measurements import Measurements


class LivePage(Protocol):
    """A live page in a browser, as `Problem.explore` starts it."""

    @property
    def url(self) -> str:
        """Its address."""

    @property
    def target(self) -> tuple[float, float, float]:
        """Where the tool point is asked for, x, y, z [m], world; it can be set, and the page follows."""

    @target.setter
    def target(self, position: Sequence[float]) -> None: ...

    @property
    def posture(self) -> Posture | None:
        """The posture of the latest answer; None while none is feasible."""

    @property
    def solution(self) -> Solution | None:
        """The latest answer; None while none is feasible."""

    def close(self) -> None:
        """End the page, and everything that it computes."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Problem(ProblemData):
    """What a problem file says, in SI units and radians, and the file itself: read, changed by its keys, written.

    Args:
        name: of the problem.
        arm: the robot with its corrections and effects, under the inputs of the task.
        nominal: the robot without corrections and effects.
        stated: the sources of error as they are stated; ``sources`` with what effects add from repeat to repeat.
        task: None where the file names none.
        effects: those that move the tool point, ``arm.effects``, and those that only add scatter.
        measurement: the standard deviations of the instrument; None where none is stated.
        data: how files of the instrument are written.
        cell: obstacles, and whether the arm may collide with itself; None where nothing is stated.
        within_measured: whether postures are chosen where the effects were measured that hold nowhere else.
        notes: sentences for the report on what was assumed or overridden.
        folder: where relative file names start.
        document: the plain data of the file, units and all.
        origin: the file as it was read; ``overridden`` the keys that no longer say what it says.
        attached: the contents of files that the document names and that exist nowhere else, by their names.
        header: the first lines of the file, as comments.
        second_arms: name -> the arm that this one touched, where it was found with it; its own file is as it was.
    """

    folder: Path
    document: Mapping[str, Plain] = field(default_factory=dict)
    origin: ProblemDocument = field(default_factory=lambda: ProblemDocument({}))
    overridden: frozenset[KeyPath] = frozenset()
    attached: Mapping[str, str] = field(default_factory=dict)
    header: tuple[str, ...] = ()
    second_arms: Mapping[str, Problem] = field(default_factory=dict)

    def placed(self, issue: Issue) -> Issue:
        """An issue that computing raised, with the file and line it speaks of; as it is where no file says it."""
        said = issue.key and issue.key[0] in ProblemSpec.model_fields and issue.key[:2] not in self.overridden
        return self.origin.placed(issue) if said else issue

    def with_task(self, kind: str | None = None, **keys: Plain) -> Problem:
        """The same problem with the task ``kind`` and other keys of the task replaced, as in the file.

        Keys that both tasks have stay: direction, target, clearance.

        Args:
            kind: name of the task; default: the same.
            keys: of the task section, as in `replace`.

        Raises:
            InputError: unknown kind or key, or a value that does not fit.
        """
        former = dict(self.document.get("task") or {})
        task = {**kept_of_task(former, kind, keys), **({"kind": kind} if kind else {}), **keys}
        document = {**self.document, "task": task}
        spec = parse_spec(ProblemDocument(document))
        notes = self.notes
        if kind and former.get("kind", kind) != kind:
            notes = (*notes, f"the task '{former['kind']}' of the file is overridden by '{kind}'")
        overridden = self.overridden | {("task", key) for key in (*keys, *(["kind"] if kind else []))}
        found = with_path(spec.task, self.folder)
        found = found and found.for_robot(self.robot)
        arm = arm_with(self.robot, self.effects, found)
        notes = (*(note for note in notes if note not in input_notes(self.arm)), *input_notes(arm))
        return replace(self, arm=arm, task=found, document=document, notes=notes, overridden=overridden)

    def replace(self, **changes: Plain) -> Problem:
        """The same problem with other values at some keys of its file, two underscores between the parts of a key.

        A new target replaces one that was stated in another way. Entries of a list go by their name or number,
        ``robot__joints__elbow__a``, and keys with a point as ``**{"uncertainty__sigma__elbow.theta": 3e-4}``.

        Args:
            changes: quantities with units as in the file, or numbers and arrays in SI units and radians. Each
                replaces everything at its key; None removes the key.

        Raises:
            InputError: everything that does not fit, by the key.

        Example:
            >>> import posture_opt as po
            >>> po.load_problem("insert_ur10").replace(task__clearance="0.3 mm").task.clearance
            0.0003
        """
        data, keys = replaced_data(self.document, changes, self.robot)
        return replace(self._of(data), header=self.header, origin=self.origin, overridden=self.overridden | keys)

    def with_task_of(self, other: Problem) -> Problem:
        """The same arm in the same cell with the task of another problem, whose path stays where it is.

        Errors of the workpiece belong to the task.

        Raises:
            InputError: the task names joints that this arm lacks.
        """
        task = dict(other.document.get("task") or {})
        if task.get("path"):
            task["path"] = str(other.folder.absolute() / task["path"])
        arm = arm_with(self.robot, self.effects, other.task)
        uncertainty = with_workpiece(self.document.get("uncertainty"), other.document.get("uncertainty"))
        return replace(
            self, arm=arm, task=other.task, workpiece_sources=other.workpiece_sources, part=other.part,
            document={**self.document, "task": task, **({"uncertainty": uncertainty} if uncertainty else {})},
            notes=(*(note for note in self.notes if note not in input_notes(self.arm)), *input_notes(arm)),
            overridden=self.overridden | {("task",)},
        )  # fmt: skip

    def of_robot(self) -> Problem:
        """The robot, what is uncertain about it, its effects and its data, without a task and a cell."""
        sections = ("name", "robot", "uncertainty", "effects", "data")
        kept = {key: value for key, value in self.document.items() if key in sections}
        if kept.get("uncertainty"):
            kept["uncertainty"] = with_workpiece(kept["uncertainty"], None)
        document = ProblemDocument(kept, self.origin.file, self.origin.lines)
        return build_problem(document, self.folder, self.name, attached=self.attached)

    def with_robot(self, robot: Mapping[str, Plain]) -> Problem:
        """The same problem with another robot.

        Args:
            robot: the section ``robot``, as in a file.

        Raises:
            InputError: the section does not fit, or the uncertainty names parameters that this robot lacks.
        """
        return self._of({**self.document, "robot": dict(robot)})

    def with_sigma(self, sigma: Mapping[str, str]) -> Problem:
        """The same problem where nothing but these standard deviations is uncertain.

        Args:
            sigma: ``JOINT.PARAMETER`` -> quantity with its unit, such as ``"0.2 mrad"``.

        Raises:
            InputError: unknown parameters, or values without their unit.
        """
        return self._of({**self.document, "uncertainty": {"sigma": dict(sigma)}})

    def _of(self, document: Section) -> Problem:
        return build_problem(ProblemDocument(document), self.folder, self.name, attached=self.attached)

    def with_fit(self, fit: FittedArm | Calibration | Diagnosis) -> Problem:
        """The same problem with the arm that measurements found: its parameters, effects, covariance and scatter.

        Args:
            fit: a calibration; a diagnosis, which brings effects too; or the arm itself.

        Frames that were found are numbers and no longer free. `files` writes it as a complete problem file with its
        covariance next to it; standard deviations from repeat to repeat have the four digits that they have there.

        Raises:
            InputError: the fit is one of another robot.
        """
        fit = arm_of(self, fit)
        nominal, plain = fitted_robots(self.nominal, self.robot, fit)
        effects = fitted_effects(self.effects, fit)
        name = f"{self.name.removesuffix(f', {fit.label}')}, {fit.label}" if fit.label else self.name
        document = fitted_document(self.document, name, nominal, plain, effects, fit)
        second_arms: dict[str, Problem] = {}
        for second, own in fit.second_arms.items():
            known = self._second_arm(second)
            sigma = zip(known.stated.names, map(float, np.sqrt(np.diag(known.stated.scatter))), strict=True)
            second_arms[second] = known.with_fit(replace(own, scatter={name: s for name, s in sigma if s > 0}))
        found = replace(
            self, name=name, arm=arm_with(plain, effects, self.task), nominal=nominal, effects=effects,
            document=document, header=fit.header, origin=ProblemDocument(document), overridden=frozenset(),
            second_arms=second_arms,
        )  # fmt: skip
        return found if fit.known is None else found._with_known(fit.known, fit)

    def released(self, frames: Sequence[str], parameters: Sequence[str], effects: Sequence[Effect] = ()) -> Problem:
        """The same problem with frames free that the file states, without σ's of parameters, and with more effects."""
        robot, nominal = self.robot.with_free(frames), self.nominal.with_free(frames)
        every = (*self.effects, *effects)
        document = released_document(self.document, frames, parameters)
        if effects:
            document["effects"] = [*(document.get("effects") or []), *(effect.to_dict() for effect in effects)]
        return replace(
            self, arm=arm_with(robot, every, self.task), nominal=nominal, effects=every,
            stated=self.stated.without(parameters), sources=self.sources.without(parameters), document=document,
            overridden=self.overridden | {("robot", frame) for frame in frames},
        )  # fmt: skip

    def _with_known(self, known: Sources, fit: FittedArm) -> Problem:
        parameters, file = self.robot.parameters, fit.covariance_file if known.names else None
        named = replace(known, notes=(f"covariance from {file}",)) if file else known
        scatter = {name: rounded(sigma, parameters[name]) for name, sigma in fit.scatter.items()}
        section = UncertaintySpec(covariance=file, scatter={name: text for name, (_, text) in scatter.items()})
        stated = section.completed(named, self.robot, {name: sigma for name, (sigma, _) in scatter.items()})
        sources = noisy_sources(stated, self.robot, self.effects)
        text = sources_text(self.robot, moving_effects(self.effects), known)
        return replace(
            self, stated=stated, sources=sources, attached={file: text} if file else {},
            notes=problem_notes(self.arm, section, sources, self.effects),
        )  # fmt: skip

    def without_noise(self) -> Problem:
        """The same problem without the effects that move nothing: all that scatters is what the file states."""
        kept = [isinstance(effect, Effect) for effect in self.effects]
        if all(kept):
            return self
        entries = zip(self.to_dict()["effects"], kept, strict=True)
        document = {**self.document, "effects": [entry for entry, keep in entries if keep]}
        return replace(self, effects=moving_effects(self.effects), sources=self.stated, document=document)

    def explore(self, port: int = 8080, browser: bool = False, data: Measurements | None = None) -> LivePage:
        """A live page on which the best posture follows the target; it returns at once, its ``close`` ends it.

        Args:
            port: the next free one is taken.
            browser: whether a browser is opened.
            data: measurements whose errors are shown.

        Raises:
            InputError: no task, or viser is missing (``pip install 'posture_opt[explore]'``).
        """
        page: LivePage = explorer_of(self)(port=port, browser=browser, data=data)
        return page

    def to_dict(self) -> Section:
        """The plain data of the problem file; ``problem_from_dict`` takes it back."""
        return copy.deepcopy(dict(self.document))

    def to_yaml(self) -> str:
        """The problem file as text, quantities with their units as they were given."""
        return commented(self.header, self.to_dict())

    def files(self, stem: str) -> dict[str, bytes]:
        """File name -> content: the problem file ``stem.yaml`` and what it needs with it, to be put in any folder."""
        document = self.to_dict()
        further: dict[str, bytes] = {}
        names: dict[str, str] = {}

        def put(entry: Plain, key: str, name: str) -> None:
            if isinstance(entry, dict) and (given := entry.get(key)):
                further[name], entry[key] = self._content(given), name

        robot = document.get("robot") or {}
        table = f"{stem}.urdf" if robot.get("kind") == "urdf" else f"{stem}_robot{Path(robot.get('file') or '').suffix}"
        for section, key, name in (
            ("uncertainty", "covariance", f"{stem}_covariance.csv"),
            ("robot", "file", table),
            ("robot", "srdf", f"{stem}.srdf"),
            ("task", "path", f"{stem}_path.csv"),
            ("cell", "scene", f"{stem}.scene"),
        ):
            inside = document.get(section)
            if isinstance(inside, dict) and inside.get(key):
                names[inside[key]] = name
                put(inside, key, name)
        for section, own, key in named_files(document.get("data") or {}):
            entry = document["data"][section][own]
            put(entry, key, f"{stem}_{own}{Path(entry[key]).suffix}")
        for own, entry in ((document.get("data") or {}).get("pairs") or {}).items():
            further |= self._second_arm(own).files(f"{stem}_{own}")
            entry["problem"] = f"{stem}_{own}.yaml"
        for effect in document.get("effects") or ():
            if given := effect.get("covariance"):
                put(effect, "covariance", names.setdefault(given, f"{stem}_effects{len(names) or ''}_covariance.csv"))
        cell = document.get("cell")
        for k, obstacle in enumerate(cell.get("obstacles") or () if isinstance(cell, dict) else (), 1):
            put(obstacle, "file", f"{stem}_obstacle{k}{Path(obstacle.get('file') or '').suffix}")
        part = (document.get("task") or {}).get("workpiece") or {}
        put(part, "file", f"{stem}_workpiece{Path(part.get('file') or '').suffix}")
        return {f"{stem}.yaml": commented(self.header, document).encode(), **further}

    def _second_arm(self, name: str) -> Problem:
        if name in self.second_arms:
            return self.second_arms[name]
        path = located(self.folder, self.document["data"]["pairs"][name]["problem"])
        return build_problem(second_document(path), path.parent, path.stem)

    def _content(self, name: str) -> bytes:
        if name in self.attached:
            return self.attached[name].encode()
        path = located(self.folder, name)
        found = named_content(path, MAX_URDF_BYTES)
        return with_whole_paths(found, path) if b"<mesh" in found else found


def build_problem(
    document: ProblemDocument, folder: Path, name: str, *, attached: Mapping[str, str] | None = None
) -> Problem:
    """The problem of a document; ``name`` serves where the document has none, ``attached`` for files that it names."""
    texts = attached or {}
    spec, (nominal, arm), (stated, sources) = read_parts(document, folder, texts)
    return Problem(
        name=spec.name or name,
        arm=arm,
        nominal=nominal,
        stated=stated,
        sources=sources,
        workpiece_sources=spec.uncertainty.of_workpiece,
        task=spec.task,
        solver=spec.solver,
        effects=spec.effects,
        measurement=spec.uncertainty.measurement,
        data=spec.data,
        folder=folder,
        notes=(
            *problem_notes(arm, spec.uncertainty, sources, spec.effects),
            *(spec.cell.notes if spec.cell is not None else ()),
            *part_notes(spec.task),
        ),
        document=document.data,
        origin=document,
        attached=texts,
        cell=spec.cell,
        part=fixed_part(spec.task),
    )
