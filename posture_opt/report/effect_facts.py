"""The effects of an arm in the block of the problem: what they are, how large, and under which inputs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from posture_opt.model.inputs import REFERENCE_TEMPERATURE
from posture_opt.report.units_text import number, stated_length

if TYPE_CHECKING:
    from posture_opt.model.arm import Arm
    from posture_opt.model.effects import CatalogueEntry, Effect
    from posture_opt.problem.problem import Problem

_LISTED = 6
_COORDINATES = ("x", "y", "z")
# dimension -> factor from SI, unit
_UNITS = {
    "angle per torque": (1e6, "µrad/(N m)"),
    "angle mass per torque": (1e6, "µrad kg/(N m)"),
    "angle per temperature": (1e6, "µrad/K"),
    "length per temperature": (1e6, "µm/K"),
    "per temperature": (1e6, "µm/(m K)"),
    "per length": (1e6, "ppm/m"),
    "ratio": (1e3, "mrad per rad"),
    "length per length": (1e6, "µm/m"),
    "share": (1e2, "%"),
}


def effect_facts(problem: Problem) -> list[tuple[str, str]]:
    """The effects that the arm is computed with; nothing for a plain arm."""
    effects = problem.effects
    if not effects:
        return []
    shown = [effect_text(effect) for effect in effects[:_LISTED]]
    if len(effects) > _LISTED:
        shown.append(f"and {len(effects) - _LISTED} more")
    return [("Effects", ", ".join(shown))]


def input_facts(problem: Problem) -> list[tuple[str, str]]:
    """What the task says, or leaves open, of the inputs that the effects depend on."""
    texts = _inputs(problem.arm) if problem.arm.effects else []
    return [("Computed for", ", ".join(texts))] if texts else []


def effect_text(effect: CatalogueEntry) -> str:
    """joint compliance of elbow 8.00 µrad/(N m) (125 kN m/rad)."""
    from posture_opt.model.effects import Effect, NoiseEffect

    if isinstance(effect, NoiseEffect):
        return f"{_named(effect)} ({', '.join(f'{n} {size_text(v, dimension)}' for n, v, dimension in effect.sizes)})"
    assert isinstance(effect, Effect)
    return _sized(effect)


def _named(effect: CatalogueEntry) -> str:
    """joint compliance of elbow."""
    target, kind = {"all": "all lengths"}.get(effect.target, effect.target), effect.kind.replace("_", " ")
    return kind if target in (*kind.split(), "data") else f"{kind} of {target}"


def _sized(effect: Effect) -> str:
    sizes = dict(zip((name for name, _ in effect.dimensions), effect.values, strict=True))
    dimensions = dict(effect.dimensions)
    if set(sizes) == {"sin", "cos"}:
        text = f"of {size_text(math.hypot(*sizes.values()), 'angle')}"
    elif set(sizes) == set(_COORDINATES):
        text = f"of {size_text(math.hypot(*sizes.values()), 'length')}"
    elif (step := getattr(effect, "lsb", None)) is not None:
        text = f"in steps of {size_text(step, 'angle')}"
    elif len(sizes) == 1:
        ((name, value),) = sizes.items()
        text = size_text(value, dimensions[name])
    else:
        text = f"({len(sizes)} coefficients)"
    cycles = getattr(effect, "cycles", None)
    more = "" if cycles is None else f", {number(cycles, 4)} a turn"
    stiff = sizes.get("compliance", 0.0)
    if stiff > 0:
        more += f" ({number(1e-3 / stiff)} kN m/rad)"
    return f"{_named(effect)} {text}{more}"


def size_text(value: float, dimension: str) -> str:
    """A size of an effect with a unit that suits it: 0.300 mrad, 8.00 µrad/(N m)."""
    if dimension == "length":
        return stated_length(value)
    if dimension == "angle":
        return f"{number(value * 1e3)} mrad"
    if dimension == "factor":
        return number(value)
    factor, unit = _UNITS[dimension]
    return f"{number(value * factor)} {unit}"


def _inputs(arm: Arm) -> list[str]:
    asked = {need for effect in arm.effects for need in (*effect.asks, *effect.needs)}
    inputs, texts = arm.inputs, []
    if asked & {"masses", "payload"}:
        texts.append(f"a payload of {inputs.payload:.6g} kg")
    for joint in dict.fromkeys(e.target for e in arm.effects if "approach" in e.needs):
        if joint in inputs.stated:
            sense = "upwards" if inputs.side(arm.robot.joint_names.index(joint)) > 0 else "downwards"
            texts.append(f"{joint} arriving with its values going {sense}")
        else:
            texts.append(f"{joint} arriving from either side")
    if "temperature" in asked:
        texts.append(f"{REFERENCE_TEMPERATURE + inputs.temperature:.6g} degC")
    if "time" in asked:
        texts.append(f"{inputs.time:.6g} s after the first measurement")
    return texts


def source_of_effect(name: str, arm: Arm) -> str:
    """A parameter of an effect, or a side that is not known, as a source of error; empty for other sources."""
    if name in arm.unknown_sides:
        return f"{name.removesuffix('.side')} side of arrival"
    for effect in arm.effects:
        if name in effect.parameter_names:
            parameter = name.removeprefix(f"{effect.name}.")
            kind = effect.kind.replace("_", " ")
            what = kind if len(effect.dimensions) == 1 else f"{kind}, {parameter}"
            return f"{effect.target} {what}"
    return ""


def spread_of_effect(name: str, sigma: float, arm: Arm) -> str:
    """The standard deviation of a parameter of an effect with its unit; empty for other sources."""
    if name in arm.unknown_sides:
        return "either side"
    dimension = arm.dimensions.get(name)
    return "" if dimension is None else size_text(sigma, dimension)
