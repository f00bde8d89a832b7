"""Start-up: whether the first rows of a session are farther off than the others, as of an arm that is not warm yet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Json, rms_length

_SHARES = (1 / 40, 1 / 20, 1 / 10)
"""Shares of the rows that are looked at as the first ones."""
_MIN_ROWS = 5
"""Rows of a window at the least: fewer say nothing of its RMS."""
_LEVEL = 0.01
"""Level of the test over all looks together (Bonferroni)."""
_SPREAD_SHARE = 0.7
"""Of the range of each joint that first rows reach over where they are spread like all: 5 rows drawn evenly reach over
two thirds of it on average."""
_MIN_RATIO = 1.25
"""How many times larger the RMS of the first rows is, at the least: less is not worth leaving rows out."""


@dataclass(frozen=True)
class StartUp:
    """First rows that are farther off than the rest.

    Args:
        rows: how many; ``seconds`` from the first row to the last of them [s], None where no times are logged.
        rms: of their position errors [m]; ``rest`` of all others [m].
        p_value: corrected for the number of looks.
        spread: whether they are spread over the joint ranges as the others are, so that it is not where they are.
        warming: from the first of these rows to the last, and of all others, by how much the temperature rose [K]; None
            where none is logged.
    """

    rows: int
    seconds: float | None
    rms: float
    rest: float
    p_value: float
    spread: bool = False
    warming: tuple[float, float] | None = None

    def to_json(self) -> dict[str, Json]:
        """The part ``start_up`` of ``calibration.json`` and ``diagnosis.json`` [m, s, K]."""
        return {
            "rows": self.rows,
            "seconds": self.seconds,
            "residual_rms": {"first": self.rms, "rest": self.rest},
            "p_value": self.p_value,
            "temperature_rise": None if self.warming is None else list(self.warming),
        }


def start_up(errors: Array, data: Measurements) -> StartUp | None:
    """The first rows that are farther off than the rest, or None.

    The rows are cut into windows of k, in the order in which they were measured. The logarithm of the RMS of the first
    window is compared with those of the m others by ``t = (y_0 − mean y) / (s √(1 + 1/m))``, with m − 1 degrees of
    freedom: neighbouring rows err alike, so that windows scatter by more than as many independent rows would.
    One-sided, and corrected for the lengths of windows that are looked at.

    Args:
        errors: (N, 3) position errors [m] of rows that the model has not seen.
        data: of these rows; touched points, which are grouped by place, have no start-up.
    """
    if data.position is None:
        return None
    order = data.order
    counts = [k for share in _SHARES if (k := int(share * len(errors))) >= _MIN_ROWS]
    if not counts:
        return None
    p = min(len(counts) * min(_p_of_first_window(errors[order], k) for k in counts), 1.0)
    k = min(counts, key=lambda k: _log_scatter(errors[order], k))
    first, rest = rms_length(errors[order[:k]]), rms_length(errors[order[k:]])
    if p > _LEVEL or first < _MIN_RATIO * rest or _by_one_row(errors[order], counts):
        return None
    taken = None if data.time is None else float(data.time[order[k - 1]] - data.time[order[0]])
    seconds = None if taken is None or taken < 0 else taken  # a clock that started anew in between tells nothing
    return StartUp(k, seconds, first, rest, p, _spread(data.q[order], k), _warming(data, order, k))


def _by_one_row(errors: Array, counts: Sequence[int]) -> bool:
    """Whether the first rows are farther off by the worst of them alone: without it they are like the others."""
    without = np.delete(errors, int(np.argmax(np.linalg.norm(errors[: max(counts)], axis=1))), axis=0)
    return len(counts) * min(_p_of_first_window(without, k) for k in counts) > _LEVEL


def _warming(data: Measurements, order: Codes, k: int) -> tuple[float, float] | None:
    """By how much the temperature rose [K] over the first k rows and over the others; None where none is logged."""
    if data.temperature is None:
        return None
    T = data.temperature[order]
    return float(T[k - 1] - T[0]), float(T[-1] - T[k])


def _spread(q: Array, k: int) -> bool:
    """Whether the first k joint values (N, n) reach over most of the range of every joint that moves."""
    whole, first = np.ptp(q, axis=0), np.ptp(q[:k], axis=0)
    return bool(np.all(first[whole > 0] > _SPREAD_SHARE * whole[whole > 0]))


def _log_scatter(errors: Array, k: int) -> float:
    """``k log RMS_first + (N − k) log RMS_rest``: least where the change is, of normal errors the likeliest place."""
    first, rest = (max(rms_length(part), 1e-300) for part in (errors[:k], errors[k:]))
    return float(k * np.log(first) + (len(errors) - k) * np.log(rest))


def _p_of_first_window(errors: Array, k: int) -> float:
    """p-value of the first window of ``k`` rows against the others."""
    from scipy.special import stdtr

    m = len(errors) // k
    squares = np.sum(errors[: m * k] ** 2, axis=1).reshape(m, k).mean(axis=1)
    y = 0.5 * np.log(np.maximum(squares, 1e-300))
    others = y[1:]
    t = (y[0] - others.mean()) / max(float(others.std(ddof=1)) * np.sqrt(1 + 1 / len(others)), 1e-300)
    return float(stdtr(len(others) - 1, -t))
