"""``Diagnosed``: a diagnosis with what it was made from, and the figures that its report and pictures share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.diagnosis.linearised_data import LinearisedData, linearise
from posture_opt.model.effects.cause import FittedSizes
from posture_opt.numerics import Array
from posture_opt.report.words import MODEL_NAMES

if TYPE_CHECKING:
    from posture_opt.calibration.residuals import Residuals
    from posture_opt.diagnosis.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.diagnosis.measured_goals import MeasuredGoals
    from posture_opt.measurements.measurements import Measurements
    from posture_opt.problem.problem import Problem
    from posture_opt.selection.plan_comparison import Comparison

MODELS = {name: MODEL_NAMES[name] for name in ("nominal", "calibrated", "extended")}
_REPEATS = 12  # degrees of freedom of repeats, from which on they tell the noise


@dataclass(frozen=True, eq=False)
class Diagnosed:
    """A diagnosis as the command line, the report and the figures see it.

    Args:
        data: the measurements; ``test`` another file, predicted with base and tool refitted if ``refit_frames``.
        comparison: the task planned with every model; ``goals`` those that were measured in several postures.
        problem: what the file states of the arm; ``None`` where nobody needs to know.
    """

    data: Measurements
    diagnosis: Diagnosis
    folds: int = 5
    test: Measurements | None = None
    refit_frames: bool = False
    comparison: Comparison | None = None
    goals: MeasuredGoals | None = None
    problem: Problem | None = None

    @property
    def residuals(self) -> Residuals:
        """Of the rows that are no outliers."""
        return self.diagnosis.model.residuals

    @cached_property
    def linearised(self) -> LinearisedData:
        """What the search saw, without its null."""
        return linearise(self.diagnosis.calibration, flips=0)

    @cached_property
    def effects(self) -> tuple[tuple[int, Finding], ...]:
        """(place among the effects of the model, finding) of every named effect."""
        named = [f for f in self.diagnosis.effects if f.effect is not None]
        return tuple(enumerate(named))

    def place(self, finding: Finding) -> int | None:
        """Where in the model an effect stands."""
        return next((place for place, f in self.effects if f is finding), None)

    def at_tool(self, place: int) -> Array:
        """(N,) how far an effect moves the tool point in each row [m]."""
        model, residuals = self.diagnosis.model, self.residuals
        rows = (model.effect_columns(place) @ model.x[model.slices[place]]).reshape(-1, residuals.block)
        return np.asarray(np.linalg.norm(rows[:, : len(residuals.axes)], axis=1) * residuals.sigma)

    def estimate(self, finding: Finding) -> FittedSizes:
        """What the fit says of a finding."""
        timed, place = self.residuals.data.time is not None, self.place(finding)
        if place is None:
            return FittedSizes(finding.estimate, timed=timed)
        model, part = self.diagnosis.model, self.diagnosis.model.slices[place]
        return FittedSizes(finding.estimate, model.covariance[part, part], timed, self._turn(place))

    def headline(self, finding: Finding) -> str:
        """The size of a finding that stands beside its words; empty where no single number says it."""
        return finding.cause.headline(self.estimate(finding))

    def _turn(self, place: int) -> tuple[float, float]:
        """Least and largest turn of its joint by an effect, 0 of one that acts on no joint [rad]."""
        model, state = self.diagnosis.model, self.linearised.sensitivities.state
        turned = np.zeros(len(self.residuals.data))
        ones = model.effects[place].sensitivities(state)
        for one, value in zip(ones, model.x[model.slices[place]], strict=True):
            for size in one.joints.values():
                turned = turned + value * np.asarray(size, dtype=float)
        return float(turned.min()), float(turned.max())

    @property
    def periodic_joints(self) -> list[int]:
        """Joints of which a line of the periodogram is named, the weightiest first."""
        names = list(self.residuals.data.joint_names)
        lines = [f.effect.moved_joint for _, f in self.effects if f.effect and f.effect.spectral_line is not None]
        return [names.index(joint) for joint in dict.fromkeys(lines)]

    @cached_property
    def floor(self) -> tuple[float, str]:
        """RMS [m] of the length of an error that is noise alone, and where it is known from; 0 where it is not."""
        residuals = self.residuals
        e = self.diagnosis.model.whitened.reshape(-1, residuals.block)[:, : len(residuals.axes)] * residuals.sigma
        code, count = np.unique(residuals.data.pose, return_inverse=True, return_counts=True)[1:]
        freedom = len(code) - len(count)
        if freedom * e.shape[1] >= _REPEATS:
            means = np.stack([np.bincount(code, column) / count for column in e.T], axis=1)
            return float(np.sqrt(np.sum((e - means[code]) ** 2) / freedom)), "the scatter of repeated postures"
        measurement = residuals.sigma if not any("no σ of the instrument" in n for n in self.diagnosis.notes) else 0.0
        return float(measurement * np.sqrt(e.shape[1])), "the instrument as stated"
