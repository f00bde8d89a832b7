"""The residuals of a calibrated arm, ready for a search, and the directions of what is free in the arm as it stands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.calibration import Calibration
from posture_opt.diagnosis.identifiability import identify
from posture_opt.diagnosis.search import Scene
from posture_opt.diagnosis.tangents import Tangents, case_of

Array = NDArray[np.float64]


def scene_of(calibration: Calibration, flips: int = 299, seed: int = 0) -> Scene:
    """The residuals of a calibrated arm, without its outliers, ready for a search."""
    kept = np.setdiff1d(np.arange(len(calibration.residuals.data)), calibration.outliers)
    residuals = calibration.residuals.take(kept)
    r, J = residuals.both(calibration.x)
    rows = len(kept) * residuals.block
    tangents = Tangents(residuals, calibration.x)
    poses = np.repeat(np.unique(residuals.data.pose, return_inverse=True)[1], residuals.block)
    G = J[:rows] @ calibration.identifiability.directions
    return Scene(tangents, case_of(residuals.data, residuals.robot), r[:rows], G, poses, flips, seed)


def points_of(scene: Scene) -> Array:
    """(N, 3) the tool points of the rows [m]."""
    n = len(scene.tangents.residuals.data)
    return np.stack([np.broadcast_to(np.asarray(v, dtype=float), (n,)) for v in scene.tangents.walk.position], axis=1)


def frame_directions(calibration: Calibration) -> Array:
    """Directions of what is free in the arm as it stands: frames and touched points."""
    robot = calibration.residuals.robot
    groups = {"point"} | ({"base"} if robot.base_free else set()) | ({"tool"} if robot.tool_free else set())
    columns = [i for i, p in enumerate(calibration.parameters) if p.group in groups]
    k = len(calibration.parameters)
    if not columns:
        return np.zeros((k, 0))
    J = calibration.residuals.both(calibration.x_nominal)[1][:, columns]
    part = identify([calibration.parameters[i].name for i in columns], J, len(calibration.residuals.data))
    directions = np.zeros((k, part.rank))
    directions[columns] = part.directions
    return directions
