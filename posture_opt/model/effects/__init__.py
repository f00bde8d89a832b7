"""The effects: one file each, listed here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.model.effects.backlash import Backlash
from posture_opt.model.effects.base_compliance import BaseCompliance
from posture_opt.model.effects.catalogue_entry import INPUTS, CatalogueEntry, Evidence, Limit
from posture_opt.model.effects.cause import Abscissa, Cause, FittedSizes, Size
from posture_opt.model.effects.cyclic_error import CyclicError
from posture_opt.model.effects.drift import Drift
from posture_opt.model.effects.effect import Effect, Excitation, Sensitivity
from posture_opt.model.effects.gear_eccentricity import GearEccentricity
from posture_opt.model.effects.gear_ripple import GearRipple
from posture_opt.model.effects.gear_second_harmonic import GearSecondHarmonic
from posture_opt.model.effects.hysteresis import Hysteresis
from posture_opt.model.effects.instrument_field import InstrumentField
from posture_opt.model.effects.instrument_scale import InstrumentScale
from posture_opt.model.effects.joint_compliance import JointCompliance
from posture_opt.model.effects.joint_coupling import JointCoupling
from posture_opt.model.effects.joint_effect import JointEffect
from posture_opt.model.effects.joint_scale import JointScale
from posture_opt.model.effects.link_bending import LinkBending
from posture_opt.model.effects.load_backlash import LoadBacklash
from posture_opt.model.effects.noise.correlated_lengths import CorrelatedLengths
from posture_opt.model.effects.noise.joint_noise import JointNoise
from posture_opt.model.effects.noise.noise_effect import NoiseEffect, Pattern, Rows
from posture_opt.model.effects.noise.outliers import Outliers
from posture_opt.model.effects.noise.range_noise import RangeNoise
from posture_opt.model.effects.noise.stated_sigma import StatedSigma
from posture_opt.model.effects.payload_error import PayloadError
from posture_opt.model.effects.quantisation import Quantisation
from posture_opt.model.effects.slip import Slip
from posture_opt.model.effects.thermal_growth import ThermalGrowth
from posture_opt.model.effects.thermal_offset import ThermalOffset
from posture_opt.spec import one_of

EFFECTS: tuple[type[Effect], ...] = (
    JointScale,
    GearEccentricity,
    GearSecondHarmonic,
    GearRipple,
    CyclicError,
    JointCompliance,
    LinkBending,
    BaseCompliance,
    Backlash,
    Hysteresis,
    LoadBacklash,
    JointCoupling,
    PayloadError,
    ThermalGrowth,
    ThermalOffset,
    Drift,
    Slip,
    InstrumentScale,
    InstrumentField,
    Quantisation,
)
"""Those that move the tool point."""

NOISES: tuple[type[NoiseEffect], ...] = (
    JointNoise,
    RangeNoise,
    StatedSigma,
    Outliers,
    CorrelatedLengths,
)
"""Those that spread it, or its measurements."""

CATALOGUE: tuple[type[CatalogueEntry], ...] = (*EFFECTS, *NOISES)

if TYPE_CHECKING:
    EffectSpec = CatalogueEntry
else:
    EffectSpec = one_of(CATALOGUE)
"""The entry of ``effects:`` in a problem file: any of the catalogue, told apart by its kind."""

__all__ = [
    "CATALOGUE",
    "EFFECTS",
    "INPUTS",
    "NOISES",
    "Abscissa",
    "CatalogueEntry",
    "Cause",
    "CorrelatedLengths",
    "CyclicError",
    "Effect",
    "EffectSpec",
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
]
