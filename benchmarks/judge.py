"""One judge for all ways: is the posture feasible, and how large is the worst axis there? Pinocchio alone decides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from benchmarks.arms import Arm, Array

POSITION_TOLERANCE = 1e-6  # m: a fiftieth of the scatter that is compared at the third digit
AXIS_TOLERANCE = 1e-4  # rad
LIMIT_TOLERANCE = 1e-6  # rad


@dataclass(frozen=True)
class Verdict:
    """What the judge says of one posture; `sigma` is the worst standard deviation across the insertion [m]."""

    position_error: float
    axis_error: float
    limit_error: float
    sigma: float

    @property
    def feasible(self) -> bool:
        return (
            self.position_error < POSITION_TOLERANCE
            and self.axis_error < AXIS_TOLERANCE
            and self.limit_error < LIMIT_TOLERANCE
        )


def judge(arm: Arm, position: Array, q: Array) -> Verdict:
    """Judge a posture for the vertical insertion at `position`: tool axis down, worst horizontal axis of J Σ Jᵀ."""
    model, data = arm.model, arm.model.createData()
    pin.framesForwardKinematics(model, data, q)
    tip = data.oMf[arm.tip_id]
    J = pin.computeFrameJacobian(model, data, q, arm.tip_id, pin.LOCAL_WORLD_ALIGNED)[:3]
    covariance = J @ np.diag(np.square(arm.sigma)) @ J.T
    axis = tip.rotation[:, 2]
    lower, upper = arm.limits
    return Verdict(
        position_error=float(np.linalg.norm(tip.translation - position)),
        # atan2, since arccos loses half the digits near zero
        axis_error=float(np.arctan2(np.hypot(axis[0], axis[1]), -axis[2])),
        limit_error=float(max(np.max(lower - q), np.max(q - upper), 0.0)),
        sigma=float(np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1])),
    )
