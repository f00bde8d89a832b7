"""The arm that a diagnosis found, as its problem takes it over: calibrated, and with its effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.error_statistics import Statistics
from posture_opt.calibration.fit import Fit
from posture_opt.calibration.fitted_arm import FittedArm, persistent_sources, places_in_robot, semidefinite
from posture_opt.calibration.parameters import CalibrationProblem
from posture_opt.calibration.residuals import gravity_of
from posture_opt.diagnosis.causes import Finding
from posture_opt.diagnosis.sessions import covariance_at_shapes
from posture_opt.numerics import Array
from posture_opt.uncertainty.sources import Sources
from posture_opt.validation.residual_scatter import residual_scatter


def extended_arm(
    problem: CalibrationProblem, calibration: Calibration, model: Fit, persistent: Fit,
    findings: Sequence[Finding], errors: Array, statistics: Mapping[str, Statistics],
) -> FittedArm:  # fmt: skip
    """The arm with its fitted geometry and effects, and what is uncertain of both together.

    Effects that change with time are left out unless they were asked for: they belong to the session that was
    measured. So is noise of the instrument or of the data; that of a joint is an effect of the arm.

    Args:
        model: everything that was fitted; ``persistent`` the part of it to plan with.
        errors: (N, 3) of rows held out from the fit [m], outliers left out; ``statistics`` of every model.
    """
    fitted = _calibration(calibration, persistent, errors)
    noises = [f.noise for f in findings if f.noise is not None and f.noise.of_arm]
    scatter = residual_scatter(problem, fitted, noises)
    places = places_in_robot(calibration.parameters)
    deviations = {name: float(persistent.x[i]) for name, i in places.items()}
    base = {name: value for name, value in deviations.items() if name.startswith("base.")}
    gravity = gravity_of(problem.robot, base)
    return FittedArm(
        label="extended",
        deviations=deviations,
        known=_sources(problem, fitted, persistent),
        scatter=scatter.beside,
        effects=persistent.effects,
        noises=tuple(noises),
        gravity=None if gravity == problem.robot.gravity else gravity,
        header=_header(calibration, model, persistent, findings, statistics, scatter.note),
    )


def _calibration(calibration: Calibration, model: Fit, held_out: Array) -> Calibration:
    """The calibration with the geometry of the extended arm, and the errors that it leaves."""
    before = calibration.held["calibrated"]
    errors = before.errors.copy()
    errors[calibration.kept_rows] = held_out
    # Sums over blocks hold what each row makes of the estimate, and no model of single rows may stand in for them.
    design = max(calibration.design, model.design)
    former = calibration.fit
    fit = replace(model.keeping([]), residuals=former.residuals, kept=former.kept, design=design)
    return replace(calibration, fit=fit, held={**calibration.held, "calibrated": replace(before, errors=errors)})


def _sources(problem: CalibrationProblem, calibration: Calibration, model: Fit) -> Sources:
    """What is uncertain of geometry and effects, correlated as they were estimated."""
    places = places_in_robot(calibration.parameters)
    own = list(places.values())
    names = tuple(name for effect in model.effects for name in effect.parameter_names)
    geometry = persistent_sources(
        problem.robot, problem.sources, list(places), calibration.covariance[np.ix_(own, own)]
    ).without(names)
    together = covariance_at_shapes(model)
    k, e = len(geometry.names), len(names)
    cross = together[:, model.sizes]
    covariance = np.zeros((k + e, k + e))
    covariance[:k, :k] = geometry.covariance
    for row, name in enumerate(geometry.names):
        if name in places:
            covariance[row, k:] = covariance[k:, row] = cross[places[name]]
    covariance[k:, k:] = together[np.ix_(model.sizes, model.sizes)]
    return Sources((*geometry.names, *names), semidefinite(covariance)) if k + e else Sources()


def _header(
    calibration: Calibration, model: Fit, persistent: Fit, findings: Sequence[Finding],
    statistics: Mapping[str, Statistics], scatter: str,
) -> tuple[str, ...]:  # fmt: skip
    """What the file says of itself in its first lines."""
    data = calibration.residuals.data
    before, middle, after = (f"{statistics[n].rms * 1e3:.3g} mm" for n in ("nominal", "calibrated", "extended"))
    named = [f for f in findings if f.effect is not None or (f.noise is not None and f.noise.of_arm)]
    named_text = ", ".join(f"{f.kind} of {f.target}" for f in named) or "no effect"
    stays = {effect.name for effect in persistent.effects}
    left = [effect for effect in model.effects if effect.name not in stays]
    read = [f.noise.name for f in findings if f.noise is not None and not f.noise.of_arm]
    lines = [
        f"Extended by what {Path(data.file).name or 'a table'} ({len(data)} rows) says of the arm: {named_text}.",
        f"RMS position error on held-out rows: {before} before calibration, {middle} calibrated, {after} with effects.",
        "What is still uncertain of its parameters stands in extended_covariance.csv, in mm, mrad and SI units.",
        f"{scatter[:1].upper()}{scatter[1:]}.",
    ]
    if left:
        timed = "; the arm is as it was before" if any("time" in effect.needs for effect in left) else ""
        lines.append(f"Left out, as it belongs to its session: {', '.join(e.name for e in left)}{timed}.")
    if read:
        lines.append(f"Left out, as it is of the measurement and not of the arm: {', '.join(read)}.")
    return tuple(lines)
