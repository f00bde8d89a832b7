"""A problem as its files have it: quantities as text, and robot, effects and sources that measurements found."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING

from posture_opt.errors import InputError
from posture_opt.model.effects import CatalogueEntry, Effect, NoiseEffect
from posture_opt.problem.effects_section import of_a_type
from posture_opt.problem.yaml_source import Plain, Section, dump_yaml
from posture_opt.robot.corrections import corrections_of, deviated, name_issues
from posture_opt.robot.robot import Factor, Robot
from posture_opt.selection.problem_data import NEGLIGIBLE, FittedArm
from posture_opt.texts import one_line
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.uncertainty_section import covariance_text
from posture_opt.units import DIMENSIONS, parse_quantity

if TYPE_CHECKING:
    from posture_opt.calibration.calibration import Calibration
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.selection.problem_data import ProblemData

# Keys of the section ``uncertainty`` that speak of what the tool works on, and not of the arm
WORKPIECE_KEYS = ("workpiece", "feature")
_FRAME_PARTS = ("x", "y", "z", "roll", "pitch", "yaw")


def quantity(value: float, factor: Factor) -> str:
    """A value of a parameter as files have it, to 1e-11 m or rad: 12.3456789 mm, 0.0123456789 deg."""
    number = f"{math.degrees(value):.10f}" if factor.kind == "rotate" else f"{value * 1e3:.8f}"
    number = number.rstrip("0").rstrip(".")
    return f"{'0' if number == '-0' else number} {'deg' if factor.kind == 'rotate' else 'mm'}"


def as_written(value: float, factor: Factor) -> float:
    """A value of a parameter as it is read from what files have of it [rad or m]."""
    return parse_quantity(quantity(value, factor), "angle" if factor.kind == "rotate" else "length")


def _negligible(value: float, factor: Factor) -> bool:
    """Whether a deviation of a parameter is rounding [rad or m]."""
    return abs(value) <= NEGLIGIBLE["rad" if factor.kind == "rotate" else "m"]


def rounded(sigma: float, factor: Factor) -> tuple[float, str]:
    """A standard deviation to four digits [rad or m], and as files have it: 0.005012 deg."""
    # sigma: [rad or m]; ``factor`` the transformation whose parameter it is of
    turns = factor.kind == "rotate"
    number = float(f"{math.degrees(sigma) if turns else sigma * 1e3:.4g}")
    text = f"{number:.12f}".rstrip("0").rstrip(".")
    return (math.radians(number), f"{text} deg") if turns else (number * 1e-3, f"{text} mm")


def frame_texts(parameters: Mapping[str, Factor], frame: str) -> dict[str, list[str]]:
    """A frame, ``base`` or ``tool``, as numbers: ``xyz`` in mm and ``rpy`` in deg, as the file has them."""
    factors = [parameters[f"{frame}.{part}"] for part in _FRAME_PARTS]
    texts = [quantity(factor.nominal, factor) for factor in factors]
    return {"xyz": texts[:3], "rpy": texts[3:]}


def sources_text(robot: Robot, effects: Sequence[Effect], sources: Sources) -> str:
    """The CSV of the covariance of sources: lengths in mm, angles in mrad, parameters of effects in SI units."""
    units = {name: "mrad" if factor.kind == "rotate" else "mm" for name, factor in robot.parameters.items()}
    for effect in effects:
        for name, (_, dimension) in zip(effect.parameter_names, effect.dimensions, strict=True):
            units[name] = "1" if dimension == "ratio" else DIMENSIONS[dimension][0]
    return covariance_text(sources.names, sources.covariance, [units[name] for name in sources.names])


def commented(header: Sequence[str], document: Mapping[str, Plain]) -> str:
    """The YAML text of a document, with lines of comment before it."""
    return "".join(f"# {one_line(line)}\n" for line in header) + dump_yaml(dict(document))


def fitted_robots(nominal: Robot, robot: Robot, fit: FittedArm) -> tuple[Robot, Robot]:
    """The robot without and with corrections after a fit; frames that were found are numbers of both, not free."""
    issues = [issue for name in fit.deviations for issue in name_issues(name, robot.parameters)]
    if issues:
        raise InputError(issues)
    found, stated = frames_of(fit), nominal.parameters
    total = {name: value + fit.deviations.get(name, 0.0) for name, value in corrections_of(nominal, robot).items()}
    frames = {
        name: as_written(stated[name].nominal + value, stated[name]) - stated[name].nominal
        for name, value in total.items()
        if _owner(name) in found
    }
    corrections = {name: as_written(value, stated[name]) for name, value in total.items() if name not in frames}
    placed = replace(
        deviated(nominal, frames),
        gravity=nominal.gravity if fit.gravity is None else fit.gravity,
        base_free=nominal.base_free and "base" not in found,
        tool_free=nominal.tool_free and "tool" not in found,
    )
    return placed, deviated(
        placed, {name: value for name, value in corrections.items() if not _negligible(value, stated[name])}
    )


def arm_of(problem: ProblemData, fit: FittedArm | Calibration | Diagnosis) -> FittedArm:
    """The arm that a fit found, in the terms of a problem."""
    if isinstance(fit, FittedArm):
        return fit
    if hasattr(fit, "fitted_arm"):
        return fit.fitted_arm
    calibrated: FittedArm = import_module("posture_opt.validation.calibrated_arm").calibrated_arm(problem, fit)
    return calibrated


def frames_of(fit: FittedArm) -> tuple[str, ...]:
    """The frames that a fit found: ``base``, ``tool``."""
    return tuple(frame for frame in ("base", "tool") if any(_owner(name) == frame for name in fit.deviations))


def _owner(name: str) -> str:
    """The joint, link or frame of a parameter: the name up to its last point."""
    return name.rpartition(".")[0]


def fitted_effects(former: Sequence[CatalogueEntry], fit: FittedArm) -> tuple[CatalogueEntry, ...]:
    """The effects of a problem and those of a fit; what was found of a known one is added to it."""
    if fit.known is None:
        return tuple(former)
    effects = {effect.name: effect for effect in former if not of_a_type(effect)}
    for found in fit.effects:
        known = effects.get(found.name)
        plain = known if isinstance(known, Effect) else found.with_estimate([0.0] * len(found.values))
        if found.smooth_shape:  # the stated size was fitted in the shape that was found
            plain = plain.with_shape(float(getattr(found, found.smooth_shape)))
        total = [a + b for a, b in zip(plain.values, found.values, strict=True)]
        total_effect = plain.with_estimate(total).also_measured(found)
        effects[found.name] = total_effect.model_copy(update={"size_undetermined": found.size_undetermined})
    for noise in fit.noises:
        stated = effects.get(noise.name)
        effects[noise.name] = stated.joined(noise) if isinstance(stated, NoiseEffect) else noise
    # As their file will have them, with the covariance of the fit in place of their own.
    for name, effect in effects.items():
        if isinstance(effect, Effect):
            own = bool(set(effect.parameter_names) & set(fit.known.names))
            effect = effect.model_copy(update={"covariance": fit.covariance_file if own else None})
        effects[name] = type(effect).model_validate(effect.to_dict())
    return tuple(effects.values())


def robot_section(section: Mapping[str, Plain], nominal: Robot, robot: Robot, fit: FittedArm) -> Section:
    """The section ``robot`` of a file with frames as numbers, corrections and gravity as they are after a fit."""
    corrections = {
        name: text
        for name, value in corrections_of(nominal, robot).items()
        for text in [quantity(value, robot.parameters[name])]
        if not _negligible(value, robot.parameters[name])
    }
    return {
        **{key: value for key, value in section.items() if key != "corrections"},
        **{frame: _kept_radius(section, frame) | frame_texts(robot.parameters, frame) for frame in frames_of(fit)},
        **({} if fit.gravity is None else {"gravity": list(robot.gravity)}),
        **({"corrections": corrections} if corrections else {}),
    }


def _kept_radius(section: Mapping[str, Plain], frame: str) -> Section:
    given = section.get(frame)
    return {"radius": given["radius"]} if isinstance(given, Mapping) and "radius" in given else {}


def uncertainty_section(section: Mapping[str, Plain], robot: Robot, fit: FittedArm) -> Section:
    """The section ``uncertainty`` of a file after a fit: covariance, scatter; instrument and workpiece as they were."""
    # A covariance replaces σ's and correlations of parameters; without one in the fit the section stays as it was
    if fit.known is None:
        return dict(section)
    scatter = {name: rounded(sigma, robot.parameters[name])[1] for name, sigma in fit.scatter.items()}
    return {
        **({"covariance": fit.covariance_file} if fit.known.names else {}),
        **({"scatter": scatter} if scatter else {}),
        **{key: section[key] for key in ("measurement", *WORKPIECE_KEYS) if section.get(key) is not None},
    }


def with_workpiece(section: Mapping[str, Plain] | None, other: Mapping[str, Plain] | None) -> Section:
    """A section ``uncertainty`` with the errors of the workpiece that another one states, in place of its own."""
    kept = {key: value for key, value in (section or {}).items() if key not in WORKPIECE_KEYS}
    return kept | {key: other[key] for key in WORKPIECE_KEYS if other and other.get(key) is not None}


def fitted_document(
    former: Mapping[str, Plain], name: str, nominal: Robot, robot: Robot, effects: Sequence[CatalogueEntry],
    fit: FittedArm,
) -> Section:  # fmt: skip
    """The plain data of the file of a fitted problem; keys that the fit has no part in stay as they were given."""
    uncertainty = uncertainty_section(former.get("uncertainty") or {}, robot, fit)
    document = {**former, "robot": robot_section(former["robot"], nominal, robot, fit)}
    document |= {"name": name} if fit.label else {}
    document |= {"uncertainty": uncertainty} if uncertainty or "uncertainty" in former else {}
    if fit.known is not None and (effects or former.get("effects")):
        document["effects"] = [effect.to_dict() for effect in effects]
    return document


def released_document(former: Mapping[str, Plain], frames: Sequence[str], parameters: Sequence[str]) -> Section:
    """The plain data of a file with frames free, which start as they were stated, and without some σ's."""
    # parameters: whose σ's and correlations are removed
    section = former["robot"]
    free = {frame: {**stated, "free": True} if (stated := section.get(frame)) else "free" for frame in frames}
    document = {**former, "robot": {**section, **free}}
    uncertainty = former.get("uncertainty") or {}
    if set(parameters) & set(uncertainty.get("sigma") or {}):
        sigma = {name: text for name, text in uncertainty["sigma"].items() if name not in parameters}
        pairs = [p for p in uncertainty.get("correlation") or [] if not set(p[:2]) & set(parameters)]
        rest = {key: value for key, value in uncertainty.items() if key not in ("sigma", "correlation")}
        rest |= ({"sigma": sigma} if sigma else {}) | ({"correlation": pairs} if pairs else {})
        document["uncertainty"] = rest
    return document
