"""The deviations of a model from measurements: by direction, and whether they scatter about zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.measurements.measurements import Measurements, group_means
from posture_opt.numerics import Array, Codes
from posture_opt.validation.mean_test import BlockMean, MeanTest, block_tests, mean_test

_TILT = 1e-6  # rad: rounding of a direction that was written down


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
        rms = float(np.sqrt(np.mean(sizes**2)))
        return cls(name, bias, rms, float(sizes.mean()), float(np.quantile(sizes, 0.95)), float(sizes.max()))


@dataclass(frozen=True, eq=False)
class ModelErrors:
    """Deviations of one model: by direction, and whether they scatter about zero.

    Args:
        deviations: cross-validated, one entry a direction.
        mean: test of the mean over all poses; ``None`` for touched points, whose places nobody knows otherwise.
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

    def to_json(self) -> dict[str, Any]:
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
    """
    parts = [("xyz"[axis], errors[:, [axis]]) for axis in axes]
    if direction is not None:
        along = (errors @ direction)[:, None]
        both = (("along", along), ("across", errors - along * direction))
        parts += [part for part, known in zip(both, told(axes, direction), strict=True) if known]
    deviations = tuple(Deviation.of(name, vectors) for name, vectors in (*parts, ("all", errors[:, axes])))
    measured = errors[:, axes]
    coordinate = float(np.sqrt(np.mean(measured**2)))
    beyond = float(np.mean(np.abs(measured - measured.mean(axis=0)) > 3 * measured.std(axis=0)))
    means = group_means(fitted[:, axes], data.pose)
    places = group_means(data.q if data.position is None else data.position, data.pose)
    overall = None if data.position is None else mean_test(means)
    return ModelErrors(deviations, overall, block_tests(means, places), coordinate, beyond)


def told(axes: Codes, direction: Array) -> tuple[bool, bool]:
    """Whether what was measured tells of along the direction, and of across it: a plane has one line across."""
    hidden = np.abs(np.delete(direction, axes))
    return bool(np.all(hidden < _TILT)), bool(np.all((hidden < _TILT) | (hidden > 1 - _TILT)))
