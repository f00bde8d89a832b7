"""The arm that a calibration found, as its problem takes it over, and what that changes for the task."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.fit_request import persistent_sources, places_in_robot
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.comparison.compare import compare_plans
from posture_opt.selection.comparison.comparison import Comparison
from posture_opt.selection.fitted_arm import FittedArm
from posture_opt.selection.problem_data import ProblemData
from posture_opt.validation.calibrated_second_arm import second_arms
from posture_opt.validation.prediction import JointScatter
from posture_opt.validation.residual_scatter import covariance_under, residual_scatter

FREE_BASE = (
    "the base is free, so the world is the frame of the instrument, and the place of the task is read in it: write "
    "position and direction in that frame"
)
NOMINAL_KEPT = "Geometry is nominal: the data do not show surely enough that the calibrated one is better."


def calibrated_arm(problem: ProblemData, calibration: Calibration) -> FittedArm:
    """The arm with its calibrated parameters, what is still uncertain of them, and its scatter.

    Every deviation counts, those too that are determined together only. Of several targets the first is the tool
    point. The covariance is the estimate's, under the scatter from repeat to repeat that the calibration leaves; where
    the nominal arm is kept, the mean square about that one.
    """
    scatter = residual_scatter(problem, calibration)
    places = places_in_robot(calibration.parameters)
    own = list(places.values())
    x = calibration.delivered
    every = covariance_under(calibration, scatter) + np.outer(calibration.x - x, calibration.x - x)
    covariance, header = every[np.ix_(own, own)], _file_header(calibration, scatter)
    return FittedArm(
        label="calibrated",
        deviations={name: float(x[i]) for name, i in places.items()},
        known=persistent_sources(problem.robot, problem.sources, list(places), covariance).plus(scatter.errors),
        scatter=scatter.without_effects,
        header=header,
        second_arms=second_arms(calibration, x, every, "calibrated", header[:2]),
    )


def nominal_arm(calibration: Calibration) -> FittedArm:
    """The nominal arm where the measurements saw it: free frames are found, and nothing else is fitted.

    Its document is what a controller with the file's parameters would do; errors stay those of the problem.
    """
    parameters = calibration.parameters
    frames = {name: i for name, i in places_in_robot(parameters).items() if parameters[i].group in ("base", "tool")}
    return FittedArm("", {name: float(calibration.x_nominal[i]) for name, i in frames.items()})


def calibrated_models(problem: ProblemData, calibration: Calibration) -> dict[str, ProblemData]:
    """The problem before calibration, its free frames found, and calibrated.

    Returns:
        Problems by name, ``nominal`` and ``calibrated``.
    """
    return {
        "nominal": problem.with_fit(nominal_arm(calibration)),
        "calibrated": problem.with_fit(calibrated_arm(problem, calibration)),
    }


def compare_models(
    robot: Robot, models: Mapping[str, ProblemData], *, seed: int | None = None, workers: int = 1,
    measured: Array | None = None,
) -> Comparison | None:  # fmt: skip
    """The task planned with models that were fitted to the data of one ``robot``; None without a task.

    Args:
        measured: (N, n) postures of these data [rad or m].
        robot: says whether the base is free, so that the task's place is read in the frame of the instrument.
        models: problems by name, the one in question last; seed, workers: of the plans.
    """
    hint = FREE_BASE if robot.base_free else ""
    return compare_plans(models, seed=seed, workers=workers, hint=hint, measured=measured)


def _file_header(calibration: Calibration, scatter: JointScatter) -> tuple[str, ...]:
    """What the file says of itself in its first lines."""
    data = calibration.residuals.data
    file = Path(data.file).name or "a table"
    gone = f", {len(calibration.outliers)} of them left out as outliers" if calibration.outliers else ""
    before, after = (f"{s.rms * 1e3:.3g} mm" for s in (calibration.nominal, calibration.calibrated))
    targets = [p.name for p in calibration.parameters if p.group == "tool" and p.code > 0]
    several = (
        f"The tool point is the first of {len(data.target_names)} targets, {data.target_names[0]}." if targets else ""
    )
    lines = (
        f"Calibrated with {file}: {len(data)} rows{gone}.",
        f"RMS position error on held-out rows: {before} before calibration, {after} after.",
        NOMINAL_KEPT if calibration.keeps_nominal else "",
        "What is still uncertain of its parameters is in calibrated_covariance.csv, in mm and mrad; combinations",
        "of them that move nothing that was measured have no variance there.",
        f"{scatter.note[:1].upper()}{scatter.note[1:]}.",
        several,
    )
    return tuple(line for line in lines if line)
