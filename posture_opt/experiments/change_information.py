"""What postures tell of possible changes of a calibrated arm, as the unknowns of a plan.

A change of a parameter and what is uncertain of it act alike: the unknown is their sum, known beforehand to the
covariance of the file and the size of a change together.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.experiments.expected_errors import PriorInformation
from posture_opt.experiments.information import OF_PLACES, GivenInformation, MeasurementModel, nothing_measured
from posture_opt.experiments.possible_changes import effects_of, possible_changes
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array
from posture_opt.selection.problem_data import ProblemData

CHANGE_M = 0.3e-3
"""Root mean square motion of the tool by a change that a plan is made to tell from others [m]."""
OPEN_M = 30e-3
"""The same of what is found anew, as the places of an instrument: next to nothing is known of it [m]."""
_MIN_MOTION_SHARE = 1e-6  # of the largest motion of any parameter: less shows nothing


def change_model(problem: ProblemData, measuring: MeasurementModel, pool: Array) -> MeasurementModel:
    """The same measurements with everything that may have changed, or is uncertain, as unknowns.

    Args:
        pool: (N, n) postures [rad or m]; a parameter that moves the tool in none of them is left out.
    """
    residuals, sources = measuring.residuals, problem.sources
    places = {p.name: p for p in residuals.parameters if p.group in OF_PLACES}
    changes = possible_changes(residuals.robot, residuals.data)
    zeros = np.zeros(len(residuals.parameters))
    wide = residuals.with_effects(effects_of(changes), zeros)
    factors, of_effects = residuals.robot.parameters, set(wide.arm.effect_parameters)
    found = {p.name: p for change in changes for p in change.parameters}
    for name in sources.names:
        if name in factors:
            unit = "rad" if factors[name].kind == "rotate" else "m"
            found.setdefault(name, Parameter(name, "geometry", unit, factors[name].nominal, name))
        elif name in of_effects:
            found.setdefault(name, Parameter(name, "effect", "1", 0.0, name))
    found |= places
    model = replace(measuring, residuals=replace(wide, parameters=tuple(found.values())))
    motion = _motion(model.blocks(pool, model.start))
    kept = tuple(p for p, m in zip(found.values(), motion, strict=True) if m > _MIN_MOTION_SHARE * motion.max())
    return replace(measuring, residuals=replace(wide, parameters=kept))


def change_prior(problem: ProblemData, model: MeasurementModel, J: Array) -> PriorInformation:
    """``C + s² diag(1/m²)``: what the file leaves uncertain, and a change that moves the tool by s, `CHANGE_M`.

    Places are found anew: s is `OPEN_M` there.

    Args:
        J: (N, b, k) whitened derivatives at the candidates; m is the root mean square motion by a unit.
    """
    names = tuple(p.name for p in model.parameters)
    motion = _motion(J) * model.residuals.sigma / np.sqrt(model.repeats)
    sources = problem.sources
    place = {name: i for i, name in enumerate(names)}
    rows = [i for i, name in enumerate(sources.names) if name in place]
    at = [place[sources.names[i]] for i in rows]
    size = np.where([p.group in OF_PLACES for p in model.parameters], OPEN_M, CHANGE_M)
    C = np.diag((size / motion) ** 2)
    C[np.ix_(at, at)] += sources.constant[np.ix_(rows, rows)]
    scale = np.sqrt(np.diag(C))
    W = np.linalg.inv(np.linalg.cholesky(C / np.outer(scale, scale))) / scale
    return PriorInformation(names, scale, np.ones(len(names), dtype=bool), W, W)


def change_information(model: MeasurementModel, data: Measurements | None, variance: float) -> GivenInformation:
    """What rows that were measured already tell of the same unknowns, at the arm of the file.

    Args:
        variance: of a measured coordinate in units of the instrument's.
    """
    if data is None:
        return nothing_measured(len(model.parameters), variance)
    _, J = model.residuals.of_data(data).residuals_and_jacobian(model.start)
    return GivenInformation(J, model.start, variance, len(data), len(J))


def _motion(J: Array) -> Array:
    """(k,) root mean square motion by a unit of each unknown, in standard deviations, from derivatives (N, b, k)."""
    return np.asarray(np.sqrt(np.mean(np.sum(J**2, axis=1), axis=0)))
