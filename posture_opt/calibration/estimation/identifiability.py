"""Which parameters, and which combinations of them, measurements determine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.estimation.least_squares import triangular_factor
from posture_opt.numerics import Array, Mask

MAX_STANDARD_ERROR = 0.05  # rad or m: left so uncertain, a parameter leaves the range of its linearisation
LENGTH_TOLERANCE_M, ANGLE_TOLERANCE_RAD = 0.01, math.radians(1.0)
"""[m], [rad] no part is farther than that from its nominal value."""


@dataclass(frozen=True, eq=False)
class Identifiability:
    """The rank of a calibration, decided at one model from the Jacobian of the whitened residuals."""

    names: tuple[str, ...]  # (k,) the candidates
    scale: Array  # (k,) each unknown is measured in these units, its tolerance [rad or m]
    strength: Array  # (k,) how many σ of noise one tolerance moves the data along each direction, descending
    vectors: Array  # (k, k) those directions, orthonormal in units of ``scale``
    singular_values: Array  # (k,) of the Jacobian with columns of unit norm, descending
    rank: int  # how many directions the data determine to within a tolerance
    # (k,) standard error of each parameter from the data alone [rad or m]; infinite where they do not determine it
    alone: Array
    condition: float  # largest over smallest singular value of what is determined, columns of unit norm
    observability: dict[str, float]  # O1 … O5 of that
    words: tuple[str, ...]  # one sentence for each undetermined combination
    # (k,) what a tolerance of the combinations that the data do not feel makes of each parameter [rad or m]
    unseen: Array

    @property
    def null(self) -> Array:
        """(k, k − rank) orthonormal directions of the scaled unknowns that they do not."""
        return self.vectors[:, self.rank :]

    @property
    def determined(self) -> Mask:
        """(k,) whether the data alone leave each parameter less uncertain than its tolerance, and than 50 mm, rad."""
        return np.asarray(self.alone < np.minimum(self.scale, MAX_STANDARD_ERROR))

    @property
    def directions(self) -> Array:
        """(k, rank) steps of the unknowns [rad or m] per unit of the determined coordinates."""
        return self.scale[:, None] * self.vectors[:, : self.rank]

    @property
    def hardly(self) -> Array:
        """(k, w) further steps that the data feel, but determine less well than the tolerances do."""
        felt = int(np.sum(self.strength > 1e-3))
        return self.scale[:, None] * self.vectors[:, self.rank : felt]


def identify_parameters(
    names: Sequence[str], J: Array, rows: int, held: int | None = None, *, scale: Array | None = None,
    noise: float = 1.0,
) -> Identifiability:  # fmt: skip
    """Rank, singular values, observability and undetermined combinations of a whitened Jacobian (m, k).

    With the unknowns in units of their tolerances, ``noise⁻¹ J diag(scale) = U S Vᵀ``: a direction counts as determined
    where one tolerance moves the data by more than one σ of noise, so that its standard error is less than the
    tolerance. What cannot be distinguished is shared out by the same units: to the free frame rather than to the link.
    ``rows`` counts the measurements; the parameter ``held`` counts as not determined whatever the Jacobian says.

    The indices, of the Jacobian with columns of unit norm (van der Sluis 1969) in the determined directions, with
    singular values σ_1 ≥ … ≥ σ_r: O1 = (Π σ)^(1/r) / √rows (Borm, Menq 1991), O2 = σ_r / σ_1 (Driels, Pathre 1990), O3
    = σ_r (Nahvi, Hollerbach, Hayward 1994), O4 = σ_r² / σ_1 (Nahvi, Hollerbach 1996), O5 = 1 / Σ 1/σ² (Sun, Hollerbach
    2008).

    scale (k,) tolerances [rad or m]; 50 mm and 0.05 rad where not given.
    """
    k = len(names)
    scale = np.full(k, MAX_STANDARD_ERROR) if scale is None else scale
    R = triangular_factor(J) if k else np.zeros((0, 0))
    norms = np.linalg.norm(R, axis=0)
    # 1e-6 of σ per tolerance: a parameter that moves nothing
    idle = norms * scale <= 1e-6 * noise
    R = np.where(idle, 0.0, R)
    if held is not None:
        R[:, held] = 0.0
    _, s, Vt = np.linalg.svd(R * scale / noise)
    # 1e-13 of the largest strength
    rank = int(np.sum(s > max(1.0, 1e-13 * s.max(initial=0.0))))
    # 1e-3 of σ per tolerance: below, a direction moves nothing
    felt = s > 1e-3
    alone = scale * np.linalg.norm(Vt[felt].T / s[felt], axis=1)
    unseen = scale * np.linalg.norm(Vt[~felt].T, axis=1)
    # 1e-3 m or rad: more than that, left open by combinations that nothing shows, is not known
    alone = np.where(unseen > 1e-3, np.inf, np.hypot(alone, unseen))
    unit = np.where(norms > 0, norms, 1.0)
    values = np.asarray(np.linalg.svd(R / unit, compute_uv=False), dtype=float)
    columns = (scale * unit)[:, None] * Vt.T
    basis = np.linalg.qr(columns[:, :rank])[0] if rank else columns[:, :0]
    kept = np.asarray(np.linalg.svd(R / unit @ basis, compute_uv=False)[:rank], dtype=float)
    words = explain_undetermined(names, columns[:, rank:], idle, R / noise / unit)
    condition = float(kept[0] / kept[-1]) if rank else float("inf")
    indices = observability_indices(kept, rows)
    return Identifiability(tuple(names), scale, s, Vt.T, values, rank, alone, condition, indices, words, unseen)


def observability_indices(s: Array, rows: int) -> dict[str, float]:
    """O1 … O5 of the singular values ``s`` (r,), descending; :func:`identify_parameters` says what they are."""
    if not len(s):
        return dict.fromkeys(("O1", "O2", "O3", "O4", "O5"), 0.0)
    O1, O5 = np.exp(np.log(s).mean()) / np.sqrt(rows), 1.0 / np.sum(1.0 / s**2)
    values = {"O1": O1, "O2": s[-1] / s[0], "O3": s[-1], "O4": s[-1] ** 2 / s[0], "O5": O5}
    return {name: float(value) for name, value in values.items()}


def explain_undetermined(names: Sequence[str], null: Array, idle: Mask, R: Array) -> tuple[str, ...]:
    """A sentence for each undetermined combination, written with as few parameters as can be."""
    sentences = [f"{name} moves nothing that was measured" for name, still in zip(names, idle, strict=True) if still]
    left = [name for name, still in zip(names, idle, strict=True) if not still]
    lengths = np.linalg.norm(null, axis=0)
    for vector in sparse_basis((null / np.where(lengths > 0, lengths, 1.0))[~idle]).T:
        # 0.02 of an undetermined combination: smaller parts need no words
        parts = np.flatnonzero(np.abs(vector) > 0.02 * np.abs(vector).max(initial=0.0))
        labels = [left[int(i)] for i in parts]
        # 1e-9 of the Jacobian: less is rounding
        felt = np.linalg.norm(R[:, ~idle] @ vector) > 1e-9 * np.linalg.norm(R[:, ~idle])
        if len(labels) == 2:
            how = "nearly the same way" if felt else "the same way"
            sentences.append(f"{labels[0]} and {labels[1]} move what was measured {how}")
        elif len(labels) > 2:
            shown = ", ".join(labels[1:6]) + (f" and {len(labels) - 6} more" if len(labels) > 6 else "")
            how = "can hardly be distinguished" if felt else "cannot be distinguished"
            sentences.append(f"{labels[0]} {how} from a combination of {shown}")
        elif felt:
            sentences.append(f"{labels[0]} hardly moves what was measured")
    return tuple(sentences)


def sparse_basis(null: Array) -> Array:
    """Reduced echelon form of a null space (k, d), on the d parameters that span it best."""
    k = len(null)
    null = null[:, np.linalg.norm(null, axis=0) > 1e-6] if k else null
    U, s, _ = np.linalg.svd(null, full_matrices=False) if null.size else (np.zeros((k, 0)), np.zeros(0), None)
    rest = U[:, s > 1e-6]
    basis = rest.copy()
    pivots: list[int] = []
    for _ in range(rest.shape[1]):
        left = np.linalg.norm(basis, axis=1)
        left[pivots] = 0.0
        pivot = int(np.argmax(left))
        pivots.append(pivot)
        direction = basis[pivot] / np.linalg.norm(basis[pivot])
        basis = basis - np.outer(basis @ direction, direction)
    return np.asarray(rest @ np.linalg.inv(rest[pivots])) if pivots else rest
