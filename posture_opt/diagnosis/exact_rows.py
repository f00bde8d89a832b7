"""Rows that a model meets to rounding, as those of a simulation without noise are.

Every test compares what a cause explains with what is left. Where nothing but rounding is left, rounding is explained:
a joint that is off by 1 mrad would have company. So these rows get the scatter of an instrument that no one has.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posture_opt.calibration.estimation.fit import Fit
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, rms

SCATTER = 1e-9
"""Standard deviation of what is added to each number [m, rad]: a thousandth of what laser trackers resolve."""


def met_exactly(model: Fit) -> bool:
    """Whether a model leaves less of measured positions than `SCATTER`."""
    residuals = model.residuals
    return residuals.data.position is not None and rms(model.whitened) * float(np.max(residuals.sigma)) < SCATTER


def with_scatter(data: Measurements) -> Measurements:
    """The rows with `SCATTER` added to positions and orientations, the same in every call; the data say so."""
    assert data.position is not None
    rng = np.random.default_rng(1)
    position = data.position + rng.normal(0.0, SCATTER, data.position.shape)
    rotation = data.rotation
    if rotation is not None:
        rotation = _turned(rotation, rng.normal(0.0, SCATTER, (len(data), 3)))
    note = "The rows are met to the last digit, as simulated ones are: each number got a scatter of 1 nm, or 1 nrad."
    return replace(data, position=position, rotation=rotation, notes=(*data.notes, note))


def _turned(quaternions: Array, vectors: Array) -> Array:
    """Unit quaternions (N, 4) turned by small rotation vectors (N, 3) [rad]."""
    w, v = quaternions[:, :1], quaternions[:, 1:]
    small = vectors / 2
    turned = np.hstack([w - np.sum(small * v, axis=1, keepdims=True), v + w * small + np.cross(small, v)])
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))
