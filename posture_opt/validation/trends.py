"""Whether errors move with time, temperature or payload, or with the side from which a joint arrived."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Json
from posture_opt.validation.model_errors import holm_rejections, hotelling_p_value

_MIN_HOURS_S = 2 * 3600.0  # s: shorter times are written in minutes
_UNITS = {"time": (" h", 1 / 3600), "temperature": (" degC", 1.0), "payload": (" kg", 1.0)}
"""Input -> unit in reports and factor from SI."""
_MAX_BATCHES = 20  # of neighbouring rows, whose errors are alike: their means are taken for independent
_MIN_BATCH_ROWS = 3  # rows of a batch
_MIN_SIDED_BATCHES = 6  # batches with arrivals from both sides
_MIN_LEVER_SHARE = 1e-9  # of the largest lever: a joint that does not move the tool point


@dataclass(frozen=True, eq=False)
class Trend:
    """The straight line of errors over an input.

    Args:
        name: ``time``, ``row`` where no time was noted, ``temperature`` or ``payload``.
        range: the smallest and the largest input [s, 1, degC or kg].
        change: (d,) of the mean error from the one to the other [m]; ``error`` its standard errors.
        p_value: of no change; ``found`` whether it is given up, together with the other inputs, at 5 %.
    """

    name: str
    range: tuple[float, float]
    change: Array
    error: Array
    p_value: float
    found: bool = False

    @property
    def span(self) -> str:
        """The range with its unit; time in h, up to two hours in min."""
        if self.name == "row":
            return "first to last"
        unit, factor = _UNITS[self.name]
        if self.name == "time" and self.range[1] - self.range[0] < _MIN_HOURS_S:
            unit, factor = " min", 1 / 60
        low, high = (f"{factor * value:.4g}" for value in self.range)
        return f"{low} to {high}{unit}"

    def to_json(self) -> dict[str, Json]:
        """Plain numbers."""
        return {
            "input": self.name, "range": list(self.range), "change": self.change.tolist(),
            "std_error": self.error.tolist(), "p_value": self.p_value, "found": self.found,
        }  # fmt: skip


@dataclass(frozen=True)
class Sides:
    """Mean error along a joint's motion where its value was increasing on arrival, minus where it was decreasing [m].

    Lost motion makes it negative: the joint stops short.
    """

    joint: str
    difference: float
    error: float
    p_value: float
    found: bool = False

    def to_json(self) -> dict[str, Json]:
        """Plain numbers [m]."""
        return {
            "joint": self.joint, "difference": self.difference, "std_error": self.error, "p_value": self.p_value,
            "found": self.found,
        }  # fmt: skip


def trends_of(data: Measurements, errors: Array) -> tuple[Trend, ...]:
    """The lines of errors (N, d) [m] over every input that changes; fewer rows than lines need have none."""
    order = ("row", np.arange(len(data), dtype=float)) if data.time is None else ("time", data.time)
    inputs = (order, ("temperature", data.temperature), ("payload", data.payload))
    found = [line for name, x in inputs if x is not None and (line := trend_line(name, x, errors)) is not None]
    kept = holm_rejections([line.p_value for line in found])
    return tuple(
        Trend(t.name, t.range, t.change, t.error, t.p_value, given_up)
        for t, given_up in zip(found, kept, strict=True)
    )  # fmt: skip


def trend_line(name: str, x: Array, errors: Array) -> Trend | None:
    """The least squares line of errors (N, d) over x (N,), through the means of batches of neighbours.

    With the slope b, its covariance S from ν = batches − 2 degrees of freedom, ``T² = bᵀ S⁻¹ b`` is Hotelling's.
    """
    batches = np.array_split(np.argsort(x, kind="stable"), min(_MAX_BATCHES, len(x) // _MIN_BATCH_ROWS) or 1)
    nu = len(batches) - 2
    if nu <= errors.shape[1] or not np.ptp(x) > 0:
        return None
    at, means = np.array([x[b].mean() for b in batches]), np.array([errors[b].mean(axis=0) for b in batches])
    off = at - at.mean()
    if not off @ off > 0:
        return None
    slope = off @ means / (off @ off)
    left = means - means.mean(axis=0) - np.outer(off, slope)
    S = left.T @ left / nu / (off @ off)
    extent = float(np.ptp(x))
    return Trend(
        name,
        (float(x.min()), float(x.max())),
        slope * extent,
        np.sqrt(np.diag(S)) * extent,
        hotelling_p_value(slope, S, nu),
    )


def sides_of(data: Measurements, errors: Array, motions: list[Array]) -> tuple[Sides, ...]:
    """The joints that arrived often from both sides, and what that changes in the error along their motion.

    Differences are taken within batches of neighbouring rows, where all else is much alike, and tested over them.

    Args:
        errors: (N, 3) [m].
        motions: by joint, (N, 3) how it moves the tool point [m/rad or m/m].
    """
    found = []
    for k, motion in enumerate(motions):
        lever = np.linalg.norm(motion, axis=1)
        moves = np.flatnonzero(
            (lever > _MIN_LEVER_SHARE * max(lever.max(initial=0.0), 1.0)) & (data.approach[:, k] != 0)
        )
        along = np.sum(errors * motion, axis=1)[moves] / lever[moves]
        differences = _side_differences(data.approach[moves, k], along)
        if len(differences) >= _MIN_SIDED_BATCHES:
            found.append(_compare_sides(data.joint_names[k], differences))
    kept = holm_rejections([sides.p_value for sides in found])
    return tuple(
        Sides(s.joint, s.difference, s.error, s.p_value, given_up) for s, given_up in zip(found, kept, strict=True)
    )


def _side_differences(side: Array, along: Array) -> Array:
    """Mean of those that arrived increasing minus mean of those decreasing, in each batch that has both.

    Args:
        side: (M,) −1 or +1 of one joint; along: (M,) errors along the direction in which it moves the tool [m].
    """
    rarer = min(int(np.count_nonzero(side < 0)), int(np.count_nonzero(side > 0)))
    batches = np.array_split(np.arange(len(side)), max(min(_MAX_BATCHES, rarer // _MIN_BATCH_ROWS), 1))
    both = [rows for rows in batches if np.ptp(side[rows]) > 0] if rarer else []
    return np.array([along[rows][side[rows] > 0].mean() - along[rows][side[rows] < 0].mean() for rows in both])


def _compare_sides(joint: str, differences: Array) -> Sides:
    """Student's t test of the mean of differences between batches, two-sided."""
    from scipy.special import stdtr

    mean, error = float(differences.mean()), float(differences.std(ddof=1) / math.sqrt(len(differences)))
    p_value = float(2 * stdtr(len(differences) - 1, -abs(mean) / error)) if error else 1.0
    return Sides(joint, mean, error, p_value)
