"""The effects, listed here; a file is read when its effect is asked for, by its kind or its class."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from posture_opt.model.effects.base.cause import (
    INPUTS,
    ROWS,
    Abscissa,
    CatalogueEntry,
    Cause,
    Evidence,
    FittedSizes,
    Limit,
    Size,
)
from posture_opt.model.effects.base.effect import Effect, Excitation, Sensitivity
from posture_opt.model.effects.base.joint_effect import JointEffect
from posture_opt.model.effects.noise.noise_effect import NoiseEffect, Pattern, Rows
from posture_opt.spec import class_name

if TYPE_CHECKING:
    from posture_opt.model.effects.cyclic_error import CyclicError
    from posture_opt.model.effects.joint_coupling import JointCoupling
    from posture_opt.model.effects.noise.correlated_lengths import CorrelatedLengths
    from posture_opt.model.effects.noise.joint_noise import JointNoise
    from posture_opt.model.effects.noise.outliers import Outliers
    from posture_opt.model.effects.noise.stated_sigma import StatedSigma

    EFFECTS: tuple[type[Effect], ...]
    NOISES: tuple[type[NoiseEffect], ...]
    CATALOGUE: tuple[type[CatalogueEntry], ...]

# The kinds that move the tool point, `EFFECTS`; a kind is, in capitals, the name of its class
MOVING_KINDS = (
    "joint_scale",
    "gear_eccentricity",
    "gear_second_harmonic",
    "gear_ripple",
    "cyclic_error",
    "joint_compliance",
    "link_bending",
    "base_compliance",
    "backlash",
    "hysteresis",
    "load_backlash",
    "joint_coupling",
    "payload_error",
    "thermal_growth",
    "thermal_offset",
    "drift",
    "slip",
    "instrument_scale",
    "instrument_field",
    "quantisation",
    "late_reading",
    "tool_shift",
)

# The kinds that spread it, or its measurements, `NOISES`; both together are the `CATALOGUE`
NOISY_KINDS = ("joint_noise", "range_noise", "stated_sigma", "outliers", "correlated_lengths")

# File -> the kinds in it; any other kind is the name of its file
_FAMILIES = {
    "gear_errors": ("gear_eccentricity", "gear_second_harmonic", "gear_ripple"),
    "lost_motion": ("backlash", "hysteresis", "load_backlash"),
    "thermal": ("thermal_growth", "thermal_offset"),
    "instrument": ("instrument_scale", "instrument_field"),
}
# Kind -> the file of its class, in this folder
_FILES = {kind: kind for kind in MOVING_KINDS} | {kind: f"noise.{kind}" for kind in NOISY_KINDS}
_FILES |= {kind: file for file, kinds in _FAMILIES.items() for kind in kinds}
# Name of a list of classes -> the kinds in it
_LISTS = {"EFFECTS": MOVING_KINDS, "NOISES": NOISY_KINDS, "CATALOGUE": (*MOVING_KINDS, *NOISY_KINDS)}
_KINDS = {class_name(kind): kind for kind in _FILES}  # Class name -> kind


def effect_class(kind: str) -> type[CatalogueEntry] | None:
    """The class of a kind; None where there is none. Its file is imported when it is first asked for."""
    if kind not in _FILES:
        return None
    found: type[CatalogueEntry] = getattr(import_module(f"posture_opt.model.effects.{_FILES[kind]}"), class_name(kind))
    return found


def __getattr__(name: str) -> Any:
    """A list of classes, or one class by its name, imported when it is first used."""
    if name in _LISTS:
        value: Any = tuple(map(effect_class, _LISTS[name]))
    elif name in _KINDS:
        value = effect_class(_KINDS[name])
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


__all__ = [
    "CATALOGUE",
    "EFFECTS",
    "INPUTS",
    "MOVING_KINDS",
    "NOISES",
    "NOISY_KINDS",
    "ROWS",
    "Abscissa",
    "CatalogueEntry",
    "Cause",
    "CorrelatedLengths",
    "CyclicError",
    "Effect",
    "Evidence",
    "Excitation",
    "FittedSizes",
    "JointCoupling",
    "JointEffect",
    "JointNoise",
    "Limit",
    "NoiseEffect",
    "Outliers",
    "Pattern",
    "Rows",
    "Sensitivity",
    "Size",
    "StatedSigma",
    "effect_class",
]
