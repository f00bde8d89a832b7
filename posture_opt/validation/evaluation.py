"""``Evaluation``: what a calibration is held against, which its document and its report state beside the estimates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from posture_opt.calibration.calibration import Calibration
from posture_opt.numerics import DerivedAgain, Json
from posture_opt.selection.comparison.comparison import Comparison
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Statement, state
from posture_opt.validation.assessment import Assessment, assess
from posture_opt.validation.calibrated_arm import calibrated_models, compare_models
from posture_opt.validation.spread_check import SpreadCheck, check_spread

_MIN_NOISE_SHARE = 0.5**0.5  # of a standard deviation: less is less than half of the variance


@dataclass(frozen=True, eq=False)
class Evaluation(DerivedAgain):
    """The residuals of a calibration, the spread that it predicts, and its task planned again, each computed once.

    Its parts are computed when they are first asked for, and not again.

    Args:
        calibration: with its request: problem, measurements, and whether the task is planned again.
    """

    calibration: Calibration

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
        """The task planned before and after; None where there is no task, or nobody asked.

        The calibrated arm has another best posture than the nominal one where its errors differ enough.
        """
        request = self.calibration.request
        if not request.plan:
            return None
        return compare_models(request.problem.robot, self.models, seed=request.seed, measured=request.data.q)

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """What follows from it: the task planned again, doubts about the spread, and the next step."""
        parts = (self.assessment, self.spread_check)
        doubts = (one for part in parts for one in part.statements if one.severity != "result")
        return (*(() if self.comparison is None else self.comparison.statements), *self._next_step, *doubts)

    @property
    def _next_step(self) -> tuple[Statement, ...]:
        """The most urgent step: a systematic error comes before open parameters, these before repeats."""
        seen, found = self.assessment, self.calibration
        steps = {
            "diagnose": not seen.calibrated.zero,
            "diagnose-scatter": 0 < seen.instrument < _MIN_NOISE_SHARE * seen.calibrated.coordinate,
            "plan-measurements": bool(found.identifiability.words),
            "repeat": seen.repeats is None and found.request.data.position is not None,
            "plan-task": True,
        }
        return (state(f"calibration.next-{next(step for step, due in steps.items() if due)}"),)

    def to_json(self) -> dict[str, Json]:
        """Its part of the document ``calibration.json``."""
        plan = {} if self.comparison is None else {"posture": self.comparison.fields_json()}
        return {
            "assessment": self.assessment.fields_json(),
            "coverage95": self.spread_check.coverage95,
            "spread_check": self.spread_check.fields_json(),
            **plan,
        }
