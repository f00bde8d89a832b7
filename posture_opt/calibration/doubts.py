"""What can hardly be as stated: copies of rows, units of temperatures, sides of approach, lengths of the arm."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.cross_validation import position_errors
from posture_opt.calibration.estimation.fit import Fit, minimum_of
from posture_opt.calibration.estimation.identifiability import identify_parameters
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.errors import enumerated
from posture_opt.files import preset_names
from posture_opt.measurements.measurements import SAME_POSTURE_RAD, Measurements
from posture_opt.model.effects.base.joint_effect import LostMotion
from posture_opt.numerics import Array, Codes, Json, rms_length
from posture_opt.robot.preset import load_preset
from posture_opt.robot.robot import Robot
from posture_opt.statements import Statement, state

_MIN_SIDES, _CONTRADICTING_SHARE = 20, 0.9
"""Moves of a joint that state a side, and the share of them against the order of the rows that is no chance."""
_CELL = (-30.0, 60.0)  # °C of cells in which arms are measured, at the most: data sheets allow 45 to 55 °C
# Unit that a temperature, read as °C, may have been written in -> what it is then [°C]
_OTHERWISE: Mapping[str, Callable[[float], float]] = {
    "°F": lambda t: (t - 32) / 1.8,
    "K": lambda t: t - 273.15,
    "°C": lambda t: t + 273.15,
}


@dataclass(frozen=True)
class Doubt:
    """A doubt about a file, by its ``id``, with the numbers that raise it, and as a statement."""

    id: str
    values: Mapping[str, int | float | str]
    statement: Statement

    def to_json(self) -> dict[str, Json]:
        return {"id": self.id, **self.values}


def doubts_about(data: Measurements) -> tuple[Doubt, ...]:
    """All doubts about a file, as it was read."""
    copies = {"rows": len(data) - len(_first_rows(data)), "of": len(data)}
    found = [Doubt("copies", copies, state("calibration.doubt-copies", **copies))] if copies["rows"] else []
    found += _temperature(data)
    doubted = sides_against_order(data)
    if len(doubted):
        against, moves = (counts[doubted].sum() for counts in _counted_sides(data))
        sums = {"against": int(against), "moves": int(moves)}
        joints = [data.joint_names[j] for j in doubted]
        joints = joints if len(joints) < len(data.joint_names) else ["JOINT"]
        columns = tuple(f"{name}.approach" for name in joints)
        found.append(Doubt("approach", sums, state("calibration.doubt-approach", columns=columns, **sums)))
    return tuple(found)


def _temperature(data: Measurements) -> list[Doubt]:
    if data.temperature is None or (_CELL[0] <= data.temperature.min() and data.temperature.max() <= _CELL[1]):
        return []
    ends = {"low": float(data.temperature.min()), "high": float(data.temperature.max())}
    for unit, read in _OTHERWISE.items():
        low, high = (read(value) for value in ends.values())
        if _CELL[0] <= low and high <= _CELL[1]:
            said = state("calibration.doubt-temperature", unit=unit, **ends, low_so=low, high_so=high)
            return [Doubt("temperature", {**ends, "unit": unit, "low_so": low, "high_so": high}, said)]
    return [Doubt("temperature", ends, state("calibration.doubt-temperature-unit", **ends))]


def sides_against_order(data: Measurements) -> Codes:
    """Indices of the joints whose stated sides of approach contradict the order of the rows."""
    against, moves = _counted_sides(data)
    return np.flatnonzero((moves >= _MIN_SIDES) & (against > _CONTRADICTING_SHARE * moves))


def _counted_sides(data: Measurements) -> tuple[Codes, Codes]:
    """(n,) moves of each joint whose stated side contradicts the order of the rows, and all that state one."""
    step, side = np.diff(data.q[data.order], axis=0), data.approach[data.order][1:]
    moved = (np.abs(step) > SAME_POSTURE_RAD) & (side != 0) & data.approach_given
    return np.sum(moved & (np.sign(step) != np.sign(side)), axis=0), moved.sum(axis=0)


def turned_sides(data: Measurements, model: Fit) -> set[str]:
    """The joints whose sides contradict the order of the rows, if one has a negative lost motion with them.

    Either alone may be true of an arm: one that passes its posture and returns, or compensates friction by too much.
    """
    doubted = {data.joint_names[j] for j in sides_against_order(data)}
    lost = zip(model.effects, model.slices, strict=True)
    negative = {e.moved_joint for e, part in lost if isinstance(e, LostMotion) and model.x[part.start] < 0}
    return doubted if doubted & negative else set()


def with_sides_reversed(data: Measurements, joints: set[str]) -> Measurements:
    """The rows with the sides of those joints reversed where they contradict the order of the rows; the data say so."""
    those = [j for j in sides_against_order(data) if data.joint_names[j] in joints]
    if not those:
        return data
    approach = data.approach.copy()
    approach[:, those] *= -1
    names = enumerated([data.joint_names[j] for j in those])
    said = "contradict the order of the rows and would make lost motion negative: they are read reversed"
    return replace(data, approach=approach, warnings=(*data.warnings, f"Stated sides of {names} {said}"))


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
