"""Rows that only looked like outliers: an effect that was not known yet explains them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from posture_opt.calibration.calibrate import recount_rows
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.calibration.estimation.least_squares import find_outliers
from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.search.search import SearchResult
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Mask

_MAX_OUTLIER_ROUNDS = 8
_MAX_EXPLANATIONS = 8  # explanations: what was chosen, and that with one of its rivals in place


def reinclude_outliers(calibration: Calibration, found: SearchResult) -> Calibration:
    """The calibration without those outliers that what was found, or a rival of it, explains.

    A few rows far from all others are left out by a calibration that knows nothing of an effect which is largest there;
    yet they say most about it. All rows are judged anew given geometry and effects, as the calibration judges them
    given its geometry, and by whichever explanation leaves the fewest.

    Args:
        calibration: with its outliers; found: what explains the other rows.

    Returns:
        The same estimate with more rows that count, or the calibration itself.
    """
    effects = [s for s in found.chosen if isinstance(s.what, Effect)]
    if not calibration.outliers or not effects:
        return calibration
    tangents = EffectSensitivities(calibration.residuals, calibration.x)
    r, J = tangents.residuals.residuals_and_jacobian(calibration.x)
    m = tangents.residuals.measured
    r, G = r[:m], J[:m] @ calibration.identifiability.directions
    before = ~calibration.fit.kept
    left = before
    for explanation in _effect_sets(found):
        Z = [tangents.columns(s.what)[:m] for s in explanation if isinstance(s.what, Effect)]
        gross = _gross_rows(r, np.concatenate([G, *Z], axis=1), tangents.residuals.block)
        left = min(left, before & gross, key=np.count_nonzero)
    return calibration if left is before else recount_rows(calibration, ~left)


def _effect_sets(found: SearchResult) -> Iterator[Sequence[Candidate]]:
    """The chosen set, then sets with one member replaced by a named rival, `_MAX_EXPLANATIONS` at the most."""
    yield found.chosen
    others = [(i, rival) for i, rivals in enumerate(found.rivals) for rival in rivals if rival.named]
    for i, rival in others[: _MAX_EXPLANATIONS - 1]:
        yield (*found.chosen[:i], rival, *found.chosen[i + 1 :])


def _gross_rows(r: Array, A: Array, block: int) -> Mask:
    """(N,) which rows stay gross errors given the columns A (m, k), with such rows left out of the fit.

    Rows are left out and judged again until the set repeats, `_MAX_OUTLIER_ROUNDS` times at the most.
    """
    scale = np.linalg.norm(A, axis=0)
    A = A / np.where(scale > 0, scale, 1.0)
    gone = np.zeros(len(r) // block, dtype=bool)
    for _ in range(_MAX_OUTLIER_ROUNDS):
        rows = np.repeat(~gone, block)
        rest = r - A @ np.linalg.lstsq(A[rows], r[rows], rcond=1e-10)[0]
        again = find_outliers(rest, A, block)[0]
        if np.array_equal(again, gone):
            break
        gone = again
    return gone
