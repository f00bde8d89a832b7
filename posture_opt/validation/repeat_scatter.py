"""Scatter between repeats of one posture, and what a problem predicts of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.measurements.measurements import outlying_groups, rows_of
from posture_opt.measurements.repeats import repeat_groups
from posture_opt.numerics import Array, Codes, Json, Mask
from posture_opt.validation.model_errors import holm_rejections
from posture_opt.validation.prediction import ErrorSources, joint_columns, joint_errors
from posture_opt.validation.scatter_model import Scatter

COPY_TOLERANCE_M = 1e-9  # m: repeats that agree to less are one row written twice
_MIN_FREEDOM_PER_AXIS = 2  # freedom per dimension: with less the likelihood ratio is not χ² even with Bartlett's factor


@dataclass(frozen=True, eq=False)
class RepeatScatter:
    """Scatter between repeats, and what the problem predicts of it.

    Args:
        scatter: of the postures commanded more than once.
        covariances: (G, d, d) predicted there [m²], and their ``test``; ``None`` where the problem says nothing of it.
        by: ``visit`` or ``joints``, see `repeat_errors`.
        stated_sigma: (n,) of each joint from repeat to repeat, as stated [rad, m].
        outlying: lines of postures that were left out.
    """

    scatter: Scatter
    covariances: Array | None
    test: ScatterTest | None
    by: str
    stated_sigma: Array
    outlying: tuple[int, ...]

    @property
    def sigma(self) -> float:
        """Standard deviation of a coordinate, pooled [m]; 0 without repeats."""
        nu = self.scatter.freedom
        total = float(np.trace(self.scatter.squares, axis1=-2, axis2=-1).sum())
        return float(np.sqrt(total / (nu.sum() * self.scatter.squares.shape[1]))) if len(nu) else 0.0

    @classmethod
    def of(cls, used: Residuals, calibration: Calibration, errors: ErrorSources) -> RepeatScatter:
        """Of the rows that a calibration kept.

        Postures whose repeats agree to `COPY_TOLERANCE_M` are copies of one row and do not count; postures whose
        scatter is far from that of all others are left out and listed.

        Args:
            used: the arm against the rows that count.
            errors: sources of the problem, split in what stays and what scatters.
        """
        data = used.data
        between, by = repeat_errors(errors, used)
        driven = joint_errors(used.robot)
        stated = np.zeros(len(driven))
        for k, name in enumerate(driven):
            if name in errors.names:
                stated[k] = np.sqrt(between[errors.names.index(name), errors.names.index(name)])
        codes = np.arange(len(data)) if data.position is None else repeat_groups(data, prismatic_joints(used))
        scatter = Scatter.of(used.error(calibration.x)[:, used.axes], joint_columns(used, calibration.x), codes)
        firsts = np.array([rows[0] for rows in rows_of(codes) if len(rows) > 1], dtype=np.intp)
        copied = np.trace(scatter.squares, axis1=-2, axis2=-1) <= scatter.freedom * COPY_TOLERANCE_M**2
        scatter, firsts = scatter.take(~copied), firsts[~copied]
        size = np.trace(scatter.squares, axis1=-2, axis2=-1)
        gross = outlying_groups(size, scatter.freedom * scatter.squares.shape[1])
        outlying = tuple(int(line) for line in data.line[firsts[gross]])
        scatter, firsts = scatter.take(~gross), firsts[~gross]
        if not len(firsts):
            return cls(scatter, None, None, by, stated, outlying)
        first = used.take(firsts)
        B = first.metres(first.sensitivities(errors.names, calibration.x)[:, : len(used.axes)])
        C = B @ between @ np.swapaxes(B, -1, -2) + used.sigma**2 * np.eye(len(used.axes))
        if not between.any():
            return cls(scatter, None, None, by, stated, outlying)
        return cls(scatter, C, scatter_test(scatter, C, data.line[firsts]), by, stated, outlying)


def repeat_errors(errors: ErrorSources, residuals: Residuals) -> tuple[Array, str]:
    """The covariance of what changes between repeats; where the problem says nothing of it, σ's of joint values.

    Returns:
        (k, k) covariance [rad², m²], and ``visit`` if the problem states scatter, ``joints`` if σ's of joints replace
            it.
    """
    if errors.scatter.any():
        return errors.scatter, "visit"
    driven = np.isin(errors.names, joint_errors(residuals.robot))
    return np.where(np.outer(driven, driven), errors.constant, 0.0), "joints"


def prismatic_joints(residuals: Residuals) -> Mask:
    """(n,) which joints are prismatic."""
    return np.array([joint.type == "prismatic" for joint in residuals.robot.joints])


@dataclass(frozen=True)
class PoseScatter:
    """The scatter about the mean at one posture.

    Args:
        line: of the first repeat; ``n`` repeats.
        measured, predicted: standard deviation of a coordinate, root of the mean over the axes [m].
        factor: measured over predicted, in the metric of the prediction.
        p_size, p_shape: probabilities of scatter so different in size, or in shape too (NaN with too few repeats), were
            the prediction true; ``true`` whether nothing speaks against it, all postures tested together.
    """

    line: int
    n: int
    measured: float
    predicted: float
    factor: float
    p_size: float
    p_shape: float
    true: bool

    def to_json(self) -> dict[str, Json]:
        """Plain numbers [m]."""
        shape = None if np.isnan(self.p_shape) else self.p_shape
        return {**vars(self), "p_shape": shape}


@dataclass(frozen=True, eq=False)
class ScatterTest:
    """Scatter between repeats against its prediction.

    Args:
        rows, groups: rows that repeat a posture, and how many postures.
        factor: measured over predicted standard deviation, pooled; ``interval`` holds it with 95 %.
        p_size, p_shape: as of a posture, over all of them.
        poses: those with most repeats first.
    """

    rows: int
    groups: int
    factor: float
    interval: tuple[float, float]
    p_size: float
    p_shape: float
    poses: tuple[PoseScatter, ...]

    @property
    def verdict(self) -> str:
        """``right``, ``understated`` or ``overstated``: whether the interval of the factor holds 1."""
        low, high = self.interval
        return "right" if low <= 1 <= high else "understated" if self.factor > 1 else "overstated"

    def to_json(self) -> dict[str, Json]:
        """Plain numbers [m]."""
        return {
            "visits": self.rows, "postures": self.groups, "factor": self.factor,
            "factor_interval95": list(self.interval), "p_size": self.p_size,
            "p_shape": None if np.isnan(self.p_shape) else self.p_shape, "verdict": self.verdict,
            "poses": [pose.to_json() for pose in self.poses],
        }  # fmt: skip


def scatter_test(scatter: Scatter, covariances: Array, lines: Codes) -> ScatterTest:
    """Sums of squares A_g with ν_g degrees of freedom against predicted covariances C_g (G, d, d) [m²].

    Size: ``tr(C_g⁻¹ A_g) ~ χ²(ν_g d)``, exactly, so that the pooled ``f² = Σ tr(C⁻¹ A) / Σ ν d`` has the interval
    ``Σ tr / χ²``. Size and shape: ``ν (tr(C⁻¹S) − ln |C⁻¹S| − d) ~ χ²(d (d + 1) / 2)`` for ``S = A / ν``, with
    Bartlett's factor ``1 − (2d² + 3d − 1) / (6 ν (d + 1))`` (Anderson 2003, 10.8), where ν is 2 d or more.
    Postures are judged together by Holm's (1979) rule.

    Args:
        lines: (G,) the line of each posture's first repeat.
        scatter: sums of squares and degrees of freedom of G postures; covariances: predicted (G, d, d) [m²].
    """
    from scipy.special import chdtrc, chdtri

    nu, d = scatter.freedom, scatter.squares.shape[1]
    whitened = np.linalg.solve(covariances, scatter.squares)
    size = np.trace(whitened, axis1=-2, axis2=-1)
    shape, used = _likelihood_ratios(np.asarray(whitened), nu, d)
    p_size, p_shape = _two_sided(size, nu * d), np.where(used, chdtrc(d * (d + 1) / 2, shape), np.nan)
    least = np.where(used, 2 * np.fmin(p_size, p_shape), p_size)  # two tests where there are two
    false = holm_rejections(list(least))
    total, freedom = float(size.sum()), float(nu.sum() * d)
    low, high = np.sqrt(total / np.array([chdtri(freedom, 0.025), chdtri(freedom, 0.975)]))
    many = int(used.sum())
    order = np.argsort(-nu, kind="stable")
    measured = np.sqrt(np.trace(scatter.squares, axis1=-2, axis2=-1) / (nu * d))
    predicted = np.sqrt(np.trace(covariances, axis1=-2, axis2=-1) / d)
    factors = np.sqrt(size / (nu * d))
    poses = tuple(
        PoseScatter(
            int(lines[g]), int(nu[g]) + 1, float(measured[g]), float(predicted[g]), float(factors[g]),
            float(p_size[g]), float(p_shape[g]), not false[g],
        )
        for g in order
    )  # fmt: skip
    return ScatterTest(
        rows=int(nu.sum()) + len(nu),
        groups=len(nu),
        factor=float(np.sqrt(total / freedom)),
        interval=(float(low), float(high)),
        p_size=float(_two_sided(total, freedom)),
        p_shape=float(chdtrc(many * d * (d + 1) / 2, shape[used].sum())) if many else float("nan"),
        poses=poses,
    )


def _likelihood_ratios(whitened: Array, nu: Array, d: int) -> tuple[Array, Mask]:
    """Statistics (G,) of the test of size and shape with Bartlett's factor, and where it holds (G,).

    Args:
        whitened: (G, d, d) ``C⁻¹ A``; nu: (G,) degrees of freedom.
    """
    used = nu >= _MIN_FREEDOM_PER_AXIS * d
    safe = np.where(used[:, None, None], whitened / nu[:, None, None], np.eye(d))
    ratio = nu * (np.trace(safe, axis1=-2, axis2=-1) - np.linalg.slogdet(safe)[1] - d)
    return np.maximum(ratio * (1 - (2 * d * d + 3 * d - 1) / (6 * nu * (d + 1))), 0.0), used


def _two_sided(value: Array | float, freedom: Array | float) -> Array:
    """Twice the smaller tail of χ².

    The p-value of a two-sided test, at most 1; ``value`` is χ² with ``freedom`` degrees under the null.
    """
    from scipy.special import chdtr, chdtrc

    return np.asarray(np.minimum(2 * np.minimum(chdtr(freedom, value), chdtrc(freedom, value)), 1.0))
