"""Which parameters, and which combinations of them, measurements determine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.fit import triangular

Array = NDArray[np.float64]

THRESHOLD = 1e-5  # of the largest singular value of the scaled Jacobian: below, a direction counts as not determined
VAGUE = 0.05  # rad or m: left so uncertain by the instrument alone, a direction leaves the range of its linearisation
_IDLE = 1e-9  # of the largest column: a parameter that moves nothing
_PART = 0.02  # of an undetermined combination: smaller parts neither need words nor spoil a parameter


@dataclass(frozen=True, eq=False)
class Identifiability:
    """The rank of a calibration, decided at one model from the Jacobian of the whitened residuals.

    Args:
        names: (k,) the candidates.
        scale: (k,) each unknown is measured in these units [rad or m]: one σ of all residuals together.
        singular_values: (k,) of the column-scaled Jacobian, descending.
        basis: (k, rank) orthonormal directions of the scaled unknowns that the data determine.
        null: (k, k − rank) those that they do not.
        observability: O1 … O5.
        words: one sentence for each undetermined combination.
    """

    names: tuple[str, ...]
    scale: Array
    singular_values: Array
    basis: Array
    null: Array
    observability: dict[str, float]
    words: tuple[str, ...]

    @property
    def rank(self) -> int:
        return int(self.basis.shape[1])

    @property
    def condition(self) -> float:
        """Largest over smallest singular value of what is determined."""
        return float(self.singular_values[0] / self.singular_values[self.rank - 1]) if self.rank else float("inf")

    @property
    def determined(self) -> NDArray[np.bool_]:
        """(k,) whether the data determine each parameter by itself."""
        return np.asarray(np.linalg.norm(self.null, axis=1) < _PART)

    @property
    def directions(self) -> Array:
        """(k, rank) steps of the unknowns [rad or m] per unit of the determined coordinates."""
        return self.scale[:, None] * self.basis


def identify(names: Sequence[str], J: Array, rows: int, held: int | None = None) -> Identifiability:
    """Rank, singular values, observability and undetermined combinations of a whitened Jacobian (m, k).

    Columns are scaled to unit norm (no diagonal scaling has a much better condition: van der Sluis 1969), and
    directions below 1e-5 of the largest singular value are not determined, nor those that the instrument's noise alone
    leaves uncertain by more than 0.05 rad or 50 mm. ``rows`` counts the measurements;
    the parameter ``held`` counts as not determined whatever the Jacobian says.

    The indices, with the singular values σ_1 ≥ … ≥ σ_r of what is determined: O1 = (Π σ)^(1/r) / √rows (Borm,
    Menq 1991), O2 = σ_r / σ_1 (Driels, Pathre 1990), O3 = σ_r (Nahvi, Hollerbach, Hayward 1994), O4 = σ_r² / σ_1
    (Nahvi, Hollerbach 1996), O5 = 1 / Σ 1/σ² (Sun, Hollerbach 2008).
    """
    norms = np.linalg.norm(J, axis=0)
    idle = norms <= _IDLE * norms.max(initial=0.0)
    scale = np.where(idle, 1.0, 1.0 / np.where(idle, 1.0, norms))
    scaled = np.where(idle, 0.0, J * scale)
    if held is not None:
        scaled[:, held] = 0.0
    _, s, Vt = np.linalg.svd(triangular(scaled))
    s = np.concatenate([s, np.zeros(len(names) - len(s))])
    extent = np.abs(scale[:, None] * Vt.T).max(axis=0, initial=0.0)  # [rad or m] for one unit of each direction
    rank = int(np.sum((s > THRESHOLD * s[0]) & (s * VAGUE > extent))) if len(s) and s[0] > 0 else 0
    null = Vt[rank:].T
    words = explain(names, null, idle)
    return Identifiability(tuple(names), scale, s, Vt[:rank].T, null, _indices(s[:rank], rows), words)


def _indices(s: Array, rows: int) -> dict[str, float]:
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


def explain(names: Sequence[str], null: Array, idle: NDArray[np.bool_]) -> tuple[str, ...]:
    """A sentence for each undetermined combination, written with as few parameters as can be."""
    sentences = [f"{name} moves nothing that was measured" for name, still in zip(names, idle, strict=True) if still]
    left = [name for name, still in zip(names, idle, strict=True) if not still]
    for vector in sparse_basis(null[~idle]).T:
        parts = np.flatnonzero(np.abs(vector) > _PART * np.abs(vector).max(initial=0.0))
        labels = [left[int(i)] for i in parts]
        if len(labels) == 2:
            sentences.append(f"{labels[0]} and {labels[1]} move what was measured the same way")
        elif len(labels) > 2:
            shown = ", ".join(labels[1:6]) + (f" and {len(labels) - 6} more" if len(labels) > 6 else "")
            sentences.append(f"{labels[0]} cannot be told from a combination of {shown}")
    return tuple(sentences)


def sparse_basis(null: Array) -> Array:
    """The same null space (k, d) in reduced echelon form, on the d parameters that span it best."""
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
