"""Further measurements that could be made: postures, sides of arrival and payloads that an arm can be asked for."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from posture_opt.calibration.residuals import Residuals
from posture_opt.experiments.candidate_postures import Workspace, reach, skeleton
from posture_opt.experiments.information import planned_rows
from posture_opt.measurements.measurements import Measurements

_OWN, _SWUNG, _ANYWHERE = 150, 350, 500  # candidates of each sort, before those that are not allowed go
_PAYLOADS = 4  # of the data; of more the least, the largest and some between


def available_payloads(data: Measurements, stated: float) -> tuple[float, ...]:
    """Payloads [kg] that are at hand: those of the data, the one that the file states, and none."""
    measured = np.unique(np.round(data.payload, 3)) if data.payload is not None else np.zeros(0)
    if len(measured) > _PAYLOADS:
        measured = measured[np.linspace(0, len(measured) - 1, _PAYLOADS).round().astype(int)]
    return tuple(sorted({0.0, round(stated, 3), *map(float, measured)}))


def candidate_rows(residuals: Residuals, joints: Collection[int], sided: bool, seed: int = 0) -> Measurements:
    """Rows that could be measured, none of them yet.

    Postures of the data again; the same with some joints anywhere in their range; and any others. They keep clear of
    the arm itself and go no lower than its foot, or than the data went. Payloads and sides are drawn at random.

    Args:
        joints: those that are moved over their whole range.
        sided: whether the side of arrival is chosen too.

    Raises:
        InputError: a slide without limits.
    """
    robot, data = residuals.robot, residuals.data
    rng = np.random.default_rng(seed)
    known = np.unique(data.q, axis=0)
    known = known[rng.permutation(len(known))]
    workspace = Workspace.of(robot, height=_lowest(residuals))
    swung = known[rng.integers(len(known), size=_SWUNG)]
    columns = list(joints) or list(range(robot.n))
    swung[:, columns] = rng.uniform(workspace.lower[columns], workspace.upper[columns], (_SWUNG, len(columns)))
    anywhere = rng.uniform(workspace.lower, workspace.upper, (_ANYWHERE, robot.n))
    q = workspace.rounded(np.concatenate([known[:_OWN], swung, anywhere]))
    q = q[workspace.allowed(q)]
    rows = planned_rows(robot, q, data.measured_axes, data.target_names[:1], residuals.oriented)
    loads = available_payloads(data, robot.payload)
    return replace(
        rows,
        payload=None if loads == (0.0,) and data.payload is None else rng.choice(loads, len(q)),
        temperature=None if data.temperature is None else np.full(len(q), float(np.mean(data.temperature))),
        time=np.zeros(len(q)),
        approach=rng.choice([-1.0, 1.0], q.shape) if sided else np.zeros(q.shape),
        approach_length=np.tile(np.median(data.approach_length, axis=0), (len(q), 1)),
    )


def _lowest(residuals: Residuals) -> float:
    """The foot of the arm, or the lowest that a moving part of it came to in the data if that is lower [m]."""
    robot, q = residuals.robot, residuals.data.q
    points = skeleton(robot, reach(robot, q), len(q))
    moving = np.ptp(points[:, :, 2], axis=0) > 1e-9
    lowest = float(points[:, moving, 2].min()) if moving.any() else np.inf
    return min(lowest, float(points[0, 0, 2])) - 1e-9
