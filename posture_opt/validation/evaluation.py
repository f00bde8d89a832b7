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


@dataclass(frozen=True, eq=False)
class Evaluation(DerivedAgain):
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

    def to_json(self) -> dict[str, Json]:
        plan = {} if self.comparison is None else {"posture": self.comparison.fields_json()}
        return {
            "assessment": self.assessment.fields_json(),
            "coverage95": self.spread_check.coverage95,
            "spread_check": self.spread_check.fields_json(),
            **plan,
        }
