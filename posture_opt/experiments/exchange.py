"""Optimal experiments by exchange: which candidates to measure, from the information that each one brings.

A candidate ``i`` measures ``A_i z`` (b numbers) of the unknowns z (r,) with unit variance each; chosen ones add up to
the information ``M = M_0 + Σ A_iᵀ A_i``, whose inverse is the covariance of the estimate. A criterion says how good
that covariance is. Nothing here knows of robots.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from posture_opt.numerics import Array, Codes, Mask, Progress
from posture_opt.workers import Serial, Workers


@dataclass(frozen=True)
class Determinant:
    """D-optimality: ``log det C``, the volume of the confidence ellipsoid; units of the unknowns do not matter.

    One candidate A (b, r) lowers it by ``log det(I + A C Aᵀ)`` (matrix determinant lemma), so that no inverse is
    updated.
    """

    logarithmic: ClassVar[bool] = True

    def value(self, C: Array) -> float:
        """``log det C``."""
        return float(np.linalg.slogdet(C)[1])

    def gains(self, C: Array, A: Array) -> Array:
        """``log det(I + A_i C A_iᵀ)`` (N,), as ``det(M + AᵀA) = det M · det(I + A C Aᵀ)``."""
        # det(M + AᵀA) = det M det(I + A C Aᵀ)
        return np.asarray(np.linalg.slogdet(_seen_covariance(A @ C, A))[1])

    def transformed(self, T: Array) -> Determinant:
        """Itself: a change of unknowns adds a constant to the logarithm."""
        return self


@dataclass(frozen=True, eq=False)
class Variance:
    """L-optimality: ``trace(L C Lᵀ)``, the summed variance of the quantities ``L z``, L (t, r); t = 1 is c-optimal.

    One candidate lowers it by ``tr(G_iᵀ (I + A_i C A_iᵀ)⁻¹ G_i)``, ``G_i = A_i C Lᵀ`` (Woodbury 1950).
    """

    L: Array
    logarithmic: ClassVar[bool] = False

    def value(self, C: Array) -> float:
        """``trace(L C Lᵀ)``."""
        return float(np.sum((self.L @ C) * self.L))

    def gains(self, C: Array, A: Array) -> Array:
        """Decrease (N,) of the trace by each candidate, from ``(M + AᵀA)⁻¹ = C − C Aᵀ (I + A C Aᵀ)⁻¹ A C``."""
        # (M + AᵀA)⁻¹ = C − C Aᵀ (I + A C Aᵀ)⁻¹ A C
        W = A @ C
        G = W @ self.L.T
        return np.asarray(np.sum(G * np.linalg.solve(_seen_covariance(W, A), G), axis=(1, 2)))

    def transformed(self, T: Array) -> Variance:
        """Quantities of the new unknowns: ``L z = (L T) z'``."""
        return Variance(self.L @ T)


Criterion = Determinant | Variance
"""What an experiment makes small, of the covariance C (r, r) of the unknowns."""


@dataclass(frozen=True, eq=False)
class Design:
    """The chosen candidates (count,) and the value of the criterion, in the unknowns of an average design."""

    chosen: Codes
    value: float


def exchange_design(
    A: Array,
    information: Array,
    criterion: Criterion,
    count: int,
    *,
    starts: int = 4,
    seed: int = 0,
    replicate: bool = False,
    places: Array | None = None,
    former: Codes | None = None,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> Design:
    """The best ``count`` of the candidates, by exchanging one at a time for the best of all others.

    Every place of the design is emptied in turn and given to the candidate that lowers the criterion most, until no
    place changes; the best of several starts counts, the first of them chosen one by one, the others at random (Fedorov
    1972; one place at a time: Cook, Nachtsheim 1980).

    A (N, b, r) what the candidates measure, in standard deviations of the measurement; information (r, r) ``M_0``, what
    is known already; zeros where nothing is; places (N, n) where the candidates lie: no two that are chosen lie nearer
    than 1 in every coordinate.
    """
    assert replicate or count <= len(A), "no more places than candidates"
    # In unknowns in which an average design has unit information, values of designs are comparable.
    flat = A.reshape(-1, A.shape[-1])
    T = unit_information(information + count / len(A) * flat.T @ flat)
    A, information = np.ascontiguousarray(A @ T), T.T @ information @ T
    criterion = criterion.transformed(T)
    # 1e-8 of the information of an average design: keeps a design that is still too small invertible
    search = _Search(A, information + 1e-8 * np.eye(len(T)), criterion, count, replicate, places)
    rng = np.random.default_rng(seed)
    drawn = [rng.choice(len(A), count, replace=replicate) for _ in range(0 if former is not None else starts - 1)]
    begins = [former, *drawn]
    found: dict[int, Design] = {}
    for k, (chosen, value) in (workers or Serial()).run(_Search.from_start, search, begins):
        found[k] = Design(np.array(chosen, dtype=np.intp), value)
        if progress is not None:
            progress(len(found), len(begins))
    return min((found[k] for k in range(len(begins))), key=lambda design: np.nan_to_num(design.value, nan=np.inf))


def unit_information(information: Array) -> Array:
    """``T`` (r, r) with ``Tᵀ M T = I`` for a positive definite M."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    return np.asarray(scale[:, None] * vectors / np.sqrt(np.maximum(values, 1e-300)))


@dataclass(frozen=True, eq=False)
class _Search:
    """The exchange over one set of candidates, in unknowns of unit information."""

    A: Array  # (N, b, r) candidates; start: (r, r) information that is there already, ridge included
    start: Array
    criterion: Criterion
    count: int
    replicate: bool
    places: Array | None  # (N, n) as of `exchange_design`, or None

    def information(self, chosen: Codes) -> Array:
        """``M_0 + Σ A_iᵀ A_i`` (r, r) of the chosen candidates."""
        flat = self.A[chosen].reshape(-1, self.A.shape[-1])
        return np.asarray(self.start + flat.T @ flat)

    def from_start(self, begin: Codes | None) -> tuple[list[int], float]:
        """The design that one start leads to, and its value."""
        chosen = self.improved(self.one_by_one() if begin is None else begin)
        return chosen.tolist(), float(self.criterion.value(inverse_matrix(self.information(chosen))))

    def one_by_one(self) -> Codes:
        """The design that grows by the candidate that helps most each time."""
        chosen: list[int] = []
        M, barred = self.start.copy(), np.zeros(len(self.A), dtype=bool)
        for _ in range(self.count):
            gains = self._gains(M, barred)
            chosen.append(int(np.argmax(gains)))
            barred |= self._barred_by(chosen[-1])
            M = M + self.A[chosen[-1]].T @ self.A[chosen[-1]]
        return np.array(chosen, dtype=np.intp)

    def improved(self, chosen: Codes) -> Codes:
        """The design after exchanges, until none gains anything."""
        chosen = chosen.copy()
        barred = np.array([self._barred_by(i) for i in chosen])
        # 50 through all places of a design; ten suffice
        for _ in range(50):
            changed = False
            M = self.information(chosen)  # afresh in every sweep: differences pile up rounding
            for place, former in enumerate(chosen):
                without = M - self.A[former].T @ self.A[former]
                gains = self._gains(without, np.asarray(np.delete(barred, place, axis=0).any(axis=0)))
                found, now = int(np.argmax(gains)), gains[former]
                # 1e-9 of the criterion: what an exchange must gain to be one
                if gains[found] > (now + 1e-9 * abs(now) if np.isfinite(now) else now):
                    chosen[place], barred[place], changed = found, self._barred_by(found), True
                    M = without + self.A[found].T @ self.A[found]
            if not changed:
                break
        return chosen

    def _gains(self, M: Array, barred: Mask) -> Array:
        """What each candidate (N,) would lower the criterion by after information M (r, r); −∞ where it is barred."""
        return np.where(barred, -np.inf, self.criterion.gains(inverse_matrix(M), self.A))

    def _barred_by(self, chosen: int) -> Mask:
        """(N,) which candidates may not be in a design together with this one."""
        near = np.zeros(len(self.A), dtype=bool)
        if self.places is not None:
            near = np.abs(self.places - self.places[chosen]).max(axis=1) < 1.0
        near[chosen] |= not self.replicate
        return np.asarray(near)


def inverse_matrix(M: Array) -> Array:
    """The inverse (r, r) of an information matrix: the covariance of the estimates."""
    return np.asarray(np.linalg.inv(M), dtype=float)


def _seen_covariance(W: Array, A: Array) -> Array:
    """``I + A C Aᵀ`` (N, b, b) from ``W = A C`` (N, b, r): the predicted covariance of each candidate's measurement."""
    S = W @ np.swapaxes(A, 1, 2)
    S[:, range(S.shape[1]), range(S.shape[1])] += 1.0
    return np.asarray(S)


def quantity_variances(M: Array, L: Array, T: Array) -> Array:
    """(t,) variances of the quantities ``L z`` under the information M (r, r); NaN where it does not determine one."""
    values, vectors = np.linalg.eigh(T.T @ M @ T)
    parts = L @ T @ vectors
    # 1e-10 of the information of an average design: what has less counts as unknown
    known = values > 1e-10
    found = np.sum(parts[:, known] ** 2 / values[known], axis=1)
    # 1e-6 of a quantity: so much of it may lie in what is unknown, by rounding
    leak = np.linalg.norm(parts[:, ~known], axis=1) > 1e-6 * np.linalg.norm(parts, axis=1)
    return np.where(leak, np.nan, found)
