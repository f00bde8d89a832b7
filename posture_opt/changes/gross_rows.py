"""Rows that no change explains and all others contradict, as a misread target, or a line that was mixed up."""

from __future__ import annotations

import numpy as np

from posture_opt.changes.gaussian_evidence import log_sum
from posture_opt.changes.hypotheses import PRIOR, Hypotheses
from posture_opt.changes.new_rows import NewRows
from posture_opt.numerics import Array, Codes

LEAST_ROWS = 4
"""So many rows are left at least."""
_MOST_SHARE = 0.2
"""Of the rows: where more contradict the others, it is the arm."""
_TRIED = 8  # rows, those of the largest errors, each time
_LEAST_ERROR = 4.0  # standard deviations of a reading: what fits as well is not gross
_SIZES = 20.0 * 4.0 ** np.arange(6)
"""Sizes of a gross error in standard deviations of a reading, all alike probable: at 0.05 mm from 1 mm to 1 m."""


def without_gross_rows(rows: NewRows) -> tuple[Hypotheses, Codes]:
    """What happened by the rows that do not contradict all others, and the places of these rows.

    A row is gross where ``p(r of the others) N(r of it | 0, s²)`` times the prior of a gross row exceeds the evidence
    of all rows, s on a grid; one at a time, the most contradicting first.
    """
    count = len(rows.residuals.data)
    models, kept = Hypotheses.of(rows), np.arange(count)
    for _ in range(min(int(_MOST_SHARE * count), count - LEAST_ROWS)):
        if models.probabilities.unchanged > models.probabilities.several:
            break
        others = [kept[kept != row] for row in _suspects(models, kept)]
        if not others:
            break
        found = [Hypotheses.of(rows.take(other)) for other in others]
        gains = [m.log_evidence + _log_gross(rows, kept, other) for m, other in zip(found, others, strict=True)]
        best = int(np.argmax(gains))
        if gains[best] <= models.log_evidence:
            break
        models, kept = found[best], others[best]
    return models, kept


def _suspects(models: Hypotheses, kept: Codes) -> Codes:
    """The rows with the largest errors beside the likeliest single change."""
    best = int(np.argmax(models.log_singles))
    own, estimate = models.own[best][0], models.estimates()[best]
    left = own.r + own.A[:, own.columns(models.changes[best])] @ estimate.mean
    size = np.linalg.norm(_by_row(own, left), axis=1)
    order = np.argsort(-size, kind="stable")[:_TRIED]
    return np.asarray(kept[order[size[order] > _LEAST_ERROR]])


def _log_gross(rows: NewRows, kept: Codes, others: Codes) -> float:
    """Log of prior times density of the one row that is not among the others, as a gross one."""
    (row,) = set(kept.tolist()) - set(others.tolist())
    r = _by_row(rows, rows.r)[row]
    logs = -0.5 * float(r @ r) / _SIZES**2 - len(r) * np.log(_SIZES * np.sqrt(2 * np.pi))
    return log_sum(logs) - float(np.log(len(_SIZES))) + float(np.log(PRIOR["gross"] / len(kept)))


def _by_row(rows: NewRows, values: Array) -> Array:
    """Whitened values (m,) of the rows alone, (N, b)."""
    count, block = rows.noise.shape[:2]
    return values[: count * block].reshape(count, block)
