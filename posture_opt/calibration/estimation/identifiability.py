"""Which parameters, and which combinations of them, measurements determine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.estimation.least_squares import triangular_factor
from posture_opt.numerics import Array, Mask

MAX_STANDARD_ERROR = 0.05  # rad or m: left so uncertain, a parameter leaves the range of its linearisation
LENGTH_TOLERANCE_M, ANGLE_TOLERANCE_RAD = (
    0.01,
    math.radians(1.0),
)  # m, rad: farther than that no part is from its nominal value
_FELT_STRENGTH = (
    1e-3  # of σ per tolerance: below, a direction moves nothing; a thousand tolerances are no knowledge either
)
_IDLE_STRENGTH = 1e-6  # of σ per tolerance: a parameter that moves nothing
_MAX_UNSEEN = 1e-3  # m or rad: more than that, left open by combinations that nothing shows, is not known
_STRENGTH_TOLERANCE = 1e-13  # of the largest strength
_JACOBIAN_TOLERANCE = 1e-9  # of the Jacobian: less is rounding
_NAMED_SHARE = 0.02  # of an undetermined combination: smaller parts need no words


@dataclass(frozen=True, eq=False)
class Identifiability:
    """The rank of a calibration, decided at one model from the Jacobian of the whitened residuals.

    Args:
        names: (k,) the candidates.
        scale: (k,) each unknown is measured in these units, its tolerance [rad or m].
        strength: (k,) how many σ of noise one tolerance moves the data along each direction, descending.
        vectors: (k, k) those directions, orthonormal in units of ``scale``.
        singular_values: (k,) of the Jacobian with columns of unit norm, descending.
        rank: how many directions the data determine to within a tolerance.
        alone: (k,) standard error of each parameter from the data alone [rad or m]; infinite where they do not
            determine it.
        condition: largest over smallest singular value of what is determined, columns of unit norm.
        observability: O1 … O5 of that.
        words: one sentence for each undetermined combination.
        unseen: (k,) what a tolerance of the combinations that the data do not feel makes of each parameter [rad or m].
    """

    names: tuple[str, ...]
    scale: Array
    strength: Array
    vectors: Array
    singular_values: Array
    rank: int
    alone: Array
    condition: float
    observability: dict[str, float]
    words: tuple[str, ...]
    unseen: Array

    @property
    def basis(self) -> Array:
        """(k, rank) orthonormal directions of the scaled unknowns that the data determine."""
        return self.vectors[:, : self.rank]

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
        return self.scale[:, None] * self.basis

    @property
    def hardly(self) -> Array:
        """(k, w) further steps that the data feel, but determine less well than the tolerances do."""
        felt = int(np.sum(self.strength > _FELT_STRENGTH))
        return self.scale[:, None] * self.vectors[:, self.rank : felt]


def identify_parameters(
    names: Sequence[str], J: Array, rows: int, held: int | None = None, *, scale: Array | None = None,
    noise: float = 1.0,
) -> Identifiability:  # fmt: skip
    """Rank, singular values, observability and undetermined combinations of a whitened Jacobian (m, k).

    With the unknowns in units of their tolerances, ``noise⁻¹ J diag(scale) = U S Vᵀ``: a direction counts as
    determined where one tolerance moves the data by more than one σ of noise, so that its standard error is less than
    the tolerance. What cannot be distinguished is shared out by the same units: to the free frame rather than to the
    link. ``rows`` counts the measurements; the parameter ``held`` counts as not determined whatever the Jacobian says.

    The indices, of the Jacobian with columns of unit norm (van der Sluis 1969) in the determined directions, with
    singular values σ_1 ≥ … ≥ σ_r: O1 = (Π σ)^(1/r) / √rows (Borm, Menq 1991), O2 = σ_r / σ_1 (Driels, Pathre 1990),
    O3 = σ_r (Nahvi, Hollerbach, Hayward 1994), O4 = σ_r² / σ_1 (Nahvi, Hollerbach 1996), O5 = 1 / Σ 1/σ² (Sun,
    Hollerbach 2008).

    Args:
        scale: (k,) tolerances [rad or m]; 50 mm and 0.05 rad where not given.
        noise: residuals' standard deviation in units of the instrument's.

    Example:
        >>> import numpy as np
        >>> J = np.array([[1e3, 1e3], [1e3, 1e3]])  # both parameters do the same
        >>> found = identify_parameters(["a", "b"], J, rows=2)
        >>> found.rank, found.words
        (1, ('a and b move what was measured the same way',))
    """
    k = len(names)
    scale = np.full(k, MAX_STANDARD_ERROR) if scale is None else scale
    R = triangular_factor(J) if k else np.zeros((0, 0))
    norms = np.linalg.norm(R, axis=0)
    idle = norms * scale <= _IDLE_STRENGTH * noise
    R = np.where(idle, 0.0, R)
    if held is not None:
        R[:, held] = 0.0
    _, s, Vt = np.linalg.svd(R * scale / noise)
    rank = int(np.sum(s > max(1.0, _STRENGTH_TOLERANCE * s.max(initial=0.0))))
    felt = s > _FELT_STRENGTH
    alone = scale * np.linalg.norm(Vt[felt].T / s[felt], axis=1)
    unseen = scale * np.linalg.norm(Vt[~felt].T, axis=1)
    alone = np.where(unseen > _MAX_UNSEEN, np.inf, np.hypot(alone, unseen))
    unit = np.where(norms > 0, norms, 1.0)
    values = np.asarray(np.linalg.svd(R / unit, compute_uv=False), dtype=float)
    determined = R / unit @ _orthonormal_columns((scale * unit)[:, None] * Vt[:rank].T)
    kept = np.asarray(np.linalg.svd(determined, compute_uv=False)[:rank], dtype=float)
    words = explain_undetermined(names, (scale * unit)[:, None] * Vt[rank:].T, idle, R / noise / unit)
    condition = float(kept[0] / kept[-1]) if rank else float("inf")
    indices = observability_indices(kept, rows)
    return Identifiability(tuple(names), scale, s, Vt.T, values, rank, alone, condition, indices, words, unseen)


def _orthonormal_columns(columns: Array) -> Array:
    """An orthonormal basis of columns (k, r) of full rank."""
    return np.asarray(np.linalg.qr(columns)[0]) if columns.shape[1] else columns


def observability_indices(s: Array, rows: int) -> dict[str, float]:
    """O1 … O5 of the singular values ``s`` (r,), descending; :func:`identify_parameters` says what they are.

    All are larger for better conditioned data; zeros without any direction.
    """
    if not len(s):
        return dict.fromkeys(("O1", "O2", "O3", "O4", "O5"), 0.0)
    values = {
        "O1": np.exp(np.log(s).mean()) / np.sqrt(rows),
        "O2": s[-1] / s[0],
        "O3": s[-1],
        "O4": s[-1] ** 2 / s[0],
        "O5": 1.0 / np.sum(1.0 / s**2),
    }
    return {name: float(value) for name, value in values.items()}


def explain_undetermined(names: Sequence[str], null: Array, idle: Mask, R: Array) -> tuple[str, ...]:
    """A sentence for each undetermined combination, written with as few parameters as can be.

    ``null`` (k, d) spans the combinations with columns of unit norm, ``R`` (k, k) says how the data feel them.

    Combinations that the data feel, but not enough, are called hardly distinguishable; others indistinguishable.
    """
    sentences = [f"{name} moves nothing that was measured" for name, still in zip(names, idle, strict=True) if still]
    left = [name for name, still in zip(names, idle, strict=True) if not still]
    lengths = np.linalg.norm(null, axis=0)
    for vector in sparse_basis((null / np.where(lengths > 0, lengths, 1.0))[~idle]).T:
        parts = np.flatnonzero(np.abs(vector) > _NAMED_SHARE * np.abs(vector).max(initial=0.0))
        labels = [left[int(i)] for i in parts]
        felt = np.linalg.norm(R[:, ~idle] @ vector) > _JACOBIAN_TOLERANCE * np.linalg.norm(R[:, ~idle])
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
    """The same null space (k, d) in reduced echelon form, on the d parameters that span it best.

    Pivots are chosen as in a QR decomposition with column pivoting, so that few parameters appear in each column.
    """
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
