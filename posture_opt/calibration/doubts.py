"""What can hardly be as a file of measurements says: copies of rows, °F for °C, sides that contradict the rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import SAME_POSTURE_RAD
from posture_opt.numerics import Array, Codes, Json
from posture_opt.statements import Statement, state

_WARMEST_C = 60.0
"""°C of cells in which arms are measured, at the most: data sheets allow 45 to 55 °C."""
_MIN_SIDES, _CONTRADICTING_SHARE = 20, 0.9
"""Moves that state a side, and the share of them against the order of the rows that is no chance."""


@dataclass(frozen=True)
class Doubt:
    """A doubt about a file, by its ``id``, with the numbers that raise it."""

    id: str
    values: Mapping[str, int | float]

    @property
    def statement(self) -> Statement:
        """What it says."""
        return state(f"calibration.doubt-{self.id}", **self.values)

    def to_json(self) -> dict[str, Json]:
        """The entry of ``doubts``."""
        return {"id": self.id, **self.values}


def doubts_about(data: Measurements) -> tuple[Doubt, ...]:
    """All doubts about a file, as it was read."""
    found = list[Doubt]()
    copies = len(data) - len(_first_rows(data))
    if copies:
        found.append(Doubt("copies", {"rows": copies, "of": len(data)}))
    if data.temperature is not None and float(data.temperature.max()) > _WARMEST_C:
        low, high = float(data.temperature.min()), float(data.temperature.max())
        found.append(
            Doubt("fahrenheit", {"low": low, "high": high, "low_if_f": _celsius(low), "high_if_f": _celsius(high)})
        )
    against, moves = _contradicted_sides(data)
    if moves >= _MIN_SIDES and against > _CONTRADICTING_SHARE * moves:
        found.append(Doubt("approach", {"against": against, "moves": moves}))
    return tuple(found)


def without_copies(data: Measurements) -> Measurements:
    """The rows that are no exact copies of others: a row that was pasted twice is no second measurement."""
    kept = _first_rows(data)
    return data if len(kept) == len(data) else data.take(kept)


def _first_rows(data: Measurements) -> Codes:
    """The rows whose every number is not that of a row before; all of them where nothing was measured by position."""
    if data.position is None or data.lever is not None:
        return np.arange(len(data))
    logged = [v for v in (data.rotation, data.payload, data.temperature, data.time) if v is not None]
    codes = [data.target, data.robot, data.pose] if data.pose_given else [data.target, data.robot]
    sides = [data.approach] if data.approach_given else []
    columns: list[Array] = [np.reshape(v, (len(data), -1)) for v in (data.q, data.position, *logged, *sides, *codes)]
    return np.sort(np.unique(np.concatenate(columns, axis=1), axis=0, return_index=True)[1])


def _contradicted_sides(data: Measurements) -> tuple[int, int]:
    """How many stated sides of approach are against the move from the row before, and how many moves state one."""
    if not data.approach_given:
        return 0, 0
    step, side = np.diff(data.q[data.order], axis=0), data.approach[data.order][1:]
    moved = (np.abs(step) > SAME_POSTURE_RAD) & (side != 0)
    return int(np.sum(np.sign(step[moved]) != np.sign(side[moved]))), int(moved.sum())


def _celsius(fahrenheit: float) -> float:
    return (fahrenheit - 32) / 1.8
