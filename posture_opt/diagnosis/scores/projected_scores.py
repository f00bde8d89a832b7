"""What candidates of a few columns each explain, from their Gram matrices and scores alone; thousands at once."""

from __future__ import annotations

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.numerics import Array


def explained_squares(gram: Array, score: Array) -> tuple[Array, Array]:
    """(n,) what candidates explain along the eigenvectors that are new, and how many these are.

    Args:
        gram: (n, k, k) of columns of former length one, projected off what was chosen; score: (n, k).
    """
    least = levels.MIN_DISTINCT_SHARE
    if gram.shape[1] == 1:
        value = gram[:, 0, 0]
        return np.where(value > least, score[:, 0] ** 2 / np.maximum(value, least), 0.0), (value > least).astype(int)
    if gram.shape[1] == 2:
        return _explained_by_pairs(gram, score)
    values, vectors = np.linalg.eigh(gram)
    parts = np.einsum("ikl,ik->il", vectors, score) ** 2
    clear = values > least
    return np.sum(np.where(clear, parts / np.maximum(values, least), 0.0), axis=1), clear.sum(axis=1)


def _explained_by_pairs(gram: Array, score: Array) -> tuple[Array, Array]:
    """`explained_squares` of two columns each, of which there are thousands, without their eigenvectors.

    ``sᵀ G⁻¹ s`` where both eigenvalues λ ≥ μ of G are clear, and ``sᵀ (G − μ) s / (λ (λ − μ))`` where λ alone is.
    """
    a, b, c = gram[:, 0, 0], gram[:, 0, 1], gram[:, 1, 1]
    x, y = score[:, 0], score[:, 1]
    middle, half = (a + c) / 2, np.hypot((a - c) / 2, b)
    first, second = middle + half > levels.MIN_DISTINCT_SHARE, middle - half > levels.MIN_DISTINCT_SHARE
    low = np.where(second, 0.0, middle - half)
    # Both at once: the inverse has the entries of the matrix turned by a right angle.
    squares = np.where(second, (a * y - b * x) * y + (c * x - b * y) * x, (a - low) * x**2 + (c - low) * y**2)
    squares = np.where(second, squares, squares + 2 * b * x * y)
    lengths = np.where(second, a * c - b * b, (middle + half) * 2 * half)
    return np.where(first, squares / np.where(first, lengths, 1.0), 0.0), first.astype(int) + second


def row_products(rows: Array) -> Array:
    """(…, k, k) inner products of the rows of many small matrices (…, k, w); written out for the narrow ones."""
    k, width = rows.shape[-2:]
    if k > 2:
        return np.asarray(rows @ np.swapaxes(rows, -1, -2))
    found = np.empty((*rows.shape[:-1], k))
    for a in range(k):
        for b in range(a + 1):
            found[..., a, b] = sum(rows[..., a, c] * rows[..., b, c] for c in range(width))
            found[..., b, a] = found[..., a, b]
    return found


def projected_gains(gram: Array, inner: Array, score: Array) -> Array:
    """(n,) what candidates explain of residuals, given a basis of what was chosen.

    Args:
        gram: (n, k, k) inner products of the columns of each, of any lengths.
        inner: (n, k, p) those with the basis; score: (n, k) those with the residuals that it leaves.
    """
    scale = 1 / np.sqrt(np.maximum(np.einsum("ikk->ik", gram), 1e-300))
    rest = (gram - inner @ np.swapaxes(inner, 1, 2)) * scale[:, :, None] * scale[:, None, :]
    return explained_squares(rest, score * scale)[0]
