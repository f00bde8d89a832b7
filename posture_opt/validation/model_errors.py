"""Deviations of a model from measurements: by direction, whether they scatter about zero, and trends over inputs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.encoding import Encoded
from posture_opt.measurements.measurements import Measurements, group_means
from posture_opt.numerics import Array, Codes, rms
from posture_opt.uncertainty.regions import RANK_TOLERANCE

TEST_LEVEL = 0.05  # of the tests: so often a mean that is zero is called not zero


@dataclass(frozen=True, eq=False)
class MeanTest(Encoded, json="mean std_error=error groups p_value"):
    """Hotelling's test of a mean of zero."""

    mean: Array  # (d,) [m]
    error: Array  # (d,) standard errors of it [m]
    groups: int  # number of independent vectors
    p_value: float  # probability of a mean that far off, were the true one zero; NaN with too few vectors

    @property
    def zero(self) -> bool:
        """Whether nothing speaks against a mean of zero."""
        return not self.p_value < TEST_LEVEL


@dataclass(frozen=True, eq=False)
class BlockMean(Encoded, json="lower upper *test zero"):
    """The mean in one block, from ``lower`` to ``upper`` (k,) [m, rad]; ``zero`` is family-wise."""

    lower: Array
    upper: Array
    test: MeanTest
    zero: bool


def mean_test(vectors: Array) -> MeanTest:
    """Hotelling's test of the mean of independent vectors (n, d) [m].

    ``T² = n m̄ᵀ S⁻¹ m̄`` with the mean m̄ and the sample covariance S; ``T² (n − d) / (d (n − 1))`` has the
    distribution F(d, n − d) where the true mean is zero. Directions without any variance are left out of it.

    Source: H. Hotelling, Ann. Math. Stat. 2 (1931) 360.
    """
    n, d = vectors.shape
    mean = vectors.mean(axis=0)
    if n < 2:
        return MeanTest(mean, np.full(d, np.nan), n, float("nan"))
    S = np.atleast_2d(np.cov(vectors, rowvar=False)) / n
    return MeanTest(mean, np.sqrt(np.diag(S)), n, hotelling_p_value(mean, S, n - 1))


def hotelling_p_value(estimate: Array, S: Array, dof: float) -> float:
    """The probability of an estimate (d,) so far from zero, its covariance S (d, d) estimated with ``dof``.

    ``T² = yᵀ S⁻¹ y``; ``T² (ν + 1 − d) / (d ν)`` is F(d, ν + 1 − d) distributed where the true value is zero.
    Directions without variance are left out. NaN where S has no variance, or ν < d.
    """
    from scipy.special import fdtrc

    values, axes = np.linalg.eigh(S)
    varies = values > RANK_TOLERANCE * values[-1]
    rank = int(np.count_nonzero(varies))
    rest = dof + 1 - rank
    if not rank or rest <= 0:
        return float("nan")
    t2 = float(np.sum((estimate @ axes[:, varies]) ** 2 / values[varies]))
    return float(fdtrc(rank, rest, t2 * rest / (rank * dof)))


def block_tests(vectors: Array, places: Array) -> tuple[BlockMean, ...]:
    """Tests of the means of vectors (n, d) [m] in blocks of the workspace, together of size 5 %.

    The blocks cut the ``places`` (n, k) [m, rad] at medians. That a block's mean is zero is given up in the order of
    the p-values (S. Holm, Scand. J. Stat. 6 (1979) 65). Empty where the rows do not fill two blocks.
    """
    # Halves of halves across the longest side: 16 blocks at the most, as many as a person takes in, of 8 groups of rows
    # at the least: with fewer in space, Hotelling's test sees next to nothing.
    blocks: list[Codes] = [np.arange(len(places))]
    while len(blocks) < 16 and len(blocks[0]) >= 2 * 8:
        halves = []
        for rows in blocks:
            longest = np.argmax(np.ptp(places[rows], axis=0))
            ordered = rows[np.argsort(places[rows, longest], kind="stable")]
            halves += [ordered[: len(ordered) // 2], ordered[len(ordered) // 2 :]]
        blocks = halves
    if len(blocks) < 2:
        return ()
    tests = [mean_test(vectors[rows]) for rows in blocks]
    given_up = holm_rejections([test.p_value for test in tests])
    return tuple(
        BlockMean(places[rows].min(axis=0), places[rows].max(axis=0), test, not gone)
        for rows, test, gone in zip(blocks, tests, given_up, strict=True)
    )


def holm_rejections(p_values: list[float], size: float = TEST_LEVEL) -> list[bool]:
    """Which of several hypotheses are given up, so that any true one is with probability ``size`` at most.

    The least p-value is held against ``size / m`` of m hypotheses, the next against ``size / (m − 1)``, until one is
    kept.

    Source: S. Holm, Scand. J. Stat. 6 (1979) 65.
    """
    given_up = [False] * len(p_values)
    for rank, index in enumerate(np.argsort(p_values)):
        if not p_values[index] <= size / (len(p_values) - rank):
            break
        given_up[index] = True
    return given_up


@dataclass(frozen=True)
class Deviation(Encoded, json="bias rms mean p95 max"):
    """Deviations along one direction, or the lengths of those in a plane or in space [m]."""

    name: str  # ``x``, ``y``, ``z``, ``along`` and ``across`` the task's direction, or ``all``
    bias: float  # mean, with its sign along a direction; length of the mean vector otherwise
    rms: float  # rms, mean, p95, max: of the sizes
    mean: float
    p95: float
    max: float

    @classmethod
    def of(cls, name: str, vectors: Array) -> Deviation:
        """Of deviations (n, d) [m]."""
        sizes = np.linalg.norm(vectors, axis=1)
        mean = vectors.mean(axis=0)
        bias = float(mean[0]) if len(mean) == 1 else float(np.linalg.norm(mean))
        size = rms(sizes)
        return cls(name, bias, size, float(sizes.mean()), float(np.quantile(sizes, 0.95)), float(sizes.max()))


@dataclass(frozen=True, eq=False)
class ModelErrors(Encoded, json="deviations=by_direction mean_test=mean blocks mean_zero=zero beyond_3_sigma=beyond3"):
    """Deviations of one model: by direction, and whether they scatter about zero."""

    deviations: tuple[Deviation, ...]  # cross-validated, one entry a direction
    # test of the mean over all poses; ``None`` for touched points, whose places are not known otherwise
    mean: MeanTest | None
    # tests of the means in blocks of the workspace, for touched points in blocks of the joint values; empty with too
    # few poses
    blocks: tuple[BlockMean, ...]
    coordinate: float  # RMS of one coordinate [m]
    beyond3: float  # share of the coordinates beyond three standard deviations of their axis; 0.27 % of normal ones

    @property
    def zero(self) -> bool:
        """Whether nothing speaks against a mean of zero, anywhere."""
        return (self.mean is None or self.mean.zero) and all(block.zero for block in self.blocks)

    @property
    def by_direction(self) -> dict[str, Deviation]:
        """The deviations by the name of their direction."""
        return {deviation.name: deviation for deviation in self.deviations}


def model_errors(data: Measurements, errors: Array, fitted: Array, axes: Codes, direction: Array | None) -> ModelErrors:
    """The deviations of one model from measurements, measured minus model [m].

    errors (N, 3) of rows that the model has not seen; fitted (N, 3) of the model fitted to all rows; the means of these
    are tested; direction (3,) unit vector of the task.
    """
    parts = [("xyz"[axis], errors[:, [axis]]) for axis in axes]
    if direction is not None:
        along = (errors @ direction)[:, None]
        both = (("along", along), ("across", errors - along * direction))
        parts += [part for part, known in zip(both, measured_parts(axes, direction), strict=True) if known]
    deviations = tuple(Deviation.of(name, vectors) for name, vectors in (*parts, ("all", errors[:, axes])))
    measured = errors[:, axes]
    coordinate = rms(measured)
    beyond = float(np.mean(np.abs(measured - measured.mean(axis=0)) > 3 * measured.std(axis=0)))
    means = group_means(fitted[:, axes], data.pose)
    places = group_means(data.q if data.position is None else data.position, data.pose)
    overall = None if data.position is None else mean_test(means)
    return ModelErrors(deviations, overall, block_tests(means, places), coordinate, beyond)


def measured_parts(axes: Codes, direction: Array) -> tuple[bool, bool]:
    """Whether the measured axes show deviations along the direction (3,), and across it: a plane has one line."""
    hidden = np.abs(np.delete(direction, axes))
    none, all_of_it = hidden < 1e-6, hidden > 1 - 1e-6  # rad: rounding of a direction that was written down
    return bool(np.all(none)), bool(np.all(none | all_of_it))


_UNITS = {"time": (" h", 1 / 3600), "temperature": (" degC", 1.0), "payload": (" kg", 1.0)}
"""Input -> unit in reports and factor from SI."""
_MAX_BATCHES = 20  # of neighbouring rows, whose errors are alike: their means are taken for independent
_MIN_BATCH_ROWS = 3  # rows of a batch


@dataclass(frozen=True, eq=False)
class Trend(Encoded, json="input=name range change std_error=error p_value found"):
    """The straight line of errors over an input."""

    name: str  # ``time``, ``row`` where no time was noted, ``temperature`` or ``payload``
    range: tuple[float, float]  # the smallest and the largest input [s, 1, degC or kg]
    change: Array  # (d,) of the mean error from the one to the other [m]; ``error`` its standard errors
    error: Array
    p_value: float  # of no change; ``found`` whether it is given up, together with the other inputs, at 5 %
    found: bool = False

    @property
    def span(self) -> str:
        """The range with its unit; time in h, up to two hours in min."""
        if self.name == "row":
            return "first to last"
        unit, factor = _UNITS[self.name]
        if self.name == "time" and self.range[1] - self.range[0] < 2 * 3600.0:  # short times in minutes
            unit, factor = " min", 1 / 60
        low, high = (f"{factor * value:.4g}" for value in self.range)
        return f"{low} to {high}{unit}"


@dataclass(frozen=True)
class Sides(Encoded, json="joint difference std_error=error p_value found"):
    """Mean error along a joint's motion on arrivals with increasing values, minus decreasing ones [m]."""

    joint: str
    difference: float
    error: float
    p_value: float
    found: bool = False


def trends_of(data: Measurements, errors: Array) -> tuple[Trend, ...]:
    """The lines of errors (N, d) [m] over every input that changes; fewer rows than lines need have none."""
    order = ("row", np.arange(len(data), dtype=float)) if data.time is None else ("time", data.time)
    inputs = (order, ("temperature", data.temperature), ("payload", data.payload))
    found = [line for name, x in inputs if x is not None and (line := trend_line(name, x, errors)) is not None]
    given_up = holm_rejections([line.p_value for line in found])
    return tuple(replace(line, found=up) for line, up in zip(found, given_up, strict=True))


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

    errors (N, 3) [m]; motions: by joint, (N, 3) how it moves the tool point [m/rad or m/m].
    """
    from scipy.special import stdtr

    found = []
    for k, motion in enumerate(motions):
        lever = np.linalg.norm(motion, axis=1)
        # 1e-9 of the largest lever: a joint that does not move the tool point
        moving = lever > 1e-9 * max(lever.max(initial=0.0), 1.0)
        moves = np.flatnonzero(moving & (data.approach[:, k] != 0))
        along, side = np.sum(errors * motion, axis=1)[moves] / lever[moves], data.approach[moves, k]
        # Means of increasing minus decreasing arrivals, in batches of neighbours that have both.
        rarer = min(int(np.count_nonzero(side < 0)), int(np.count_nonzero(side > 0)))
        batches = np.array_split(np.arange(len(side)), max(min(_MAX_BATCHES, rarer // _MIN_BATCH_ROWS), 1))
        both = [rows for rows in batches if np.ptp(side[rows]) > 0] if rarer else []
        apart = np.array([along[rows][side[rows] > 0].mean() - along[rows][side[rows] < 0].mean() for rows in both])
        if len(apart) >= 6:  # batches with arrivals from both sides
            mean, error = float(apart.mean()), float(apart.std(ddof=1) / math.sqrt(len(apart)))
            p = float(2 * stdtr(len(apart) - 1, -abs(mean) / error)) if error else 1.0  # Student's t
            found.append(Sides(data.joint_names[k], mean, error, p))
    given_up = holm_rejections([sides.p_value for sides in found])
    return tuple(replace(sides, found=up) for sides, up in zip(found, given_up, strict=True))
