"""A problem with the arm that measurements found: its robot, effects and sources from numbers, its file from those."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from posture_opt.calibration.fitted_arm import NEGLIGIBLE, FittedArm
from posture_opt.errors import InputError
from posture_opt.model.effects import CatalogueEntry, Effect, NoiseEffect
from posture_opt.problem.effects_section import of_a_type
from posture_opt.problem.writing import frame_texts, quantity, rounded
from posture_opt.robot.corrections import deviated, name_issues
from posture_opt.robot.robot import Robot


def fitted_robots(nominal: Robot, robot: Robot, fit: FittedArm) -> tuple[Robot, Robot]:
    """The robot without and with corrections after a fit; frames that were found are numbers of both, not free.

    Args:
        nominal: the robot of the problem without corrections; ``robot`` with them.

    Raises:
        InputError: the fit is one of another robot.
    """
    issues = [issue for name in fit.deviations for issue in name_issues(name, robot.parameters)]
    if issues:
        raise InputError(issues)
    found = frames_of(fit)
    total = {name: value + fit.deviations.get(name, 0.0) for name, value in corrections_of(nominal, robot).items()}
    frames = {name: value for name, value in total.items() if _owner(name) in found}
    placed = replace(
        deviated(nominal, frames),
        gravity=nominal.gravity if fit.gravity is None else fit.gravity,
        base_free=nominal.base_free and "base" not in found,
        tool_free=nominal.tool_free and "tool" not in found,
    )
    return placed, deviated(placed, {name: value for name, value in total.items() if name not in frames})


def corrections_of(nominal: Robot, robot: Robot) -> dict[str, float]:
    """Deviation of every parameter of a robot from its nominal value [rad or m]."""
    stated = nominal.parameters
    return {name: factor.nominal - stated[name].nominal for name, factor in robot.parameters.items()}


def frames_of(fit: FittedArm) -> tuple[str, ...]:
    """The frames that a fit found: ``base``, ``tool``."""
    return tuple(frame for frame in ("base", "tool") if any(_owner(name) == frame for name in fit.deviations))


def _owner(name: str) -> str:
    return name.rpartition(".")[0]


def fitted_effects(former: Sequence[CatalogueEntry], fit: FittedArm) -> tuple[CatalogueEntry, ...]:
    """The effects of a problem and those of a fit; what was found of a known one adds to it.

    How robots of a type differ is no news once one of them was measured: such effects are left out.
    """
    if fit.known is None:
        return tuple(former)
    effects = {effect.name: effect for effect in former if not of_a_type(effect)}
    for found in fit.effects:
        known = effects.get(found.name)
        plain = known if isinstance(known, Effect) else found.with_estimate([0.0] * len(found.values))
        total = [a + b for a, b in zip(plain.values, found.values, strict=True)]
        effects[found.name] = plain.with_estimate(total)
    for noise in fit.noises:
        stated = effects.get(noise.name)
        effects[noise.name] = stated.joined(noise) if isinstance(stated, NoiseEffect) else noise
    return tuple(_under_covariance(effect, fit) for effect in effects.values())


def _under_covariance(effect: CatalogueEntry, fit: FittedArm) -> CatalogueEntry:
    """The effect with the covariance of the fit in place of its own."""
    if not isinstance(effect, Effect):
        return effect
    own = fit.known is not None and bool(set(effect.parameter_names) & set(fit.known.names))
    return effect.model_copy(update={"covariance": fit.covariance_file if own else None})


def robot_section(section: Mapping[str, Any], nominal: Robot, robot: Robot, fit: FittedArm) -> dict[str, Any]:
    """The section ``robot`` of a file with frames as numbers, corrections and gravity as they are after a fit."""
    corrections = {
        name: text
        for name, value in corrections_of(nominal, robot).items()
        for text in [quantity(value, robot.parameters[name])]
        if abs(value) > NEGLIGIBLE["rad" if robot.parameters[name].kind == "rotate" else "m"]
    }
    return {
        **{key: value for key, value in section.items() if key != "corrections"},
        **{frame: frame_texts(robot.parameters, frame) for frame in frames_of(fit)},
        **({} if fit.gravity is None else {"gravity": list(robot.gravity)}),
        **({"corrections": corrections} if corrections else {}),
    }


def uncertainty_section(section: Mapping[str, Any], robot: Robot, fit: FittedArm) -> dict[str, Any]:
    """The section ``uncertainty`` of a file after a fit: covariance, scatter, and the instrument as it was stated."""
    if fit.known is None:
        return dict(section)
    scatter = {name: rounded(sigma, robot.parameters[name])[1] for name, sigma in fit.scatter.items()}
    return {
        **({"covariance": fit.covariance_file} if fit.known.names else {}),
        **({"scatter": scatter} if scatter else {}),
        **({"measurement": section["measurement"]} if section.get("measurement") is not None else {}),
    }


def fitted_document(
    former: Mapping[str, Any], name: str, nominal: Robot, robot: Robot, effects: Sequence[CatalogueEntry],
    fit: FittedArm,
) -> dict[str, Any]:  # fmt: skip
    """The plain data of the file of a fitted problem; keys that the fit has no part in stay as they were given."""
    uncertainty = uncertainty_section(former.get("uncertainty") or {}, robot, fit)
    document = {**former, "robot": robot_section(former["robot"], nominal, robot, fit)}
    document |= {"name": name} if fit.label else {}
    document |= {"uncertainty": uncertainty} if uncertainty or "uncertainty" in former else {}
    if fit.known is not None and (effects or former.get("effects")):
        document["effects"] = [effect.to_dict() for effect in effects]
    return document
