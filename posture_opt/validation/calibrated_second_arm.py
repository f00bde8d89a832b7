"""The arm that the first one touched, as its own problem file takes over what a calibration found of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.fit_request import persistent_sources
from posture_opt.numerics import Array
from posture_opt.selection.fitted_arm import FittedArm
from posture_opt.uncertainty.sources.sources import Sources


def second_arms(
    calibration: Calibration, x: Array, covariance: Array, label: str, header: Sequence[str]
) -> dict[str, FittedArm]:
    """Name -> the second arm with its parameters that were found; none where it is held.

    Args:
        x: (k,) deviations of the parameters of the calibration [rad or m]; covariance: (k, k) of these.
        label: of the file; header: its first lines.
    """
    at = {p.name: i for i, p in enumerate(calibration.parameters)}
    found = {}
    for name, second in calibration.residuals.data.kind.second_arms.items():
        if not second.unknowns:
            continue
        own = [at[f"{name}.{parameter}"] for parameter in second.unknowns]
        known = persistent_sources(
            second.robot, Sources.independent(second.sigmas), second.unknowns, covariance[np.ix_(own, own)]
        )
        deviations = dict(zip(second.unknowns, map(float, x[own]), strict=True))
        found[name] = FittedArm(label=label, deviations=deviations, known=known, header=tuple(header))
    return found
