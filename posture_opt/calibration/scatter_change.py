"""Whether errors are larger from some row on: a stand was moved, a ball came loose, a socket is worn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Json, rms_length

_WINDOW = 10
"""Rows of a window, whose RMS counts once: neighbours err alike."""
_MIN_WINDOWS = 2
"""Windows on either side of the change."""
_LEVEL = 1e-3
"""Level of the test over all places together (Bonferroni)."""
_MIN_RATIO = 1.5
"""How many times larger errors are on one side, at the least: less changes nothing that is done."""


@dataclass(frozen=True)
class ScatterChange:
    """Rows from some line on that are farther off than those before, or nearer.

    Args:
        line: of the first row behind the change, in the file.
        before, after: RMS of the position errors [m].
        p_value: corrected for the number of places.
        points: touched points that only rows behind the change touch.
    """

    line: int
    before: float
    after: float
    p_value: float
    points: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Json]:
        """The part ``scatter_change`` of ``diagnosis.json`` [m]."""
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

    Args:
        errors: (N, axes) position errors [m] that the model leaves; data: of these rows.
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
    if not best < _LEVEL or max(before, after) < _MIN_RATIO * min(before, after):
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
