"""The arm that a diagnosis found, as its problem takes it over: calibrated, and with its effects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.error_statistics import Statistics
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.fit_request import nearest_semidefinite, persistent_sources, places_in_robot
from posture_opt.calibration.estimation.residuals import Residuals, gravity_of
from posture_opt.diagnosis.causes.causes import Finding
from posture_opt.diagnosis.causes.delivered_effects import Delivery, covariance_at_shapes
from posture_opt.diagnosis.causes.determined_sizes import places_of_parts, stated_parts
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array
from posture_opt.selection.fitted_arm import FittedArm
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.validation.calibrated_arm import NOMINAL_KEPT
from posture_opt.validation.calibrated_second_arm import second_arms
from posture_opt.validation.residual_scatter import residual_scatter


def extended_arm(
    problem: ProblemData, calibration: Calibration, model: Fit, delivery: Delivery,
    findings: Sequence[Finding], statistics: Mapping[str, Statistics],
) -> FittedArm:  # fmt: skip
    """The arm with its fitted geometry and effects, and what is uncertain of both together.

    Scatter is what the residuals of the delivered arm leave, split as in `residual_scatter`; gravity is that of the
    base where the fit found it.

    Noise of the instrument or of the data is left out; that of a joint is an effect of the arm.

    Args:
        model: everything that was fitted; ``delivery`` the arm to plan with.
        statistics: of every model on held-out rows.
    """
    delivered = delivery.fit
    held_out = calibration.errors[calibration.kept_rows] if delivery.nominal else delivery.held.errors
    fitted = _geometry_of(calibration, delivered, held_out)
    noises = [f.noise for f in findings if f.noise is not None and f.noise.of_arm]
    rows = delivered.whitened.reshape(-1, delivered.residuals.block)[:, : len(delivered.residuals.axes)]
    rows = delivered.residuals.metres(rows)
    if len(rows) == len(calibration.residuals.data):  # where no effect is delivered, outliers are among them
        rows = rows[calibration.kept_rows]
    scatter = residual_scatter(problem, fitted, noises, rows)
    places = places_in_robot(calibration.parameters)
    x = calibration.x_nominal if delivery.nominal else delivered.x[: len(calibration.x)]
    shift = delivered.x[: len(x)] - x
    covariance = fitted.covariance + np.outer(shift, shift)
    deviations = {name: float(x[i]) for name, i in places.items()}
    base = {name: value for name, value in deviations.items() if name.rpartition(".")[0] == "base"}
    gravity = gravity_of(problem.robot, base)
    header = _file_header(calibration, model, delivery, findings, statistics, scatter.note)
    return FittedArm(
        label="extended",
        deviations=deviations,
        known=_extended_sources(problem, fitted, covariance, delivery).plus(scatter.errors),
        scatter=scatter.without_effects,
        effects=tuple(effect for effect, _ in _written_effects(delivery)),
        noises=tuple(noises),
        gravity=None if gravity == problem.robot.gravity else gravity,
        header=header,
        second_arms=second_arms(calibration, x, covariance, "extended", header[:2]),
    )


def _written_effects(delivery: Delivery) -> Iterator[tuple[Effect, list[int]]]:
    """The effects of the file, each with the places of its parameters among those of the fit.

    Marked is what holds together with the rest of the file only; lines that are sure have an entry of their own then.
    """
    fit = delivery.fit
    for i, place in enumerate(delivery.kept):
        effect = _over_data(fit.effects[i], fit.residuals)
        every = tuple(range(len(effect.size_parts)))
        sure = every
        if place in delivery.together:
            sure = parts if (parts := stated_parts(fit, i)) != every else ()
        for parts, marked in ((sure, None), (tuple(k for k in every if k not in sure), True)):
            if parts:
                written = effect.of_parts(parts).model_copy(update={"size_undetermined": marked})
                yield written, places_of_parts(fit, i, parts)


def _over_data(effect: Effect, residuals: Residuals) -> Effect:
    """An effect with the values of its joint that it was found from."""
    if effect.target not in residuals.robot.joint_names:
        return effect
    q = residuals.data.q[:, residuals.robot.joint_names.index(effect.target)]
    return effect.measured_over(float(q.min()), float(q.max()))


def _geometry_of(calibration: Calibration, model: Fit, held_out: Array) -> Calibration:
    """The calibration with the geometry of the extended arm, and the held-out errors that it leaves.

    Args:
        held_out: (M, 3) errors of the rows that count [m].
    """
    before = calibration.held["calibrated"]
    errors = before.errors.copy()
    errors[calibration.kept_rows] = held_out
    # Sums over blocks hold what each row makes of the estimate, and no model of single rows may replace them.
    design = max(calibration.design, model.design)
    former = calibration.fit
    fit = replace(model.keeping([]), residuals=former.residuals, kept=former.kept, design=design)
    return replace(calibration, fit=fit, held={**calibration.held, "calibrated": replace(before, errors=errors)})


def _extended_sources(
    problem: ProblemData, calibration: Calibration, covariance: Array, delivery: Delivery
) -> Sources:  # fmt: skip
    """What is uncertain of geometry and effects, ``[[C_gg, C_ge], [C_eg, C_ee]]``.

    Shapes of effects are held (`covariance_at_shapes`), as a file states them without error.

    Args:
        covariance: C_gg (k, k) of all parameters of the calibration [rad², m²].
    """
    places = places_in_robot(calibration.parameters)
    own = list(places.values())
    written = list(_written_effects(delivery))
    names = tuple(name for effect, _ in written for name in effect.parameter_names)
    sizes = [place for _, own in written for place in own]
    geometry = persistent_sources(problem.robot, problem.sources, list(places), covariance[np.ix_(own, own)]).without(
        names
    )
    together = covariance_at_shapes(delivery.fit)
    k, e = len(geometry.names), len(names)
    cross = together[:, sizes]
    both = np.zeros((k + e, k + e))
    both[:k, :k] = geometry.covariance
    for row, name in enumerate(geometry.names):
        if name in places:
            both[row, k:] = both[k:, row] = cross[places[name]]
    both[k:, k:] = together[np.ix_(sizes, sizes)]
    return Sources((*geometry.names, *names), nearest_semidefinite(both)) if k + e else Sources()


def _file_header(
    calibration: Calibration, model: Fit, delivery: Delivery, findings: Sequence[Finding],
    statistics: Mapping[str, Statistics], scatter: str,
) -> tuple[str, ...]:  # fmt: skip
    """The first lines of the file: its data, its errors on held-out rows, and which effects are left out and why."""
    data, effects = calibration.residuals.data, model.effects
    before, middle, after = (f"{statistics[n].rms * 1e3:.3g} mm" for n in ("nominal", "calibrated", "delivered"))
    noises = [f.noise for f in findings if f.noise is not None]
    named = [*(effects[i] for i in delivery.kept), *(noise for noise in noises if noise.of_arm)]
    last = f", {after} with effects" if delivery.kept else ""
    nominal = [NOMINAL_KEPT] if delivery.nominal else []
    lines = [
        f"Extended by what {Path(data.file).name or 'a table'} ({len(data)} rows) says of the arm: "
        f"{', '.join(f'{cause.kind} of {cause.target}' for cause in named) or 'no effect'}.",
        f"RMS position error on held-out rows: {before} before calibration, {middle} calibrated{last}.",
        *nominal,
        "What is still uncertain of its parameters is in extended_covariance.csv, in mm, mrad and SI units.",
        f"{scatter[:1].upper()}{scatter[1:]}.",
    ]
    for places, why in (
        (delivery.session, "it belongs to its session; all else was fitted for it to be absent"),
        (delivery.vague, "the data do not determine its size; all else was fitted for it to be absent"),
        (delivery.dropped, "held-out rows are predicted no worse without it"),
    ):
        if places:
            lines.append(f"Left out, as {why}: {', '.join(effects[i].name for i in places)}.")
    if delivery.together:
        names = ", ".join(effect.name for effect, _ in _written_effects(delivery) if effect.size_undetermined)
        lines.append(f"Sure beside all else in this file only, and no size of a cause (size_undetermined): {names}.")
    read = [noise.name for noise in noises if not noise.of_arm]
    if read:
        lines.append(f"Left out, as it is of the measurement and not of the arm: {', '.join(read)}.")
    return tuple(lines)
