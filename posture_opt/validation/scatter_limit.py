"""How far joints scatter from repeat to repeat at the most: as repeats show, or a file or data sheet says.

What a calibration leaves of the errors holds the scatter and whatever the model lacks, which is the same at every
repeat of a posture. Only the first is scatter.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.calibration.calibration import Calibration
from posture_opt.measurements.repeats import MIN_FREEDOM, Contrasts
from posture_opt.numerics import Array, rms
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.sources.repeatability import joint_sigmas
from posture_opt.validation.likeliest_variances import likeliest_variances
from posture_opt.validation.prediction import joint_columns, joint_errors
from posture_opt.validation.repeat_scatter import prismatic_joints


@dataclass(frozen=True)
class ScatterLimit:
    """The most that the joints' errors scatter from repeat to repeat.

    Args:
        sigma: JOINT.theta or JOINT.d -> standard deviation [rad or m].
        source: a clause on where it is from.
        shown: whether repeats show so much, and not only allow it.
    """

    sigma: Mapping[str, float]
    source: str
    shown: bool = False


def scatter_limit(
    problem: ProblemData, calibration: Calibration, fixed: Mapping[str, float], fitted: Array | None = None
) -> ScatterLimit | None:
    """The limit by repeats where there are enough, else by what is stated; ``None`` where nothing determines it.

    Args:
        fixed: σ of joints that is known already; it is not sought again.
        fitted: (m, d) errors of the kept rows by the arm fitted to all of them [m]; the calibration's by default.
    """
    return _by_repeats(problem, calibration, fixed, fitted) or _as_stated(problem)


def _as_stated(problem: ProblemData) -> ScatterLimit | None:
    """The limit by the file's scatter, else by the data sheet's repeatability (ISO 9283); None without both."""
    sources = problem.sources
    total = dict(zip(sources.names, map(float, np.sqrt(np.diag(sources.scatter))), strict=True))
    stated = {name: s for name, s in total.items() if s > 0}
    if stated:
        return ScatterLimit(stated, "as the file states it")
    sheet = problem.robot.repeatability
    if sheet is None:
        return None
    found = joint_sigmas(problem.robot, sheet.value)
    sigma = dict(zip(found.names, map(float, found.sigma), strict=True))
    return ScatterLimit(sigma, "as the data sheet allows")


def _by_repeats(
    problem: ProblemData, calibration: Calibration, fixed: Mapping[str, float], fitted: Array | None
) -> ScatterLimit | None:
    """The limit by differences between repeats of one posture; None where they are too few.

    The difference of two readings of one repeat has ``2σ²``, so contrasts are scaled by `Contrasts.reading` to the
    variance of one reading before joints are estimated from them.
    """
    kept = calibration.residuals.take(calibration.kept_rows)
    contrasts = Contrasts.of(kept.data, prismatic_joints(kept))
    if len(contrasts) * len(kept.axes) < MIN_FREEDOM:
        return None
    errors = kept.error(calibration.x)[:, kept.axes] if fitted is None else fitted
    scale = 1 / np.sqrt(contrasts.reading)
    e = contrasts.differences(errors) * scale[:, None]
    columns = contrasts.means(joint_columns(kept, calibration.x)) * scale[:, None, None]
    names = joint_errors(problem.robot)
    given = np.array([fixed.get(name, 0.0) for name in names])
    loud, sought = columns * given, np.array([name not in fixed for name in names])
    stated = position_sigma(problem, kept.data)
    size = rms(e)
    if not size > 0 or not sought.any():
        return None
    noise = likeliest_variances(
        e, loud @ np.swapaxes(loud, -1, -2), columns[:, :, sought],
        tuple(name for name, one in zip(names, sought, strict=True) if one), stated or size, fit=not stated,
    )  # fmt: skip
    if noise is None:
        return None
    sigma = dict(zip(noise.names, map(float, noise.sigma), strict=True))
    return ScatterLimit(sigma | dict(fixed), f"as {len(contrasts)} differences between repeats show it", True)
