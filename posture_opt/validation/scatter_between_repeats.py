"""Scatter between visits of one posture, and what a problem predicts of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.residuals import Residuals
from posture_opt.measurements.repeat_groups import revisits, rows_of, slips
from posture_opt.numerics import Array, Mask
from posture_opt.validation.prediction import Errors, columns, joint_columns
from posture_opt.validation.scatter_model import Scatter
from posture_opt.validation.scatter_test import ScatterTest, scatter_test

COPY = 1e-9  # m: visits that agree to less are one row written twice


@dataclass(frozen=True, eq=False)
class Between:
    """Scatter between repeats, and what the problem predicts of it.

    Args:
        scatter: of the postures visited more than once.
        covariances: (G, d, d) predicted there [m²], and their ``test``; ``None`` where the problem says nothing of it.
        by: ``visit`` or ``joints``, see `visit_errors`.
        stated_sigma: (n,) of each joint from visit to visit, as stated [rad, m].
        odd: lines of postures that were left out.
    """

    scatter: Scatter
    covariances: Array | None
    test: ScatterTest | None
    by: str
    stated_sigma: Array
    odd: tuple[int, ...]

    @property
    def sigma(self) -> float:
        """Standard deviation of a coordinate, pooled [m]; 0 without repeats."""
        nu = self.scatter.freedom
        total = float(np.trace(self.scatter.squares, axis1=-2, axis2=-1).sum())
        return float(np.sqrt(total / (nu.sum() * self.scatter.squares.shape[1]))) if len(nu) else 0.0

    @classmethod
    def of(cls, used: Residuals, calibration: Calibration, errors: Errors) -> Between:
        """Of the rows that a calibration kept."""
        data = used.data
        visit, by = visit_errors(errors, used)
        driven = list(used.robot.driven)
        stated = np.zeros(len(driven))
        for k, factor in enumerate(driven):
            if factor in errors.factors:
                stated[k] = np.sqrt(visit[errors.factors.index(factor), errors.factors.index(factor)])
        codes = np.arange(len(data)) if data.touches else revisits(data, slides(used))
        scatter = Scatter.of(used.error(calibration.x)[:, used.axes], joint_columns(used, calibration.x), codes)
        firsts = np.array([rows[0] for rows in rows_of(codes) if len(rows) > 1], dtype=np.intp)
        copied = np.trace(scatter.squares, axis1=-2, axis2=-1) <= scatter.freedom * COPY**2
        scatter, firsts = scatter.take(~copied), firsts[~copied]
        size = np.trace(scatter.squares, axis1=-2, axis2=-1)
        gross = slips(size, scatter.freedom * scatter.squares.shape[1])
        odd = tuple(int(line) for line in data.line[firsts[gross]])
        scatter, firsts = scatter.take(~gross), firsts[~gross]
        if not len(firsts):
            return cls(scatter, None, None, by, stated, odd)
        first = used.take(firsts)
        B = columns(first, calibration.x, errors.factors)[:, : len(used.axes)] * used.sigma
        C = B @ visit @ np.swapaxes(B, -1, -2) + used.sigma**2 * np.eye(len(used.axes))
        if not visit.any():
            return cls(scatter, None, None, by, stated, odd)
        return cls(scatter, C, scatter_test(scatter, C, data.line[firsts]), by, stated, odd)


def visit_errors(errors: Errors, residuals: Residuals) -> tuple[Array, str]:
    """The covariance of what changes between visits; where the problem says nothing of it, σ's of joint values."""
    if errors.visit.any():
        return errors.visit, "visit"
    driven = np.array([factor in residuals.robot.driven for factor in errors.factors], dtype=bool)
    return np.where(np.outer(driven, driven), errors.constant, 0.0), "joints"


def slides(residuals: Residuals) -> Mask:
    """(n,) which joints are prismatic."""
    return np.array([joint.type == "prismatic" for joint in residuals.robot.joints])
