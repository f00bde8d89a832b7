"""The deviations of a model from measurements: by direction, and whether they scatter about zero, anywhere.

A mean that is not zero is an error that the model repeats; it can be corrected. What scatters about zero cannot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.measurements.measurements import Measurements, group_means
from posture_opt.numerics import Array, Codes, Json, finite_or_none, rms
from posture_opt.uncertainty.regions.regions import RANK_TOLERANCE

TEST_LEVEL = 0.05  # of the tests: so often a mean that is zero is called not zero
_MIN_BLOCK_GROUPS = 8  # groups of rows in a block: with fewer in space, Hotelling's test sees next to nothing
_MAX_BLOCKS = 16  # blocks: as many as a person takes in
_DIRECTION_TOLERANCE = 1e-6  # rad: rounding of a direction that was written down


@dataclass(frozen=True, eq=False)
class MeanTest:
    """Hotelling's test of a mean of zero.

    Args:
        mean: (d,) [m].
        error: (d,) standard errors of it [m].
        groups: number of independent vectors.
        p_value: probability of a mean that far off, were the true one zero; NaN with too few vectors.
    """

    mean: Array
    error: Array
    groups: int
    p_value: float

    @property
    def zero(self) -> bool:
        """Whether nothing speaks against a mean of zero."""
        return not self.p_value < TEST_LEVEL

    def to_json(self) -> dict[str, Json]:
        """Plain numbers [m]."""
        return {
            "mean": self.mean.tolist(), "std_error": [finite_or_none(v) for v in self.error], "groups": self.groups,
            "p_value": finite_or_none(self.p_value),
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class BlockMean:
    """The mean in one block, from ``lower`` to ``upper`` (k,) [m, rad]; ``zero`` is family-wise.

    The blocks are those of the workspace, or of the joint values where no position was measured.
    """

    lower: Array
    upper: Array
    test: MeanTest
    zero: bool

    def to_json(self) -> dict[str, Json]:
        """Plain numbers [m]."""
        box = {"lower": self.lower.tolist(), "upper": self.upper.tolist()}
        return {**box, **self.test.to_json(), "zero": self.zero}


def mean_test(vectors: Array) -> MeanTest:
    """Hotelling's test of the mean of independent vectors (n, d) [m].

    ``T² = n m̄ᵀ S⁻¹ m̄`` with the mean m̄ and the sample covariance S; ``T² (n − d) / (d (n − 1))`` has the
    distribution F(d, n − d) where the true mean is zero. Directions without any variance are left out of it.

    Source: H. Hotelling, Ann. Math. Stat. 2 (1931) 360.

    Example:
        >>> import numpy as np
        >>> found = mean_test(np.array([[1.0], [2.0], [3.0]]))
        >>> float(found.mean[0]), round(found.p_value, 3), found.zero
        (2.0, 0.074, True)
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
    blocks = _cut_blocks(places)
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

    Example:
        >>> holm_rejections([0.01, 0.04, 0.03])
        [True, False, False]
    """
    given_up = [False] * len(p_values)
    for rank, index in enumerate(np.argsort(p_values)):
        if not p_values[index] <= size / (len(p_values) - rank):
            break
        given_up[index] = True
    return given_up


def _cut_blocks(places: Array) -> list[Codes]:
    """Rows of each block: halves of halves across the longest side, of a size that a test can work with."""
    blocks: list[Codes] = [np.arange(len(places))]
    while len(blocks) < _MAX_BLOCKS and len(blocks[0]) >= 2 * _MIN_BLOCK_GROUPS:
        halves = []
        for rows in blocks:
            longest = np.argmax(np.ptp(places[rows], axis=0))
            ordered = rows[np.argsort(places[rows, longest], kind="stable")]
            halves += [ordered[: len(ordered) // 2], ordered[len(ordered) // 2 :]]
        blocks = halves
    return blocks


@dataclass(frozen=True)
class Deviation:
    """Deviations along one direction, or the lengths of those in a plane or in space [m].

    Args:
        name: ``x``, ``y``, ``z``, ``along`` and ``across`` the task's direction, or ``all``.
        bias: mean, with its sign along a direction; length of the mean vector otherwise.
        rms, mean, p95, max: of the sizes.
    """

    name: str
    bias: float
    rms: float
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
class ModelErrors:
    """Deviations of one model: by direction, and whether they scatter about zero.

    Args:
        deviations: cross-validated, one entry a direction.
        mean: test of the mean over all poses; ``None`` for touched points, whose places are not known otherwise.
        blocks: tests of the means in blocks of the workspace, for touched points in blocks of the joint values;
            empty with too few poses.
        coordinate: RMS of one coordinate [m].
        beyond3: share of the coordinates beyond three standard deviations of their axis; 0.27 % of normal ones.
    """

    deviations: tuple[Deviation, ...]
    mean: MeanTest | None
    blocks: tuple[BlockMean, ...]
    coordinate: float
    beyond3: float

    @property
    def zero(self) -> bool:
        """Whether nothing speaks against a mean of zero, anywhere."""
        return (self.mean is None or self.mean.zero) and all(block.zero for block in self.blocks)

    def to_json(self) -> dict[str, Json]:
        """Plain numbers [m]."""
        return {
            "deviations": {d.name: {k: v for k, v in vars(d).items() if k != "name"} for d in self.deviations},
            "mean_test": None if self.mean is None else self.mean.to_json(),
            "blocks": [block.to_json() for block in self.blocks],
            "mean_zero": self.zero,
            "beyond_3_sigma": self.beyond3,
        }


def model_errors(data: Measurements, errors: Array, fitted: Array, axes: Codes, direction: Array | None) -> ModelErrors:
    """The deviations of one model from measurements, measured minus model [m].

    Args:
        errors: (N, 3) of rows that the model has not seen.
        fitted: (N, 3) of the model fitted to all rows; the means of these are tested.
        axes: the coordinates that were measured.
        direction: (3,) unit vector of the task.

    Returns:
        Deviations by direction; a direction of the task is left out where the measured axes do not span it.
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
    return bool(np.all(hidden < _DIRECTION_TOLERANCE)), bool(
        np.all((hidden < _DIRECTION_TOLERANCE) | (hidden > 1 - _DIRECTION_TOLERANCE))
    )
