"""The effects of an arm in the block of the problem: what they are, how large, and under which inputs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.model.arm_state import REFERENCE_TEMPERATURE
from posture_opt.units import shown

if TYPE_CHECKING:
    from posture_opt.model.arm import Arm
    from posture_opt.problem.problem import Problem

_LISTED = 6


def effect_facts(problem: Problem) -> list[tuple[str, str]]:
    """The effects that the arm is computed with; nothing for a plain arm."""
    effects = problem.effects
    if not effects:
        return []
    shown = [effect.stated_words for effect in effects[:_LISTED]]
    if len(effects) > _LISTED:
        shown.append(f"and {len(effects) - _LISTED} more")
    return [("Effects", ", ".join(shown))]


def input_facts(problem: Problem) -> list[tuple[str, str]]:
    """What the task says, or leaves open, of the inputs that the effects depend on."""
    texts = _inputs(problem.arm) if problem.arm.effects else []
    return [("Computed for", ", ".join(texts))] if texts else []


def _inputs(arm: Arm) -> list[str]:
    asked = {need for effect in arm.effects for need in (*effect.asks, *effect.needs)}
    inputs, texts = arm.inputs, []
    if asked & {"masses", "payload"}:
        texts.append(f"a payload of {inputs.payload:.6g} kg")
    for joint in dict.fromkeys(e.target for e in arm.effects if "approach" in e.needs):
        if joint in inputs.stated:
            sense = "upwards" if inputs.side(arm.robot.joint_names.index(joint)) > 0 else "downwards"
            texts.append(f"{joint} approached {sense}")
        else:
            texts.append(f"{joint} approached from either side")
    if "temperature" in asked:
        texts.append(f"{REFERENCE_TEMPERATURE + inputs.temperature:.6g} degC")
    if "time" in asked:
        texts.append(f"{inputs.time:.6g} s after the first measurement")
    return texts


def source_of_effect(name: str, arm: Arm) -> str:
    """A parameter of an effect, or a side that is not known, as a source of error; empty for other sources."""
    if name in arm.unknown_sides:
        return f"{name.removesuffix('.side')} side of approach"
    for effect in arm.effects:
        if name in effect.parameter_names:
            parameter = name.removeprefix(f"{effect.name}.")
            what = effect.title if len(effect.dimensions) == 1 else f"{effect.title}, {parameter}"
            return f"{effect.target} {what}"
    return ""


def spread_of_effect(name: str, sigma: float, arm: Arm) -> str:
    """The standard deviation of a parameter of an effect with its unit; empty for other sources."""
    if name in arm.unknown_sides:
        return "either side"
    dimension = arm.dimensions.get(name)
    return "" if dimension is None else shown(sigma, dimension)
