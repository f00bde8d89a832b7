"""How a calibration is made: what is unknown is fitted, then judged where nothing was seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from posture_opt.calibration.assumptions.frames import Chart, arm_and_data, fit_frames, held_length
from posture_opt.calibration.assumptions.instrument import further_ratio
from posture_opt.calibration.assumptions.refuted_statements import consistent_problem
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.cross_validation import position_errors, refitted_errors
from posture_opt.calibration.data_checks import (
    Disagreement,
    check_amount,
    check_geometry,
    check_kept,
    check_places,
    check_sense,
    check_size,
    place_notes,
    size_notes,
    still_notes,
    tolerance_notes,
)
from posture_opt.calibration.doubts import doubts_about, without_copies
from posture_opt.calibration.estimation.error_statistics import By, Statistics, folds_of, groups_of
from posture_opt.calibration.estimation.fit import Fit, estimate_parameters, with_clustered_errors
from posture_opt.calibration.estimation.fit_request import FitRequest
from posture_opt.calibration.estimation.fit_setup import (
    FitSetup,
    determine_directions,
    unseen_errors_of_fit,
    widths_of_data,
)
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.calibration.instruments import orientation_ratio
from posture_opt.calibration.second_file import LargeFile, Model, predict_other_file
from posture_opt.errors import InsufficientDataError
from posture_opt.interrupts import interruptible
from posture_opt.limits import MOST_FITTED
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import on_a_path, thin
from posture_opt.numerics import Array, Mask, Progress
from posture_opt.selection.problem_data import ProblemData

MAX_FITTED_ROWS = 100_000
"""Rows that are fitted by default, in some minutes: standard errors are below a hundredth of any scatter by then."""
WEIGHED_NOTE = (
    "orientations are weighted with {:.2g} times their stated σ, as much as they scatter beside the positions"
)
RECOUNTED_NOTE = (
    "{} that the calibration leaves out as {} here, as effects explain it: RMS errors are of all rows that count "
    "(without {}, {:.3g} mm calibrated)"
)


@interruptible()
def calibrate(
    problem: ProblemData,
    data: Measurements,
    *,
    priors: bool = True,
    folds: int = 5,
    by: By | None = None,
    test: Measurements | None = None,
    refit_frames: bool = False,
    plan: bool = True,
    seed: int | None = None,
    most_rows: int = MAX_FITTED_ROWS,
    progress: Progress | None = None,
) -> Calibration:
    """Estimate the parameters that the data determine, and the errors that remain on rows held out from the fit.

    In symbols: ``min Σ_i |W_i (f(q_i; x) − m_i)|² + |V (x − x̄)|²`` over the deviations x of geometry, frames and
    touched points, f the arm, m_i the measurements, W the instrument's σ, V the prior; by Levenberg-Marquardt, rows
    that are gross outliers left out. About ``2 · folds + 1`` fits.

    Free frames and touched points start from a closed form; then everything is fitted together. Frames that are
    neither free nor given a σ are taken as stated, unless the data refute that, see `consistent_problem`: then they are
    free, and a stated σ that the data refute does not count. What the data determine less well than to 10 mm and 1° is
    undetermined: it is
    held near its nominal value by these, unless ``priors`` is off: then it stays there. Errors are
    cross-validated: every row is predicted by an arm that has not seen its group (``by``: its pose, its block of the
    workspace, or the place that it touched).

    Args:
        problem: the arm, with its free frames and σ's, and the instrument.
        data: the measurements, of one robot.
        priors: whether stated σ's of parameters count as knowledge.
        folds: number of folds of the cross-validation, at least 2.
        by: what a fold holds out together, ``pose``, ``block``, ``place`` or ``stretch``; default: by the data.
        test: other measurements, predicted with nothing refitted, or with base and tool if ``refit_frames``.
        refit_frames: whether base and tool are fitted to ``test``.
        plan: whether report and document plan the task again with the arm that was found.
        seed: of that search; default: the problem's.
        most_rows: data with more are thinned to so many, see `thin`, and to 600 000 rows times joints; those left out
            judge the result, `LargeFile`.
        progress: receives (done, total) after each fit.

    Returns:
        ``Calibration``: ``parameters`` with their estimates ``x`` and standard errors ``std`` [m, rad] and their
        ``covariance``; ``report()`` and ``to_json()`` state the RMS error before and after [m], ``save(folder)``
        writes ``calibrated.yaml``.

    Raises:
        InputError: several robots at once, or a test file with other targets.
        InsufficientDataError: fewer measurements than unknowns.

    Example:
        >>> import posture_opt as po
        >>> problem = po.load_problem("insert_planar_2r_measured")
        >>> data = po.read_measurements("problems/planar_2r_measured.csv", problem)
        >>> calibration = po.calibrate(problem, data)
        >>> print(f"{1e3 * calibration.nominal.rms:.2f} mm before, {1e3 * calibration.calibrated.rms:.2f} mm after")
        1.30 mm before, 0.14 mm after
    """
    doubts, data = doubts_about(data), without_copies(data)
    thinning = thin(data, MOST_FITTED.rows(most_rows, problem.robot.n))
    data = data if thinning is None else thinning.used
    problem, refuted = consistent_problem(problem, data, priors)
    request = FitRequest(problem, data, folds, test, refit_frames, plan, seed)
    by = by or default_by(data)
    rounds = len(folds_of(groups_of(data, by, folds), folds, by))
    done, total = count(1), 2 * rounds + 1 + (thinning is not None)

    def report_step() -> None:
        if progress is not None:
            progress(next(done), total)

    found, models, fit = _calibration_of(request, by, priors, report_step)
    found = replace(found, contradictions=refuted.contradictions(found.fit), doubts=doubts)
    if thinning is None:
        return found
    large = LargeFile.of(thinning, models, fit)
    report_step()
    return replace(found, large=large)


def reweighed(calibration: Calibration, model: Fit) -> Calibration | None:
    """Weigh a calibration as an arm with effects asks for; None if nothing changes."""
    ratio, noise = orientation_ratio(model), float(np.sqrt(model.design * model.variance))
    # With the effects, half of the noise of a calibration is left at the most to judge again.
    quieter = calibration.assumed.any() and noise < 0.5 * float(
        np.sqrt(calibration.fit.design * calibration.fit.variance)
    )
    if ratio == 1.0 and not quieter:
        return None
    turning = None
    if ratio != 1.0:
        turning = ratio * further_ratio(calibration.request.problem, calibration.residuals.further)
    most = max(noise, 1.0) if quieter else np.inf
    found, *_ = _calibration_of(calibration.request, calibration.by, True, lambda: None, turning, most)
    return replace(found, contradictions=calibration.contradictions, large=calibration.large)


def restated(calibration: Calibration, model: Fit) -> Calibration | None:
    """Repeat a calibration without the statements refuted beside effects; None if none is."""
    request, effects = calibration.request, model.effects
    if not effects:
        return None
    data = request.data.take(calibration.kept_rows)
    problem, refuted = consistent_problem(request.problem, data, priors=True, effects=effects)
    if not refuted.names:
        return None
    found = of_problem(calibration, problem)
    beside = found.fit_effects(found.residuals.take(found.kept_rows), effects)
    return replace(found, contradictions=(*calibration.contradictions, *refuted.contradictions(beside)))


def of_problem(calibration: Calibration, problem: ProblemData) -> Calibration:
    """Repeat a calibration for another problem of its arm."""
    found, *_ = _calibration_of(replace(calibration.request, problem=problem), calibration.by, True, lambda: None)
    return replace(found, contradictions=calibration.contradictions, large=calibration.large)


def _calibration_of(
    request: FitRequest, by: By, priors: bool, report_step: Callable[[], None], turning: float | None = None,
    noise: float = np.inf,
) -> tuple[Calibration, dict[str, Model], Fit]:  # fmt: skip
    """The calibration in the parameters of the file, both models as they were fitted, and the fit.

    turning: σ of orientations over the stated one by another fit of the same rows; None where this fit is to show it.
    noise: the most that it is by such a fit, in units of the instrument's.
    """
    problem, data, test, refit_frames = request.problem, request.data, request.test, request.refit_frames
    groups = groups_of(data, by, request.folds)
    parts = folds_of(groups, request.folds, by)
    given, notes = arm_and_data(problem, data)
    given = replace(given, further={key: sigma * (turning or 1.0) for key, sigma in given.further.items()})
    chart = Chart.of(given)
    residuals, fitted = chart.fitted, _fit_arm(problem, chart.fitted, len(np.unique(groups)), priors, noise=noise)
    ratio = orientation_ratio(fitted.found) if turning is None else 1.0
    if ratio != 1.0:  # orientations are weighed as they scatter beside positions
        return _calibration_of(request, by, priors, report_step, ratio, noise)
    x, known, kept = fitted.found.x, fitted.known, fitted.found.kept
    check_kept(residuals, groups, kept)
    report_step()
    nominal = refitted_errors(residuals, parts, fitted.found, report_step, frames=True)
    calibrated = refitted_errors(residuals, parts, fitted.found, report_step)
    notes += () if turning is None else (WEIGHED_NOTE.format(turning),)
    again = ("base and tool are fitted again to the test file",) * (test is not None and refit_frames)
    still = still_notes(problem.robot, data)
    notes = (*notes, *fitted.notes, *again, *still, *known.notes, *fitted.found.notes)
    if calibrated.unsettled:
        notes += (f"{calibrated.unsettled} of the {len(parts)} fits of the cross-validation did not converge",)
    models = {"nominal": (residuals, fitted.x_nominal), "calibrated": (residuals, x)}
    found = with_clustered_errors(fitted.found) if known.design > 1 else fitted.found
    errors = position_errors(residuals, x)
    calibration = Calibration(
        request=request,
        fit=replace(
            found, residuals=given, x=chart.given_deviations(x), directions=chart.given_steps(x, found.directions)
        ),
        x_nominal=chart.given_deviations(fitted.x_nominal),
        fixed=chart.given_determined(x, known.fixed, found.covariance),
        identifiability=known.identifiability,
        nominal=Statistics.of(nominal.errors[kept], groups[kept]),
        calibrated=Statistics.of(calibrated.errors[kept], groups[kept]),
        held={"nominal": nominal, "calibrated": calibrated},
        errors_fitted=errors,
        by=by,
        test=None if test is None else predict_other_file(models, data.take(kept), test, refit_frames),
        prior=known.stated,
        assumed=np.isfinite(known.assumed),
        unseen=chart.given_sizes(x, unseen_errors_of_fit(residuals, known, found, fitted.held)),
        notes=notes,
        disagreement=Disagreement.of(given, errors[np.flatnonzero(kept)]),
    )
    return calibration, models, fitted.found


def stated_errors(
    problem: ProblemData, data: Measurements, *, folds: int = 5, by: By | None = None
) -> tuple[Array, Mask]:
    """What `calibrate` finds of the arm as its file states it: position errors (N, 3) [m], and the rows that count."""
    problem, _ = consistent_problem(problem, data, priors=True)
    residuals = Chart.of(arm_and_data(problem, data)[0]).fitted
    by = by or default_by(data)
    groups = groups_of(data, by, folds)
    if len(np.unique(groups)) < 2:
        raise InsufficientDataError("one pose cannot be predicted from the others: measure several")
    # A file that states what it learned has more unknowns than its data determine: few rows suffice all the same.
    found = _fit_arm(problem, residuals, len(np.unique(groups)), priors=True, enough=True).found
    return refitted_errors(residuals, folds_of(groups, folds, by), found, frames=True).errors, found.kept


def default_by(data: Measurements) -> By:
    """What a cross-validation leaves out together where none is stated."""
    if data.touches and len(data.point_names) == 1:
        return "pose"
    return "stretch" if on_a_path(data) and not data.touches else data.kind.held_out_by


@dataclass(frozen=True, eq=False)
class _Fitted:
    """An arm fitted to all rows."""

    x_nominal: Array  # (k,) deviations [rad, m] with only the free frames fitted
    known: FitSetup  # what the data and the prior determine; found: the estimate
    found: Fit
    held: int | None  # the length that is held as the size of the arm; None where the data determine it
    notes: tuple[str, ...]


def _fit_arm(
    problem: ProblemData, residuals: Residuals, groups: int, priors: bool, *, enough: bool = False,
    noise: float = np.inf,
) -> _Fitted:  # fmt: skip
    """The free frames, then everything that the data determine; ``groups`` counts groups of correlated rows.

    ``enough`` says that the data are known to suffice, and to be of this arm; ``noise`` as of `_calibration_of`.
    """
    x = fit_frames(residuals)
    held = held_length(residuals, priors)
    check_size(residuals, held_length(residuals, priors=False))
    known = determine_directions(problem, residuals, x, held, priors)
    if not enough:
        check_amount(residuals, known, groups)

    def estimated() -> Fit:
        return estimate_parameters(residuals, x, known.directions, known.prior, weight=1.0, design=known.design)

    # An arm far off its drawing bends away from its tangents, which looks like noise until it is fitted: then the same
    # directions are judged again, three times at the most.
    for _ in range(3):
        found = estimated()
        again = determine_directions(problem, residuals, x, held, priors, found)
        if again.noise > known.noise / 2:
            break
        known = again
    for _ in range(6 * bool(np.isfinite(known.assumed).any())):
        widths = widths_of_data(found, known.widths)
        change = np.nanmax(np.abs(widths.typical / known.widths.typical - 1))
        known = determine_directions(problem, residuals, x, held, priors, found, widths)
        found = estimated()
        if change < 0.05:  # less is far below what a handful of parameters say of a tolerance
            break
    if np.isfinite(noise):
        known = determine_directions(problem, residuals, x, held, priors, found, known.widths, noise)
    if not enough:
        check_places(residuals, found.x)
        check_sense(residuals, found.x, position_errors(residuals, found.x)[found.kept], held)
        check_geometry(residuals, known, x)
    notes = (*size_notes(residuals, held), *tolerance_notes(residuals, known), *place_notes(residuals, known, found))
    return _Fitted(x, known, found, held, notes)


def recount_rows(calibration: Calibration, kept: Mask) -> Calibration:
    """Let other rows (N,) count: predict the errors of both models anew by folds, estimates kept."""
    request, by, fit = calibration.request, calibration.by, replace(calibration.fit, kept=kept)
    groups = groups_of(request.data, by, request.folds)
    parts = folds_of(groups, request.folds, by)
    held = {name: refitted_errors(fit.residuals, parts, fit, frames=name == "nominal") for name in calibration.held}
    nominal, calibrated = (Statistics.of(held[n].errors[kept], groups[kept]) for n in ("nominal", "calibrated"))
    more = int(kept.sum()) - len(calibration.kept_rows)
    words = ("1 row", "an outlier counts", "it") if more == 1 else (f"{more} rows", "outliers count", "them")
    note = RECOUNTED_NOTE.format(*words, calibration.calibrated.rms * 1e3)
    notes = (*calibration.notes, note) if more else calibration.notes
    return replace(calibration, fit=fit, held=held, nominal=nominal, calibrated=calibrated, notes=notes)
