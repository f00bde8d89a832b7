"""How a calibration is made: what is unknown is fitted, then judged where nothing was seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from posture_opt.calibration.assumptions.frame_coordinates import Chart
from posture_opt.calibration.assumptions.frames import arm_and_data, fit_frames, held_length
from posture_opt.calibration.assumptions.instrument import further_ratio
from posture_opt.calibration.assumptions.refuted_statements import consistent_problem
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.cross_validation import HeldOut, position_errors, refitted_errors
from posture_opt.calibration.data_checks import (
    Disagreement,
    check_amount,
    check_geometry,
    check_kept,
    check_places,
    check_sense,
    check_size,
    still_notes,
)
from posture_opt.calibration.doubts import doubts_about, without_copies
from posture_opt.calibration.estimation.error_statistics import By, Statistics, folds_of, groups_of
from posture_opt.calibration.estimation.fit import Fit, estimate_parameters, with_clustered_errors
from posture_opt.calibration.estimation.fit_request import FitRequest
from posture_opt.calibration.estimation.fit_setup import (
    FitSetup,
    determine_directions,
    unseen_errors_of_fit,
)
from posture_opt.calibration.estimation.orientation_scatter import orientation_ratio
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.calibration.estimation.tolerances import widths_of_data
from posture_opt.calibration.geometry_notes import place_notes, size_notes, tolerance_notes
from posture_opt.calibration.large_file import LargeFile
from posture_opt.calibration.second_file import OtherFile, predict_other_file
from posture_opt.errors import InsufficientDataError
from posture_opt.interrupts import interruptible
from posture_opt.limits import MOST_FITTED
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.row_inputs import moves
from posture_opt.measurements.thinning import thin
from posture_opt.numerics import Array, Codes, Mask, Progress
from posture_opt.selection.problem_data import ProblemData

MAX_FITTED_ROWS = 100_000
"""Rows that are fitted by default, in some minutes: standard errors are below a hundredth of any scatter by then."""
_NOISE_ROUNDS = 3  # of fitting and judging the noise anew
_TOLERANCE_ROUNDS = 6
"""Of fitting, and judging anew how far parts are from nominal."""
_QUIETER = 0.5  # of the noise of a calibration: with the effects, that much is left of it at the most to judge again
_TOLERANCE_CHANGE = 0.05
"""Of a tolerance: less is far below what a handful of parameters say of it."""
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
        priors: whether stated σ's of parameters count as knowledge.
        test: other measurements, predicted with nothing refitted, or with base and tool if ``refit_frames``.
        plan: whether report and document plan the task again with the arm that was found; ``seed`` of that search.
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
    report_step = _step_reporter(progress, 2 * rounds + 1 + (thinning is not None))
    found, chart, fitted = _calibration_of(request, by, priors, report_step)
    found = replace(found, contradictions=refuted.contradictions(found.fit), doubts=doubts)
    if thinning is None:
        return found
    large = LargeFile.of(thinning, _models(chart, fitted), fitted.found)
    report_step()
    return replace(found, large=large)


def reweighed(calibration: Calibration, model: Fit) -> Calibration | None:
    """The same calibration, weighed as an arm with effects asks for; None where that changes nothing.

    What the effects explain made orientations seem to scatter otherwise beside positions, or hid geometry that then was
    held near nominal.

    Args:
        model: geometry and effects, fitted together to the rows that count.
    """
    ratio, noise = orientation_ratio(model), float(np.sqrt(model.design * model.variance))
    quieter = calibration.assumed.any() and noise < _QUIETER * float(
        np.sqrt(calibration.fit.design * calibration.fit.variance)
    )
    if ratio == 1.0 and not quieter:
        return None
    used = 1.0 if ratio == 1.0 else further_ratio(calibration.request.problem, calibration.residuals.further)
    seen = _Scatter(used * ratio if ratio != 1.0 else None, max(noise, 1.0) if quieter else np.inf)
    found, *_ = _calibration_of(calibration.request, calibration.by, True, lambda: None, seen)
    return replace(found, contradictions=calibration.contradictions, large=calibration.large)


def restated(calibration: Calibration, model: Fit) -> Calibration | None:
    """The same calibration without the statements that the data refute beside effects; None where they refute none.

    Beside a large effect that is not in the model yet, wrong frames and σ's explain little, and keep their place.

    Args:
        model: geometry and effects, fitted together to the rows that count.
    """
    request, effects = calibration.request, model.effects
    if not effects:
        return None
    problem, refuted = consistent_problem(
        request.problem, request.data.take(calibration.kept_rows), priors=True, effects=effects
    )
    if not refuted.names:
        return None
    found = of_problem(calibration, problem)
    beside = found.fit_effects(found.residuals.take(found.kept_rows), effects)
    return replace(found, contradictions=(*calibration.contradictions, *refuted.contradictions(beside)))


def of_problem(calibration: Calibration, problem: ProblemData) -> Calibration:
    """The same calibration of a problem that states something else of the same arm."""
    found, *_ = _calibration_of(replace(calibration.request, problem=problem), calibration.by, True, lambda: None)
    return replace(found, contradictions=calibration.contradictions, large=calibration.large)


@dataclass(frozen=True)
class _Scatter:
    """What another fit of the same rows has shown of how they scatter.

    Args:
        turning: σ of orientations over the stated one; None where the fit is to show it.
        noise: the most that the noise is, in units of the instrument's.
    """

    turning: float | None = None
    noise: float = np.inf


_UNSEEN = _Scatter()


def _calibration_of(
    request: FitRequest, by: By, priors: bool, report_step: Callable[[], None], seen: _Scatter = _UNSEEN
) -> tuple[Calibration, Chart, _Fitted]:  # fmt: skip
    """The calibration, and the arm as it was fitted."""
    problem, data, test, refit_frames = request.problem, request.data, request.test, request.refit_frames
    groups = groups_of(data, by, request.folds)
    parts = folds_of(groups, request.folds, by)
    given, chart, fitted, notes = _weighed_arm(problem, data, len(np.unique(groups)), priors, seen)
    check_kept(chart.fitted, groups, fitted.found.kept)
    report_step()
    nominal = refitted_errors(chart.fitted, parts, fitted.found, report_step, frames=True)
    calibrated = refitted_errors(chart.fitted, parts, fitted.found, report_step)
    again = ("base and tool are fitted again to the test file",) * (test is not None and refit_frames)
    unconverged = _unconverged_note(calibrated.unsettled, len(parts))
    notes = (*notes, *fitted.notes, *again, *still_notes(problem.robot, data), *fitted.found_notes, *unconverged)
    kept = data.take(fitted.found.kept)
    other = None if test is None else predict_other_file(_models(chart, fitted), kept, test, refit_frames)
    found = _assemble_calibration(request, given, chart, fitted, (nominal, calibrated), groups, by, other, notes)
    left = Disagreement.of(given, found.errors_fitted[found.kept_rows])
    return replace(found, disagreement=left), chart, fitted


def _models(chart: Chart, fitted: _Fitted) -> dict[str, tuple[Residuals, Array]]:
    """The arm before and after calibration: residuals and deviations (k,)."""
    return {"nominal": (chart.fitted, fitted.x_nominal), "calibrated": (chart.fitted, fitted.found.x)}


def _weighed_arm(
    problem: ProblemData, data: Measurements, groups: int, priors: bool, seen: _Scatter
) -> tuple[Residuals, Chart, _Fitted, tuple[str, ...]]:
    """The arm fitted to all rows, orientations weighed as they scatter beside positions, see `orientation_ratio`.

    Args:
        groups: how many groups of correlated rows there are.

    Returns:
        The residuals in the parameters of the file, the chart they were fitted in, the fit, and sentences.
    """
    turning = seen.turning
    given, notes = arm_and_data(problem, data)
    given = replace(given, further={key: sigma * (turning or 1.0) for key, sigma in given.further.items()})
    chart = Chart.of(given)
    fitted = _fit_arm(problem, chart.fitted, groups, priors, noise=seen.noise)
    ratio = orientation_ratio(fitted.found) if turning is None else 1.0
    if ratio != 1.0:
        return _weighed_arm(problem, data, groups, priors, replace(seen, turning=ratio))
    notes += () if turning is None else (WEIGHED_NOTE.format(turning),)
    return given, chart, fitted, notes


def stated_errors(
    problem: ProblemData, data: Measurements, *, folds: int = 5, by: By | None = None
) -> tuple[Array, Mask]:
    """What `calibrate` finds of the arm as its file states it: position errors (N, 3) [m], and the rows that count.

    Nothing is fitted but what the file leaves free, and the offsets of several targets and touched points, which no
    file states; they are predicted without the group of each row. Outliers of the calibrated arm do not count.

    Args:
        folds, by: of the cross-validation, as in `calibrate`.

    Raises:
        InsufficientDataError: all rows are of one group, so that none can be predicted without it.
    """
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
    """What a cross-validation leaves out together where none is stated.

    Positions are left out pose by pose, those along a moving path stretch by stretch; touched points place by place, as
    all touches of a place share its position; of one place alone, pose by pose.
    """
    if data.touches and len(data.point_names) == 1:
        return "pose"
    return "stretch" if moves(data) and not data.touches else data.kind.held_out_by


@dataclass(frozen=True, eq=False)
class _Fitted:
    """An arm fitted to all rows.

    Args:
        x_nominal: (k,) deviations [rad, m] with only the free frames fitted.
        known: what the data and the prior determine; found: the estimate.
        held: the length that is held as the size of the arm; None where the data determine it.
    """

    x_nominal: Array
    known: FitSetup
    found: Fit
    held: int | None
    notes: tuple[str, ...]

    @property
    def found_notes(self) -> tuple[str, ...]:
        """Sentences on what was assumed, then on what did not converge."""
        return *self.known.notes, *self.found.notes


def _fit_arm(
    problem: ProblemData, residuals: Residuals, groups: int, priors: bool, *, enough: bool = False,
    noise: float = np.inf,
) -> _Fitted:  # fmt: skip
    """The free frames, then everything that the data determine; ``groups`` counts groups of correlated rows.

    ``enough`` says that the data are known to suffice, and to be of this arm; ``noise`` is as of `_Scatter`.

    Raises:
        InputError: the data are not of this arm.
        InsufficientDataError: too few rows, or no length to hold.
    """
    x_nominal = fit_frames(residuals)
    held = held_length(residuals, priors)
    check_size(residuals, held_length(residuals, priors=False))
    known = determine_directions(problem, residuals, x_nominal, held, priors)
    if not enough:
        check_amount(residuals, known, groups)
    known, found = _settled_estimate(problem, residuals, x_nominal, known, held, priors)
    if np.isfinite(noise):
        known = determine_directions(problem, residuals, x_nominal, held, priors, found, known.widths, noise)
    if not enough:
        check_places(residuals, found.x)
        check_sense(residuals, found.x, position_errors(residuals, found.x)[found.kept], held)
        check_geometry(residuals, known, x_nominal)
    notes = (*size_notes(residuals, held), *tolerance_notes(residuals, known), *place_notes(residuals, known, found))
    return _Fitted(x_nominal, known, found, held, notes)


def _settled_estimate(
    problem: ProblemData, residuals: Residuals, x: Array, known: FitSetup, held: int | None, priors: bool
) -> tuple[FitSetup, Fit]:
    """The estimate, and what is determined with the noise that it leaves.

    An arm far off its drawing bends away from its tangents, which looks like noise until it is fitted: then the same
    directions are judged again.

    The loop ends when the noise falls by less than half, after `_NOISE_ROUNDS` rounds at the most.
    """
    for _ in range(_NOISE_ROUNDS):
        found = estimate_parameters(residuals, x, known.directions, known.prior, weight=1.0, design=known.design)
        again = determine_directions(problem, residuals, x, held, priors, found)
        if again.noise > known.noise / 2:
            break
        known = again
    for _ in range(_TOLERANCE_ROUNDS * bool(np.isfinite(known.assumed).any())):
        widths = widths_of_data(found, known.widths)
        change = np.nanmax(np.abs(widths.typical / known.widths.typical - 1))
        known = determine_directions(problem, residuals, x, held, priors, found, widths)
        found = estimate_parameters(residuals, x, known.directions, known.prior, weight=1.0, design=known.design)
        if change < _TOLERANCE_CHANGE:
            break
    return known, found


def _assemble_calibration(
    request: FitRequest,
    given: Residuals,
    chart: Chart,
    fitted: _Fitted,
    predicted: tuple[HeldOut, HeldOut],
    groups: Codes,
    by: By,
    test: OtherFile | None,
    notes: tuple[str, ...],
) -> Calibration:
    """The calibration in the parameters of the file; ``predicted`` are the nominal and the calibrated arm's errors."""
    residuals, known, kept = chart.fitted, fitted.known, fitted.found.kept
    found = with_clustered_errors(fitted.found) if known.design > 1 else fitted.found
    nominal, calibrated = predicted
    return Calibration(
        request=request,
        fit=replace(
            found,
            residuals=given,
            x=chart.given_deviations(found.x),
            directions=chart.given_steps(found.x, found.directions),
        ),
        x_nominal=chart.given_deviations(fitted.x_nominal),
        fixed=chart.given_determined(found.x, known.fixed, found.covariance),
        identifiability=known.identifiability,
        nominal=Statistics.of(nominal.errors[kept], groups[kept]),
        calibrated=Statistics.of(calibrated.errors[kept], groups[kept]),
        held={"nominal": nominal, "calibrated": calibrated},
        errors_fitted=position_errors(residuals, found.x),
        by=by,
        test=test,
        prior=known.stated,
        assumed=np.isfinite(known.assumed),
        unseen=chart.given_sizes(found.x, unseen_errors_of_fit(residuals, known, found, fitted.held)),
        notes=notes,
    )


def recount_rows(calibration: Calibration, kept: Mask) -> Calibration:
    """The same estimate with other rows (N,) that count: the errors of both models are predicted anew, fold by fold.

    The estimate itself stays the one that did without them.
    """
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


def _step_reporter(progress: Progress | None, total: int) -> Callable[[], None]:
    """A callable that reports one more of ``total`` fits at each call; nothing without a ``progress``."""
    done = count(1)
    return lambda: progress(next(done), total) if progress is not None else None


def _unconverged_note(fits: int, rounds: int) -> tuple[str, ...]:
    """A sentence where fits of the cross-validation did not converge, ``rounds`` of them in all."""
    return (f"{fits} of the {rounds} fits of the cross-validation did not converge",) if fits else ()
