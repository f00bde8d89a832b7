"""The report on what a model gets wrong, before and after calibration, by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from posture_opt.report.blocks import Report, Summary
from posture_opt.report.presenter import Columns, Presenter
from posture_opt.report.residual_blocks import residual_blocks
from posture_opt.report.units_text import length, percent
from posture_opt.report.words import MODEL_NAMES
from posture_opt.validation.assessment import Assessment

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem


class AssessmentPresenter(Presenter[Assessment]):
    """What a model gets wrong, and whether what remains is scatter."""

    document = "assessment"

    @property
    def problem(self) -> Problem:
        return cast("Problem", self.result.calibration.request.problem)

    def summary(self) -> Summary:
        found = self.result
        models = {"nominal": found.nominal, "calibrated": found.calibrated}
        errors = [
            (MODEL_NAMES[name].capitalize(), f"{length(m.coordinate)} a coordinate") for name, m in models.items()
        ]
        left = found.residual_scatter
        inside = [] if left is None else [("In its 95 % region", f"{percent(left.inside)} of the rows")]
        facts = (("Rows", f"{found.rows} in {found.poses} poses"), *errors, *inside)
        return Summary(f"Assessment of a calibration: {self.problem.name}", facts)

    def report(self) -> Report:
        return Report(self.problem.name or "Assessment", (), residual_blocks(self.result))

    def columns(self) -> Columns:
        """Errors of a coordinate by model."""
        found = self.result
        return {
            "model": ["nominal", "calibrated"],
            "error of a coordinate [m]": [found.nominal.coordinate, found.calibrated.coordinate],
        }
