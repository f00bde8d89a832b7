"""Whether errors change along the rows: larger while an arm warms up, or from some row on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Json, rms_length

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
    if data.position is None:  # touched points are grouped by place
        return None
    e = errors[data.order]
    # Windows of 5 rows at the least: fewer say nothing of their RMS.
    counts = np.array([k for share in (1 / 40, 1 / 20, 1 / 10) if (k := int(share * len(e))) >= 5], dtype=np.intp)
    if not len(counts):
        return None
    p = min(_p_of_first_window(e, counts), 1.0)
    k = int(counts[np.argmin(_split_costs(e, counts))])
    first, rest = rms_length(e[:k]), rms_length(e[k:])
    # Without the worst of the first rows they must still be farther off than the others.
    without = np.delete(e, int(np.argmax(np.linalg.norm(e[: max(counts)], axis=1))), axis=0)
    # 1.25 times the RMS of the others at the least: less is not worth leaving rows out
    if p > _LEVEL or first < 1.25 * rest or _p_of_first_window(without, counts) > _LEVEL:
        return None
    time, T = (None if v is None else v[data.order] for v in (data.time, data.temperature))
    taken = None if time is None else float(time[k - 1] - time[0])
    seconds = None if taken is None or taken < 0 else taken  # a clock that started anew in between tells nothing
    # 0.7 of the range of each joint, as of rows spread like all: 5 rows drawn evenly reach over two thirds of it.
    whole, reached = np.ptp(data.q, axis=0), np.ptp(data.q[data.order[:k]], axis=0)
    spread = bool(np.all(reached[whole > 0] > 0.7 * whole[whole > 0]))
    warming = None if T is None else (float(T[k - 1] - T[0]), float(T[-1] - T[k]))
    return StartUp(k, seconds, first, rest, p, spread, warming)


def _p_of_first_window(errors: Array, counts: Codes) -> float:
    """p-value of the first window against the others, corrected for the lengths of windows (Bonferroni)."""
    from scipy.special import stdtr

    found = []
    for k in counts:
        first, *rest = _window_logs(errors, k)
        others = np.array(rest)
        t = (first - others.mean()) / max(float(others.std(ddof=1)) * np.sqrt(1 + 1 / len(others)), 1e-300)
        found.append(float(stdtr(len(others) - 1, -t)))
    return len(counts) * min(found)


def _window_logs(errors: Array, k: int) -> Array:
    """Logarithms of the RMS of windows of k rows, whose errors are alike and count once."""
    m = len(errors) // k
    squares = np.sum(errors[: m * k] ** 2, axis=1).reshape(m, k).mean(axis=1)
    return np.asarray(0.5 * np.log(np.maximum(squares, 1e-300)))


def _split_costs(errors: Array, k: Codes) -> Array:
    """``k log MS_before + (N − k) log MS_after``: of normal errors, least at the likeliest place of a change."""
    N, squares = len(errors), np.cumsum(np.sum(errors**2, axis=1))
    before, after = squares[k - 1] / k, (squares[-1] - squares[k - 1]) / (N - k)
    return np.asarray(k * np.log(np.maximum(before, 1e-300)) + (N - k) * np.log(np.maximum(after, 1e-300)))


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
    order, least = data.order, _MIN_WINDOWS * _WINDOW
    e = errors[order]
    count = len(e) // _WINDOW
    places = range(_MIN_WINDOWS, count - _MIN_WINDOWS + 1)
    y = _window_logs(e, _WINDOW) if len(places) else np.zeros(1)
    if not np.ptp(y) > 0:
        return None
    best = min(_p_of_means(y[:k], y[k:]) for k in places) * len(places)
    split = least + int(np.argmin(_split_costs(e, np.arange(least, len(e) - least + 1))))
    before, after = rms_length(e[:split]), rms_length(e[split:])
    # Level of the test over all places together (Bonferroni); less than 1.5 times changes nothing that is done.
    if not best < 1e-3 or max(before, after) < 1.5 * min(before, after):
        return None
    points: tuple[str, ...] = ()
    if data.touches:
        first, later = (set(data.point[part].tolist()) for part in (order[:split], order[split:]))
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
