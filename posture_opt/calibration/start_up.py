"""Whether errors change along the rows: larger while an arm warms up, or from some row on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Json, rms_length

_SHARES = (1 / 40, 1 / 20, 1 / 10)
"""Shares of the rows that are looked at as the first ones."""
_LEVEL = 0.01
"""Level of the test over all looks together (Bonferroni)."""


@dataclass(frozen=True)
class StartUp:
    """First rows that are farther off than the rest."""

    rows: int  # how many; ``seconds`` from the first row to the last of them [s], None where no times are logged
    seconds: float | None
    rms: float  # of their position errors [m]; ``rest`` of all others [m]
    rest: float
    p_value: float  # corrected for the number of looks
    # whether they are spread over the joint ranges as the others are, so that it is not where they are
    spread: bool = False
    # from the first of these rows to the last, and of all others, by how much the temperature rose [K]; None where none
    # is logged
    warming: tuple[float, float] | None = None

    def to_json(self) -> dict[str, Json]:
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

    errors (N, 3) position errors [m] of rows that the model has not seen.
    """
    if data.position is None:
        return None
    order = data.order
    # 5 rows of a window at the least: fewer say nothing of its RMS.
    counts = [k for share in _SHARES if (k := int(share * len(errors))) >= 5]
    if not counts:
        return None
    p = min(len(counts) * min(_p_of_first_window(errors[order], k) for k in counts), 1.0)
    k = min(counts, key=lambda k: _log_scatter(errors[order], k))
    first, rest = rms_length(errors[order[:k]]), rms_length(errors[order[k:]])
    # 1.25 times: larger the RMS of the first rows is, at the least: less is not worth leaving rows out.
    if p > _LEVEL or first < 1.25 * rest or _by_one_row(errors[order], counts):
        return None
    taken = None if data.time is None else float(data.time[order[k - 1]] - data.time[order[0]])
    seconds = None if taken is None or taken < 0 else taken  # a clock that started anew in between tells nothing
    return StartUp(k, seconds, first, rest, p, _spread(data.q[order], k), _warming(data, order, k))


def _by_one_row(errors: Array, counts: Sequence[int]) -> bool:
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
    # 0.7 of the range of each joint that first rows reach over where they are spread like all: 5 rows drawn evenly
    # reach over two thirds of it on average.
    return bool(np.all(first[whole > 0] > 0.7 * whole[whole > 0]))


def _log_scatter(errors: Array, k: int) -> float:
    """``k log RMS_first + (N − k) log RMS_rest``: least where the change is, of normal errors the likeliest place."""
    first, rest = (max(rms_length(part), 1e-300) for part in (errors[:k], errors[k:]))
    return float(k * np.log(first) + (len(errors) - k) * np.log(rest))


def _p_of_first_window(errors: Array, k: int) -> float:
    from scipy.special import stdtr

    m = len(errors) // k
    squares = np.sum(errors[: m * k] ** 2, axis=1).reshape(m, k).mean(axis=1)
    y = 0.5 * np.log(np.maximum(squares, 1e-300))
    others = y[1:]
    t = (y[0] - others.mean()) / max(float(others.std(ddof=1)) * np.sqrt(1 + 1 / len(others)), 1e-300)
    return float(stdtr(len(others) - 1, -t))


_WINDOW = 10
"""Rows of a window, whose RMS counts once: neighbours err alike."""
_MIN_WINDOWS = 2
"""Windows on either side of the change."""


@dataclass(frozen=True)
class ScatterChange:
    """Rows from some line on that are farther off than those before, or nearer."""

    line: int  # of the first row behind the change, in the file
    before: float  # before, after: RMS of the position errors [m]
    after: float
    p_value: float  # corrected for the number of places
    points: tuple[str, ...] = ()  # touched points that only rows behind the change touch

    def to_json(self) -> dict[str, Json]:
        return {
            "line": self.line,
            "residual_rms": {"before": self.before, "after": self.after},
            "p_value": self.p_value,
            "points": list(self.points),
        }


def scatter_change(errors: Array, data: Measurements) -> ScatterChange | None:
    """Where errors are of another size from some row on, or None.

    The rows are cut into windows of `_WINDOW`, in the order in which they were measured. At each place between two
    windows the logarithms of their RMS on both sides are compared by Student's t of unequal variances (Welch 1947).

    errors (N, axes) position errors [m] that the model leaves; data: of these rows.
    """
    order = data.order
    count = len(errors) // _WINDOW
    places = range(_MIN_WINDOWS, count - _MIN_WINDOWS + 1)
    if not len(places):
        return None
    squares = np.sum(errors[order[: count * _WINDOW]] ** 2, axis=1).reshape(count, _WINDOW).mean(axis=1)
    y = 0.5 * np.log(np.maximum(squares, 1e-300))
    if not np.ptp(y) > 0:
        return None
    best = min(_p_of_means(y[:k], y[k:]) for k in places) * len(places)
    split = _likeliest_row(errors[order])
    before, after = rms_length(errors[order[:split]]), rms_length(errors[order[split:]])
    # 1e-3 level of the test over all places together (Bonferroni).
    # 1.5 times: larger errors are on one side, at the least: less changes nothing that is done.
    if not best < 1e-3 or max(before, after) < 1.5 * min(before, after):
        return None
    points: tuple[str, ...] = ()
    if data.touches:
        first, later = (set(data.point[order[part]].tolist()) for part in (slice(split), slice(split, None)))
        points = tuple(data.point_names[i] for i in sorted(later - first))
    return ScatterChange(int(data.line[order[split]]), before, after, min(best, 1.0), points)


def _p_of_means(a: Array, b: Array) -> float:
    """Two-sided p-value of equal means of two samples of unequal variances.

    Source: Welch (1947), Biometrika 34, 28-35. scipy.stats has it too, and takes half a second to be imported.
    """
    from scipy.special import stdtr

    own = np.array([a.var(ddof=1) / len(a), b.var(ddof=1) / len(b)])
    if not own.sum() > 0:
        return 1.0
    freedom = own.sum() ** 2 / (own[0] ** 2 / (len(a) - 1) + own[1] ** 2 / (len(b) - 1))
    return float(2 * stdtr(freedom, -abs(a.mean() - b.mean()) / np.sqrt(own.sum())))


def _likeliest_row(errors: Array) -> int:
    """The first row of the later part where ``k log RMS_before + (N − k) log RMS_after`` is least."""
    N, least = len(errors), _MIN_WINDOWS * _WINDOW
    squares = np.cumsum(np.sum(errors**2, axis=1))
    k = np.arange(least, N - least + 1)
    before, after = squares[k - 1] / k, (squares[-1] - squares[k - 1]) / (N - k)
    cost = k * np.log(np.maximum(before, 1e-300)) + (N - k) * np.log(np.maximum(after, 1e-300))
    return int(k[np.argmin(cost)])
