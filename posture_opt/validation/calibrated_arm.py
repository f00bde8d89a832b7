"""The arm that a calibration found, as its problem takes it over, and what the calibration is held against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.fit_request import persistent_sources, places_in_robot
from posture_opt.encoding import Encoded
from posture_opt.numerics import Array, DerivedAgain
from posture_opt.robot.robot import Robot
from posture_opt.selection.comparison.compare import compare_plans
from posture_opt.selection.comparison.comparison import Comparison
from posture_opt.selection.problem_data import FittedArm, ProblemData
from posture_opt.statements import Statement, state
from posture_opt.uncertainty.sources import Sources
from posture_opt.validation.assessment import Assessment, assess
from posture_opt.validation.residual_scatter import covariance_under, residual_scatter
from posture_opt.validation.spread_check import SpreadCheck, check_spread


def second_arms(
    calibration: Calibration, x: Array, covariance: Array, label: str, header: Sequence[str]
) -> dict[str, FittedArm]:
    """Name -> the second arm with its parameters that were found; none where it is held.

    x (k,) deviations of the parameters of the calibration [rad or m]; covariance: (k, k) of these.
    """
    at, found = {p.name: i for i, p in enumerate(calibration.parameters)}, {}
    for name, second in calibration.residuals.data.kind.second_arms.items():
        if not second.unknowns:
            continue
        own = [at[f"{name}.{parameter}"] for parameter in second.unknowns]
        stated = Sources.independent(second.sigmas)
        known = persistent_sources(second.robot, stated, second.unknowns, covariance[np.ix_(own, own)])
        deviations = dict(zip(second.unknowns, map(float, x[own]), strict=True))
        found[name] = FittedArm(label=label, deviations=deviations, known=known, header=tuple(header))
    return found


FREE_BASE = (
    "the base is free, so the world is the frame of the instrument, and the place of the task is read in it: write "
    "position and direction in that frame"
)
NOMINAL_KEPT = "Geometry is nominal: the data do not show surely enough that the calibrated one is better."


def calibrated_arm(problem: ProblemData, calibration: Calibration) -> FittedArm:
    """The arm with its calibrated parameters, what is still uncertain of them, and its scatter."""
    scatter, places = residual_scatter(problem, calibration), places_in_robot(calibration.parameters)
    own, x = list(places.values()), calibration.delivered
    every = covariance_under(calibration, scatter) + np.outer(calibration.x - x, calibration.x - x)
    data = calibration.residuals.data
    gone = f", {len(calibration.outliers)} of them left out as outliers" if calibration.outliers else ""
    before, after = (f"{s.rms * 1e3:.3g} mm" for s in (calibration.nominal, calibration.calibrated))
    several = any(p.group == "tool" and p.code > 0 for p in calibration.parameters)
    names = data.target_names
    header = (
        f"Calibrated with {Path(data.file).name or 'a table'}: {len(data)} rows{gone}.",
        f"RMS position error on held-out rows: {before} before calibration, {after} after.",
        NOMINAL_KEPT if calibration.keeps_nominal else "",
        "What is still uncertain of its parameters is in calibrated_covariance.csv, in mm and mrad; combinations",
        "of them that move nothing that was measured have no variance there.",
        f"{scatter.note[:1].upper()}{scatter.note[1:]}.",
        f"The tool point is the first of {len(names)} targets, {names[0]}." if several else "",
    )
    lines = tuple(line for line in header if line)
    known = persistent_sources(problem.robot, problem.sources, list(places), every[np.ix_(own, own)])
    return FittedArm(
        label="calibrated",
        deviations={name: float(x[i]) for name, i in places.items()},
        known=known.plus(scatter.errors),
        scatter=scatter.without_effects,
        header=lines,
        second_arms=second_arms(calibration, x, every, "calibrated", lines[:2]),
    )


def nominal_arm(calibration: Calibration) -> FittedArm:
    """The nominal arm where the measurements saw it: free frames are found, and nothing else is fitted."""
    parameters = calibration.parameters
    frames = {name: i for name, i in places_in_robot(parameters).items() if parameters[i].group in ("base", "tool")}
    return FittedArm("", {name: float(calibration.x_nominal[i]) for name, i in frames.items()})


def calibrated_models(problem: ProblemData, calibration: Calibration) -> dict[str, ProblemData]:
    """The problem before calibration, its free frames found, and calibrated."""
    return {
        "nominal": problem.with_fit(nominal_arm(calibration)),
        "calibrated": problem.with_fit(calibrated_arm(problem, calibration)),
    }


def compare_models(
    robot: Robot, models: Mapping[str, ProblemData], *, seed: int | None = None, workers: int = 1,
    measured: Array | None = None,
) -> Comparison | None:  # fmt: skip
    """The task planned with models that were fitted to the data of one ``robot``; None without a task.

    measured (N, n) postures of these data [rad or m].
    """
    hint = FREE_BASE if robot.base_free else ""
    return compare_plans(models, seed=seed, workers=workers, hint=hint, measured=measured)


@dataclass(frozen=True, eq=False)
class Evaluation(DerivedAgain, Encoded):
    """The residuals of a calibration, the spread that it predicts, and its task planned again, each computed once."""

    calibration: Calibration  # with its request: problem, measurements, and whether the task is planned again

    @cached_property
    def assessment(self) -> Assessment:
        """What the model gets wrong, before and after."""
        return assess(self.calibration)

    @cached_property
    def spread_check(self) -> SpreadCheck:
        """Whether the predicted spread is true."""
        return check_spread(self.calibration)

    @cached_property
    def models(self) -> dict[str, ProblemData]:
        """The problem before and after calibration, each where the measurements saw base and tool."""
        return calibrated_models(self.calibration.request.problem, self.calibration)

    @cached_property
    def comparison(self) -> Comparison | None:
        """The task planned before and after; None where there is no task, or nobody asked."""
        request = self.calibration.request
        if not request.plan:
            return None
        return compare_models(request.problem.robot, self.models, seed=request.seed, measured=request.data.q)

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """What follows from it: the task planned again, the next step, and doubts about the spread."""
        seen, found = self.assessment, self.calibration
        steps = {  # the most urgent one: a systematic error comes before open parameters, these before repeats
            "diagnose": not seen.calibrated.zero,
            "diagnose-scatter": 0 < seen.instrument < 0.5**0.5 * seen.calibrated.coordinate,  # half of the variance
            "plan-measurements": bool(found.identifiability.words),
            "repeat": seen.repeats is None and found.request.data.position is not None,
            "plan-task": True,
        }
        step = state(f"calibration.next-{next(step for step, due in steps.items() if due)}")
        doubts = (one for part in (seen, self.spread_check) for one in part.statements if one.severity != "result")
        return (*(() if self.comparison is None else self.comparison.statements), step, *doubts)

    def fields_json(self) -> dict[str, object]:
        plan: dict[str, object] = {} if self.comparison is None else {"posture": self.comparison.fields_json()}
        return {
            "assessment": self.assessment.fields_json(),
            "coverage95": self.spread_check.coverage95,
            "spread_check": self.spread_check.fields_json(),
            **plan,
        }
