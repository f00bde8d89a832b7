"""Tests of model adequacy: lack of fit against repeats, and structure of any smooth shape in the residuals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.score_tests import ProjectedBaseline, orthonormal_basis, p_value_of_maximum
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import repeat_of_row
from posture_opt.numerics import Array, Codes, rms
from posture_opt.validation.scatter_model import whitened_repeats


def side_place(joint: str) -> str:
    """The side of approach of a joint, as `Adequacy.place` names it."""
    return f"side of {joint}"


@dataclass(frozen=True, eq=False)
class HeldResiduals:
    """What a fit with a prior leaves of the data, and of the prior: a wrong one shows in both.

    Args:
        e: (m,) whitened residuals of rows.
        prior: (p,) how far the estimate is from what the prior holds, weighed as in the fit.
        basis: (m + p, f) directions of the rows, then of the prior, that f fitted parameters reach.
    """

    e: Array
    prior: Array
    basis: Array

    @classmethod
    def of(cls, r: Array, columns: Array, prior: Array, known: Array) -> HeldResiduals:
        """The least squares ``min |r − A z|² + |r_p − K z|²``.

        Args:
            r, columns: (m,) residuals and A (m, k); prior, known: r_p (p,) and K (p, k).
        """
        Q = orthonormal_basis(np.concatenate([columns, known]))
        both = np.concatenate([r, prior])
        left = both - Q @ (Q.T @ both)
        return cls(left[: len(r)], left[len(r) :], Q)

    def weighed(self, scatter: Array, cell: Codes, repeat: Codes, code: Codes) -> HeldResiduals:
        """The least squares of the means of each cell, weighed as an arm whose joints scatter asks for.

        Args:
            scatter: (C, block, k) shift of a cell by each of k joints, per standard deviation of its scatter.
            cell: (N,) the cell of each row; repeat, code: (C,) the repeat that a cell is of, and the posture.
        """
        (C, block, k), m = scatter.shape, len(self.e)
        size = np.bincount(cell)
        columns = _group_means(
            np.column_stack([self.e, self.basis[:m]]).reshape(len(cell), -1), cell, np.ones(len(cell))
        )
        columns = columns.reshape(C, block, -1)
        # The instrument's own variance: what repeats differ by across all that the joints do.
        e = columns[:, :, 0]
        across = e - np.einsum("nbk,nkc,nc->nb", scatter, np.linalg.pinv(scatter), e)
        between = across - _group_means(across, code, size.astype(float))[code]
        free = max(block - k, 0) * (C - int(code.max()) - 1)
        own = float(np.sum(size[:, None] * between**2)) / free if free else 1.0
        variances = np.repeat(max(own, 1e-300) / size[:, None], block, axis=1)
        rows, basis = whitened_repeats(e, np.moveaxis(columns[:, :, 1:], 2, 0), scatter, repeat, variances)
        unit = max(rms(self.e), 1e-300)
        return HeldResiduals.of(
            rows.ravel(), np.moveaxis(basis, 0, 2).reshape(C * block, -1), self.prior / unit, self.basis[m:] / unit
        )


@dataclass(frozen=True)
class Adequacy:
    """Two tests for anything left unexplained.

    Args:
        lack_of_fit: p-value of the scatter about the model against that of repeats.
        structure: family-wise p-value of residuals of neighbours that are alike; ``place`` the variable along which
            they are most alike: a joint, ``side of JOINT``, ``tool point``, ``time``, ``payload`` or ``temperature``.
    """

    lack_of_fit: float
    structure: float
    place: str

    @property
    def p_value(self) -> float:
        return float(min(1.0, 2 * min(self.lack_of_fit, self.structure)))


def assess_adequacy(
    baseline: ProjectedBaseline, data: Measurements, groups: Codes, points: Array, block: int,
    held: HeldResiduals | None = None,
) -> Adequacy:  # fmt: skip
    """Both tests on the residuals that a baseline leaves.

    Args:
        groups: (N,) the rows that repeat one posture with one target, as in `repeat_groups`.
        points: (N, 3) tool points [m], world.
    """
    structure, place = _structure_test(baseline, data, groups, points, block)
    return Adequacy(lack_of_fit(held or left_of(baseline, len(data) * block), data, groups, block), structure, place)


def left_of(baseline: ProjectedBaseline, m: int) -> HeldResiduals:
    """The residuals of the first m rows of a baseline, which no prior holds."""
    return HeldResiduals(baseline.e[:m], np.zeros(0), baseline.Q[:m])


def lack_of_fit(
    held: HeldResiduals, data: Measurements, groups: Codes, block: int, scatter: Array | None = None
) -> float:  # fmt: skip
    """p-value of the F test of lack of fit: scatter about the model against that between repeats of one posture.

    ``F = (SS_left / ν_left) / (SS_pure / ν_pure)``, the rows of a prior among what is left. The p-value is 1 where
    repeats are too few (`levels`).

    Source: Draper, Smith (1998), section 2.1.

    Args:
        scatter: (N, block, k) shift of the rows per standard deviation of each joint that is known to scatter: where it
            moves the tool much, rows and repeats differ more than elsewhere.
    """
    from scipy.special import fdtrc

    repeat = repeat_of_row(data)
    cell, first, size = _group_codes(repeat, groups)
    code, _, repeats = _group_codes(groups[first])
    # Readings of one repeat share the joints' scatter, so they count by their mean; so do the targets of one repeat. A
    # mean of more is more certain where the instrument scatters most, and not where joints do: the larger p-value.
    shared = len(size) / (repeat[-1] + 1)
    weightings = [size.astype(float), np.ones(len(size))]
    if scatter is not None:
        held = held.weighed(scatter[first], cell, repeat[first], code)
        e, shared, weightings = held.e.reshape(-1, block), 1.0, weightings[1:]
    else:
        e = _group_means(held.e.reshape(-1, block), cell, np.ones(len(cell)))
    pure_freedom = int((repeats - 1).sum()) * block / shared
    freedom = (len(size) * block + len(held.prior) - held.basis.shape[1]) / shared - pure_freedom
    if pure_freedom < levels.MIN_REPEAT_FREEDOM or freedom < 1:
        return 1.0
    ratios = []
    for weights in weightings:
        pure = float(np.sum(weights[:, None] * (e - _group_means(e, code, weights)[code]) ** 2))
        left = float(np.sum(weights[:, None] * e**2)) - pure + float(held.prior @ held.prior)
        ratios.append((left / freedom) / max(pure / pure_freedom, 1e-300))
    return float(fdtrc(freedom, pure_freedom, max(min(ratios), 0.0)))


def _group_codes(*codes: Codes) -> tuple[Codes, Codes, Codes]:
    """(N,) the group of rows that agree in all codes, and of each group its first row and how many it has."""
    found = np.unique(np.column_stack(codes), axis=0, return_index=True, return_inverse=True, return_counts=True)
    return found[2].ravel(), found[1], found[3]


def _group_means(e: Array, code: Codes, weights: Array) -> Array:
    """(G, block) weighted means of rows (N, block) of one code."""
    total = np.bincount(code, weights)
    return np.stack([np.bincount(code, weights * column) / total for column in e.T], axis=1)


def _structure_test(
    baseline: ProjectedBaseline, data: Measurements, groups: Codes, points: Array, block: int
) -> tuple[float, str]:  # fmt: skip
    """Whether residuals of neighbours are alike: the largest ``eᵀ K e`` of many kernels K against flipped signs."""
    from scipy.sparse import csr_array

    N = len(data)
    rows = np.sort(np.random.default_rng(0).choice(N, min(N, 1200), replace=False))  # chosen for time
    series = baseline.flipped[: N * block].reshape(N, block, -1)[rows]
    # Repeats of one posture, and several targets there, are alike: that is repeatability and no structure.
    alike = [codes[:, None] == codes[None, :] for codes in (groups[rows], data.pose[rows])]
    pairs = np.nonzero(alike[0] | alike[1])
    flat = series.reshape(len(rows), -1)
    names, values = [], []
    for name, kernel in _smooth_kernels(data, points, rows):
        whole = np.sum(kernel.smoothed(flat), axis=0)
        own = np.einsum("nf,nf->f", flat, csr_array((kernel.at(*pairs), pairs), shape=(len(rows),) * 2) @ flat)
        values.append((whole - own).reshape(block, -1).sum(axis=0))
        names.append(name)
    table = np.stack(values)
    centre, spread = table[:, 1:].mean(axis=1), table[:, 1:].std(axis=1)
    z = (table - centre[:, None]) / np.maximum(spread, 1e-300)[:, None]
    most = z[:, 1:].max(axis=0)
    best = int(np.argmax(z[:, 0]))
    return p_value_of_maximum(most, float(z[best, 0])), names[best]


@dataclass(frozen=True, eq=False)
class SmoothKernel:
    """``K_ij = s_i s_j exp(−½ |x_i − x_j|²)`` of R rows.

    Args:
        x: (R, d) in units of the kernel's width.
        sign: (R,) of s.
    """

    x: Array
    sign: Array

    def at(self, i: Codes, j: Codes) -> Array:
        """(p,) its entries at rows i (p,) and columns j (p,)."""
        return np.asarray(self.sign[i] * self.sign[j] * np.exp(-0.5 * np.sum((self.x[i] - self.x[j]) ** 2, axis=-1)))

    def smoothed(self, series: Array) -> Array:
        """Rows whose sums of columns are the quadratic forms ``eᵀ K e`` of series (R, f)."""
        factor = self._factor()
        if factor is not None:
            return np.asarray((factor.T @ series) ** 2)
        rows = np.arange(len(self.x))
        return np.asarray(series * (self.at(rows[:, None], rows) @ series))

    def _factor(self) -> Array | None:
        """(R, r) of ``K = C Cᵀ`` by a pivoted Cholesky factorisation; None where r is no small part of R."""
        most = len(self.x) // 8 if self.x.shape[1] == 1 else 0
        C, left = np.zeros((len(self.x), most)), self.sign**2
        rows = np.arange(len(self.x))
        for k in range(most):
            pivot = int(np.argmax(left))
            if left[pivot] < 1e-12:
                return C[:, :k]
            C[:, k] = (self.at(rows, np.array([pivot])) - C[:, :k] @ C[pivot, :k]) / np.sqrt(left[pivot])
            left -= C[:, k] ** 2
        return None


def _smooth_kernels(data: Measurements, points: Array, rows: Codes) -> Iterator[tuple[str, SmoothKernel]]:
    q, even = data.q[rows], np.ones(len(rows))
    for j, name in enumerate(data.joint_names):
        span = float(np.ptp(q[:, j]))
        if span < 1e-6:
            continue
        for scale in (0.5, 0.15):  # of the joint's range: a bow and a bump
            yield name, SmoothKernel(q[:, j : j + 1] / (scale * span), even)
        side = np.sign(data.approach[rows, j]).astype(float)
        if len(np.unique(side)) > 1:
            yield side_place(name), SmoothKernel(q[:, j : j + 1] / (0.5 * span), side)
    size = float(np.linalg.norm(np.ptp(points[rows], axis=0)))
    for scale in (0.5, 0.2):  # of the workspace's size
        yield "tool point", SmoothKernel(points[rows] / max(scale * size, 1e-9), even)
    for name in ("time", "payload", "temperature"):
        values = getattr(data, name)
        values = np.arange(len(data), dtype=float) if values is None and name == "time" else values
        if values is not None and np.ptp(values[rows]) > 0:
            span = 0.15 * np.ptp(values[rows])
            yield name, SmoothKernel(values[rows][:, None] / span, even)
