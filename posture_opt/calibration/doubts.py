"""What can hardly be as stated: copies of rows, °F for °C, contradicted sides, another preset's link lengths."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.cross_validation import position_errors
from posture_opt.calibration.estimation.fit import minimum_of
from posture_opt.calibration.estimation.identifiability import identify_parameters
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.files import preset_names
from posture_opt.measurements.measurements import SAME_POSTURE_RAD, Measurements
from posture_opt.numerics import Array, Codes, Json, rms_length
from posture_opt.robot.preset import load_preset
from posture_opt.robot.robot import Robot
from posture_opt.statements import Statement, state

_MIN_SIDES, _CONTRADICTING_SHARE = 20, 0.9
"""Moves that state a side, and the share of them against the order of the rows that is no chance."""


@dataclass(frozen=True)
class Doubt:
    """A doubt about a file, by its ``id``, with the numbers that raise it."""

    id: str
    values: Mapping[str, int | float]

    @property
    def statement(self) -> Statement:
        return state(f"calibration.doubt-{self.id}", **self.values)

    def to_json(self) -> dict[str, Json]:
        return {"id": self.id, **self.values}


def doubts_about(data: Measurements) -> tuple[Doubt, ...]:
    """All doubts about a file, as it was read."""
    found = list[Doubt]()
    copies = len(data) - len(_first_rows(data))
    if copies:
        found.append(Doubt("copies", {"rows": copies, "of": len(data)}))
    # 60 °C of cells in which arms are measured, at the most: data sheets allow 45 to 55 °C.
    if data.temperature is not None and float(data.temperature.max()) > 60.0:
        degrees = {"low": float(data.temperature.min()), "high": float(data.temperature.max())}
        found.append(Doubt("fahrenheit", {**degrees, **{f"{k}_if_f": (v - 32) / 1.8 for k, v in degrees.items()}}))
    if data.approach_given:
        step, side = np.diff(data.q[data.order], axis=0), data.approach[data.order][1:]
        moved = (np.abs(step) > SAME_POSTURE_RAD) & (side != 0)
        against, moves = int(np.sum(np.sign(step[moved]) != np.sign(side[moved]))), int(moved.sum())
        if moves >= _MIN_SIDES and against > _CONTRADICTING_SHARE * moves:
            found.append(Doubt("approach", {"against": against, "moves": moves}))
    return tuple(found)


def without_copies(data: Measurements) -> Measurements:
    """The rows that are no exact copies of others: a row that was pasted twice is no second measurement."""
    kept = _first_rows(data)
    return data if len(kept) == len(data) else data.take(kept)


def _first_rows(data: Measurements) -> Codes:
    if data.position is None or data.lever is not None:
        return np.arange(len(data))
    logged = [v for v in (data.rotation, data.payload, data.temperature, data.time) if v is not None]
    codes = [data.target, data.robot, data.pose] if data.pose_given else [data.target, data.robot]
    sides = [data.approach] if data.approach_given else []
    columns: list[Array] = [np.reshape(v, (len(data), -1)) for v in (data.q, data.position, *logged, *sides, *codes)]
    return np.sort(np.unique(np.concatenate(columns, axis=1), axis=0, return_index=True)[1])


_SAME_ANGLE_RAD, _SAME_LENGTH_M = 1e-3, 1e-4
"""Angles of one structure, and lengths that are not worth a word, agree to this."""


@dataclass(frozen=True)
class OtherPreset:
    """A preset whose lengths the data have."""

    name: str  # of the preset; ``title`` of the arm
    title: str
    # of the position errors with its lengths, only free frames fitted [m]; ``stated`` with those of the file
    rms: float
    stated: float
    # parameter -> (length of the file, of the preset [m]), those that differ
    lengths: Mapping[str, tuple[float, float]]

    def to_json(self) -> dict[str, Json]:
        return {
            "name": self.name,
            "title": self.title,
            "residual_rms": {"stated": self.stated, "preset": self.rms},
            "lengths": {name: {"stated": a, "preset": b} for name, (a, b) in self.lengths.items()},
        }


def other_preset(residuals: Residuals, x_nominal: Array) -> OtherPreset | None:
    """The preset whose lengths explain the data where those of the file do not; None where there is none.

    x_nominal (k,) deviations [rad, m] with only the free frames fitted.
    """
    stated, names = rms_length(position_errors(residuals, x_nominal)), [p.name for p in residuals.parameters]
    # 2e-3 m RMS from which other lengths are tried: uncalibrated arms of the right type are off by 0.5 to 1.1 mm in
    # the real sets, an arm of the next generation by 9 mm and more.
    if stated < 2e-3:
        return None
    found = []
    for name in preset_names():
        preset = load_preset(name)
        lengths = _other_lengths(residuals.robot, preset)
        if not lengths or not set(lengths) <= set(names):
            continue
        x = x_nominal.copy()
        for length, (own, theirs) in lengths.items():
            x[names.index(length)] = theirs - own
        x, _ = minimum_of(residuals, x, free_directions(residuals, x), np.zeros((0, len(x))))
        found.append(OtherPreset(name, preset.name, rms_length(position_errors(residuals, x)), stated, lengths))
    best = min(found, key=lambda one: one.rms, default=None)
    return best if best is not None and best.rms * 3.0 < stated else None  # a third of the error at the most


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
