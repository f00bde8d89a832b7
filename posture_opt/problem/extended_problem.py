"""The problem of an extended arm: calibrated, with the effects that a diagnosis named, and planned anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.effect_sensitivities import gravity_of
from posture_opt.diagnosis.diagnosis import Diagnosis
from posture_opt.diagnosis.persistent_effects import covariance_at_shapes
from posture_opt.model.effects import Effect, NoiseEffect
from posture_opt.numerics import Array
from posture_opt.problem.calibrated_problem import (
    ELSEWHERE,
    arm_of_frames,
    calibrated_problem,
    corrected_section,
    dimension_unit,
    known_effects,
    known_sources,
    of_first_target,
    parameter_units,
    semidefinite,
    uncertainty_section,
)
from posture_opt.problem.noise_section import of_a_type
from posture_opt.problem.problem import Problem, build_problem
from posture_opt.problem.yaml_source import Document
from posture_opt.selection.plan_comparison import Comparison, compare_plans
from posture_opt.uncertainty.covariance_file import covariance_text
from posture_opt.uncertainty.sources import Sources
from posture_opt.validation.residual_scatter import residual_scatter
from posture_opt.validation.stated_scatter import JointScatter

COVARIANCE = "extended_covariance.csv"
_SUFFIX = ", extended"


def extended_problem(problem: Problem, diagnosis: Diagnosis) -> Problem:
    """The problem with the arm that the diagnosis fitted: geometry, effects, and what is uncertain of both together.

    Effects that change with time are left out: they belong to the session that was measured. So is noise of the
    instrument or of the data; that of a joint is an effect of the arm.
    """
    calibration = extended_calibration(diagnosis)
    x, covariance = of_first_target(calibration, calibration.covariance)
    effects, parameters = _exported(diagnosis)
    noises = [f.noise for f in diagnosis.findings if f.noise is not None and f.noise.of_arm]
    scatter = residual_scatter(problem, calibration, noises)
    geometry = _without(known_sources(problem, calibration, x, covariance), [name for name, _, _ in parameters])
    known = _with_effects(problem, diagnosis, geometry, parameters)
    document = {
        **problem.to_dict(),
        "name": f"{problem.name.removesuffix(_SUFFIX)}{_SUFFIX}",
        "robot": _weighed(problem, x),
        "uncertainty": uncertainty_section(problem, scatter, COVARIANCE if known.names else ""),
        "effects": _section(problem, effects, noises, known.names),
    }
    units = [*parameter_units(problem, geometry.names), *(unit for _, _, unit in parameters)]
    attached = {COVARIANCE: covariance_text(known.names, known.covariance, units)} if known.names else {}
    header = _header(diagnosis, scatter)
    return build_problem(Document(document), problem.folder, problem.name, attached=attached, header=header)


def extended_calibration(diagnosis: Diagnosis) -> Calibration:
    """The calibration with the geometry of the extended arm, and the errors that it leaves."""
    model, calibration = diagnosis.persistent, diagnosis.calibration
    g = model.directions.shape[1]
    covariance = model.directions @ model.covariance[:g, :g] @ model.directions.T
    errors = calibration.errors.copy()
    errors[calibration.kept_rows] = diagnosis.held["extended"].errors
    # Sums over blocks hold what each row makes of the estimate, and no model of single rows may stand in for them.
    design = max(calibration.design, model.design)
    return replace(calibration, x=model.x, covariance=covariance, errors=errors, variance=model.variance, design=design)


def models_of(problem: Problem, diagnosis: Diagnosis, extended: Problem) -> dict[str, Problem]:
    """The arm before calibration, calibrated and extended, each where the measurements saw its base and tool."""
    calibration = diagnosis.calibration
    return {
        "nominal": arm_of_frames(problem, calibration),
        "calibrated": calibrated_problem(problem, calibration),
        "extended": extended,
    }


def compare_extended(problem: Problem, models: Mapping[str, Problem], *, seed: int | None = None) -> Comparison | None:
    """The task planned with every model, judged by the extended one; None where the problem has no task."""
    return compare_plans(models, seed=seed, hint=ELSEWHERE if problem.robot.base_free else "")


def _weighed(problem: Problem, x: dict[str, float]) -> dict[str, Any]:
    """The robot's section, its gravity as the diagnosis took it where the instrument was not levelled."""
    gravity = gravity_of(problem.robot, {name: v for name, v in x.items() if name.startswith("base.")})
    section = corrected_section(problem, x)
    return section if gravity == problem.robot.gravity else {**section, "gravity": list(gravity)}


def _exported(diagnosis: Diagnosis) -> tuple[list[Effect], list[tuple[str, int, str]]]:
    """The effects to plan with, and (name, place in theta, unit) of their parameters."""
    effects, parameters = [], []
    for effect, part in zip(diagnosis.persistent.effects(), diagnosis.persistent.slices, strict=True):
        effects.append(effect)
        for k, (name, (_, dimension)) in enumerate(zip(effect.parameter_names, effect.dimensions, strict=True)):
            parameters.append((name, part.start + k, dimension_unit(dimension)))
    return effects, parameters


def _with_effects(
    problem: Problem, diagnosis: Diagnosis, geometry: Sources, parameters: Sequence[tuple[str, int, str]]
) -> Sources:
    """The sources of the geometry with those of the effects, correlated as they were estimated."""
    model = diagnosis.persistent
    together = covariance_at_shapes(model)
    g, k, e = model.directions.shape[1], len(geometry.names), len(parameters)
    names = [p.name for p in diagnosis.calibration.parameters]
    at = [names.index(name) if name in names else -1 for name in geometry.names]
    columns = [g + place for _, place, _ in parameters]
    cross: Array = model.directions @ together[:g, columns]
    covariance = np.zeros((k + e, k + e))
    covariance[:k, :k] = geometry.covariance
    for row, i in enumerate(at):
        if i >= 0:
            covariance[row, k:] = covariance[k:, row] = cross[i]
    covariance[k:, k:] = together[np.ix_(columns, columns)]
    if not k + e:
        return Sources()
    return Sources((*geometry.names, *(name for name, _, _ in parameters)), semidefinite(covariance))


def _without(sources: Sources, names: Sequence[str]) -> Sources:
    kept = [k for k, name in enumerate(sources.names) if name not in names]
    return Sources(tuple(sources.names[k] for k in kept), sources.covariance[np.ix_(kept, kept)])


def _section(
    problem: Problem, found: Sequence[Effect], noises: Sequence[NoiseEffect], names: Sequence[str]
) -> list[dict[str, Any]]:  # fmt: skip
    """The effects of the file and those that were found; what was found of a known one adds to it."""
    section: list[dict[str, Any]] = known_effects(problem, names, COVARIANCE).get("effects", [])
    known = [effect for effect in problem.effects if not of_a_type(effect)]
    at = {effect.name: k for k, effect in enumerate(known)}
    for effect in found:
        former = known[at[effect.name]] if effect.name in at else effect.with_estimate([0.0] * len(effect.values))
        total = former.with_estimate([a + b for a, b in zip(former.values, effect.values, strict=True)])
        _put(section, at.get(effect.name), {**total.to_dict(), "covariance": COVARIANCE})
    for noise in noises:
        total_noise = known[at[noise.name]].joined(noise) if noise.name in at else noise
        _put(section, at.get(noise.name), total_noise.to_dict())
    return section


def _put(section: list[dict[str, Any]], place: int | None, entry: dict[str, Any]) -> None:
    if place is None:
        section.append(entry)
    else:
        section[place] = entry


def _header(diagnosis: Diagnosis, scatter: JointScatter) -> tuple[str, ...]:
    """What the file says of itself in its first lines."""
    data = diagnosis.calibration.residuals.data
    errors = ", ".join(f"{diagnosis.errors[n].rms * 1e3:.3g} mm {n}" for n in ("nominal", "calibrated", "extended"))
    named = [f for f in diagnosis.findings if f.effect is not None or (f.noise is not None and f.noise.of_arm)]
    named_text = ", ".join(f"{f.kind} of {f.target}" for f in named) or "no effect"
    stays = {effect.name for effect in diagnosis.persistent.effects()}
    left = [effect for effect in diagnosis.model.effects() if effect.name not in stays]
    read = [f.noise.name for f in diagnosis.findings if f.noise is not None and not f.noise.of_arm]
    lines = [
        f"Extended by what {Path(data.file).name or 'a table'} ({len(data)} rows) says of the arm: {named_text}.",
        f"Position errors where it had not seen the data, RMS: {errors}.",
        f"What is still uncertain of its parameters stands in {COVARIANCE}, in mm, mrad and SI units.",
        f"{scatter.note[:1].upper()}{scatter.note[1:]}.",
    ]
    if left:
        before = "; the arm is as it was before" if any("time" in effect.needs for effect in left) else ""
        lines.append(f"Left out, as it belongs to its session: {', '.join(e.name for e in left)}{before}.")
    if read:
        lines.append(f"Left out, as it is of the measurement and not of the arm: {', '.join(read)}.")
    return tuple(lines)
