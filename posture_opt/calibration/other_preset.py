"""Whose link lengths the data have, where they are not those of the file: those of another preset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.cross_validation import position_errors
from posture_opt.calibration.estimation.fit import minimum_of
from posture_opt.calibration.estimation.identifiability import identify_parameters
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.numerics import Array, Json, rms_length
from posture_opt.robot.preset import load_preset, preset_names
from posture_opt.robot.robot import Robot

_LEAST_ERROR_M = 2e-3
"""RMS error [m] of the arm of the file from which other lengths are tried: uncalibrated arms of the right type are off
by 0.5 to 1.1 mm in the real sets, an arm of the next generation by 9 mm and more."""
_ERROR_RATIO = 3.0
"""How many times less the lengths of the right preset leave, at the least."""
_SAME_ANGLE_RAD, _SAME_LENGTH_M = 1e-3, 1e-4
"""Angles of one structure, and lengths that are not worth a word, agree to this."""


@dataclass(frozen=True)
class OtherPreset:
    """A preset whose lengths the data have.

    Args:
        name: of the preset; ``title`` of the arm.
        rms: of the position errors with its lengths, only free frames fitted [m]; ``stated`` with those of the file.
        lengths: parameter -> (length of the file, of the preset [m]), those that differ.
    """

    name: str
    title: str
    rms: float
    stated: float
    lengths: Mapping[str, tuple[float, float]]

    def to_json(self) -> dict[str, Json]:
        """The part ``other_preset`` of ``calibration.json`` and ``diagnosis.json`` [m]."""
        return {
            "name": self.name,
            "title": self.title,
            "residual_rms": {"stated": self.stated, "preset": self.rms},
            "lengths": {name: {"stated": a, "preset": b} for name, (a, b) in self.lengths.items()},
        }


def other_preset(residuals: Residuals, x_nominal: Array) -> OtherPreset | None:
    """The preset whose lengths explain the data where those of the file do not; None where there is none.

    Presets of the same structure are tried: their lengths in place of the file's, free frames fitted again, everything
    else as stated. The best counts if it leaves a third of the error, or less.

    Args:
        residuals: of the rows that count.
        x_nominal: (k,) deviations [rad, m] with only the free frames fitted.
    """
    stated = rms_length(position_errors(residuals, x_nominal))
    if stated < _LEAST_ERROR_M:
        return None
    found = []
    for name in preset_names():
        preset = load_preset(name)
        lengths = _other_lengths(residuals.robot, preset)
        if lengths:
            found.append(OtherPreset(name, preset.name, _error_with(residuals, x_nominal, lengths), stated, lengths))
    best = min(found, key=lambda one: one.rms, default=None)
    return best if best is not None and best.rms * _ERROR_RATIO < stated else None


def _other_lengths(robot: Robot, other: Robot) -> dict[str, tuple[float, float]]:
    """Parameter -> length in both arms [m], of those that differ; nothing for arms of another structure."""
    if [j.type for j in robot.joints] != [j.type for j in other.joints]:
        return {}
    lengths: dict[str, tuple[float, float]] = {}
    for own, theirs in zip(robot.links, other.links, strict=True):
        if [(f.kind, f.axis) for f in own] != [(f.kind, f.axis) for f in theirs]:
            return {}
        for one, two in zip(own, theirs, strict=True):
            apart = abs(one.nominal - two.nominal)
            if one.kind == "rotate" and apart > _SAME_ANGLE_RAD:
                return {}
            if one.kind == "translate" and apart > _SAME_LENGTH_M:
                lengths[one.parameter] = (one.nominal, two.nominal)
    return lengths


def _error_with(residuals: Residuals, x_nominal: Array, lengths: Mapping[str, tuple[float, float]]) -> float:
    """RMS position error [m] with other lengths, free frames fitted to them; infinite where one is no parameter."""
    names = [p.name for p in residuals.parameters]
    if not set(lengths) <= set(names):
        return float("inf")
    x = x_nominal.copy()
    for name, (own, theirs) in lengths.items():
        x[names.index(name)] = theirs - own
    x, _ = minimum_of(residuals, x, free_directions(residuals, x), np.zeros((0, len(x))))
    return rms_length(position_errors(residuals, x))


def free_directions(residuals: Residuals, x: Array) -> Array:
    """Directions (k, f) of the free frames and touched points at an arm ``x`` (k,)."""
    columns = residuals.free
    if not len(columns):
        return np.zeros((len(x), 0))
    J = residuals.residuals_and_jacobian(x)[1][:, columns]
    part = identify_parameters([residuals.parameters[i].name for i in columns], J, len(residuals.data))
    directions = np.zeros((len(x), part.rank))
    directions[columns] = part.directions
    return directions
