"""From the data of a problem file to its parts: every section against the schema, then robot and sources of error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from posture_opt.errors import InputError, Issue
from posture_opt.model.arm import Arm
from posture_opt.problem.effects_section import (
    arm_with,
    effect_sources,
    measurement_issues,
    moving_effects,
    noisy_sources,
)
from posture_opt.problem.issues import schema_issues
from posture_opt.problem.schema import ProblemSpec
from posture_opt.problem.yaml_source import Document
from posture_opt.robot.corrections import corrected
from posture_opt.robot.robot import Robot
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.uncertainty_section import UncertaintySpec

T = TypeVar("T")


def read_parts(
    document: Document, folder: Path, texts: Mapping[str, str]
) -> tuple[ProblemSpec, tuple[Robot, Arm], tuple[Sources, Sources]]:
    """What the document says, the nominal robot and the arm, sources stated and all; all issues at once."""
    issues = list(document.issues)
    data, broken = _sections(document, issues)
    spec = ProblemSpec.model_validate(data) if "robot" in data else None
    arms, sources = None, None
    if spec is not None:
        read = spec
        arms = _collect(issues, lambda: _arms(read, folder))
    if spec is not None and arms is not None and "uncertainty" not in broken:
        arm = arms[1]
        sources = _collect(issues, lambda: _sources(read, arm, folder, texts))
    elif "uncertainty" in data:
        uncertainty = UncertaintySpec.model_validate(data["uncertainty"])
        _collect(issues, lambda: _at("uncertainty", uncertainty.check))
    _refuse(issues, document)
    assert spec is not None
    assert arms is not None
    assert sources is not None
    return spec, arms, sources


def _arms(spec: ProblemSpec, folder: Path) -> tuple[Robot, Arm]:
    """The nominal robot, and the arm with corrections and effects."""
    nominal = _at("robot", lambda: spec.robot.nominal(folder))
    plain = _at("robot", lambda: corrected(nominal, spec.robot.corrections))
    return nominal, arm_with(plain, spec.effects, spec.task)


def _sources(spec: ProblemSpec, arm: Arm, folder: Path, texts: Mapping[str, str]) -> tuple[Sources, Sources]:
    """The stated sources, those of the effects' estimates among them, and what effects that move nothing do to them."""
    stated = _at("uncertainty", lambda: spec.uncertainty.build(arm, folder, texts))
    issues = measurement_issues(spec.uncertainty.measurement, spec.effects)
    if issues:
        raise InputError(issues)
    stated = stated.plus(effect_sources(arm, moving_effects(spec.effects), folder, texts, spec.uncertainty.covariance))
    return stated, noisy_sources(stated, arm.robot, spec.effects)


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
