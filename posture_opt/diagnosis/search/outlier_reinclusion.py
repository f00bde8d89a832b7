"""Outliers beside effects: rows that only looked like some, which an effect explains, and rows that effects hid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from posture_opt.calibration.calibrate import recount_rows
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities, case_of
from posture_opt.calibration.estimation.fit import Fit, agreeing_rows, position_parts
from posture_opt.calibration.estimation.least_squares import OUTLIER_MARGIN, find_outliers, outlier_limit
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate, linearise_calibration
from posture_opt.diagnosis.search.atoms import Dictionary
from posture_opt.diagnosis.search.matching_pursuit import pursue_candidates
from posture_opt.diagnosis.search.search import SearchResult, candidates_of
from posture_opt.model.effects import Effect
from posture_opt.model.effects.slip import Slip, well_covered
from posture_opt.numerics import Array, Mask

_CLEAR_MARGIN = 2 * OUTLIER_MARGIN  # of rows that effects hid: nearer ones are as what the effects lack


def reinclude_outliers(calibration: Calibration, found: SearchResult) -> Calibration:
    """The calibration without those outliers that what was found, a rival of it, or a slip beside it explains.

    A few rows far from all others are left out by a calibration that knows nothing of an effect which is largest there;
    yet they say most about it. No search among the other rows finds a slip behind which all are left out.
    """
    if not calibration.outliers:
        return calibration
    chosen = _effects(found.chosen)
    left = _left_out(calibration, [*_effect_sets(found), *([*chosen, slip] for slip in _slips_at_ends(calibration))])
    return recount_rows(calibration, ~left) if left.sum() < len(calibration.outliers) else calibration


def explains_outliers(calibration: Calibration, found: SearchResult) -> bool:
    """Whether what was found among all rows explains some that this calibration leaves out."""
    return bool(_left_out(calibration, [*_effect_sets(found)]).sum() < len(calibration.outliers))


def without_hidden_outliers(calibration: Calibration, model: Fit) -> Calibration | None:
    """The calibration without rows that are clear outliers beside the effects; None where there are none."""
    m = model.residuals.measured
    columns = (model.jacobian @ model.directions)[:m]
    gross = _gross_rows(model.whitened[:m], columns, model.residuals, _CLEAR_MARGIN)
    return _without_few(calibration, model.residuals, gross)


def without_clear_outliers(calibration: Calibration) -> Calibration:
    """The calibration without rows that are clear outliers beside what a pursuit of lasting effects takes.

    A rough description of the errors: a search made again once these rows show beside its result takes many times as
    long. Where no row is that far off by the instrument's σ, none is beside effects.
    """
    linearised = linearise_calibration(calibration, flips=0)
    residuals = linearised.sensitivities.residuals
    m, block = residuals.measured, residuals.block
    lengths = np.linalg.norm(linearised.r[:m].reshape(-1, block), axis=1)
    far = outlier_limit(len(lengths), block, _CLEAR_MARGIN) * linearised.instrument
    if np.isfinite(far) and lengths.max() < far:
        return calibration
    lasting = Dictionary(linearised, tuple(c for c in candidates_of(linearised) if c.persistent))
    taken = pursue_candidates(lasting, levels.MAX_EFFECTS).chosen
    gross = _gross_rows(linearised.r[:m], linearised.columns(taken)[0][:m], residuals, _CLEAR_MARGIN)
    return _without_few(calibration, residuals, gross) or calibration


def _without_few(calibration: Calibration, residuals: Residuals, gross: Mask) -> Calibration | None:
    """The calibration without gross rows (M,) of those that count; None without such, or with too many for that.

    More than three that follow each other, or than 1 % of all rows, are no gross errors but what the model lacks.
    """
    order = residuals.data.order
    marked = gross[order]
    for first, behind in np.flatnonzero(np.diff(np.r_[False, marked, False].astype(int))).reshape(-1, 2).tolist():
        marked[first:behind] = behind - first <= 3
    gross[order] = marked
    if not 0 < gross.sum() <= max(3, 0.01 * len(gross)):
        return None
    kept = calibration.fit.kept.copy()
    kept[calibration.kept_rows[gross]] = False
    return recount_rows(calibration, kept)


def _left_out(calibration: Calibration, explanations: Sequence[Sequence[Effect]]) -> Mask:
    """(N,) outliers that stay so given the one of the explanations that leaves the fewest; empty ones do not count."""
    tangents = EffectSensitivities(calibration.residuals, calibration.x)
    r, J = tangents.residuals.residuals_and_jacobian(calibration.x)
    m = tangents.residuals.measured
    r, G = r[:m], J[:m] @ calibration.identifiability.directions
    left = before = ~calibration.fit.kept
    for effects in filter(None, explanations):
        Z = [tangents.columns(effect)[:m] for effect in effects]
        gross = _gross_rows(r, np.concatenate([G, *Z], axis=1), tangents.residuals)
        left = min(left, before & gross, key=np.count_nonzero)
    return left


def _effects(chosen: Sequence[Candidate]) -> list[Effect]:
    return [s.what for s in chosen if isinstance(s.what, Effect)]


def _effect_sets(found: SearchResult) -> Iterator[list[Effect]]:
    yield _effects(found.chosen)
    others = [(i, rival) for i, rivals in enumerate(found.rivals) for rival in rivals if rival.named]
    for i, rival in others[:7]:
        yield _effects((*found.chosen[:i], rival, *found.chosen[i + 1 :]))


def _slips_at_ends(calibration: Calibration) -> list[Slip]:
    case, gone = case_of(calibration.request.data, calibration.residuals.robot), ~calibration.fit.kept
    slips = {(s.of, s.way): s for s in Slip.candidates(case) if isinstance(s, Slip)}
    times = np.asarray(case.times)
    order = np.argsort(times, kind="stable")
    excess = np.cumsum(np.where(gone[order], 1, -1))
    moments = (times[order][1:] + times[order][:-1]) / 2
    usable = well_covered(moments, times)
    likely = []
    for more in (excess[:-1], excess[-1] - excess[:-1]):  # of the rows before a moment, and of those behind it
        more = np.where(usable, more, 0)
        if more.max(initial=0) > 0:
            likely.append(float(moments[np.argmax(more)]))
    return [slip.model_copy(update={"moment": moment}) for slip in slips.values() for moment in likely]


def _gross_rows(r: Array, A: Array, residuals: Residuals, margin: float = OUTLIER_MARGIN) -> Mask:
    """(N,) which rows stay gross errors given the columns A (m, k), with such rows left out of the fit."""
    scale = np.linalg.norm(A, axis=0)
    A, block = A / np.where(scale > 0, scale, 1.0), residuals.block
    gone = np.zeros(len(r) // block, dtype=bool)
    for _ in range(8):
        rows = np.repeat(~gone, block)
        rest = r - A @ np.linalg.lstsq(A[rows], r[rows], rcond=1e-10)[0]
        again = find_outliers(rest, A, block, margin=margin)[0]
        again &= ~agreeing_rows(residuals.data, position_parts(rest, residuals), again)
        if np.array_equal(again, gone):
            break
        gone = again
    return gone
