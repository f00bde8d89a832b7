"""The report on whether the predicted spread is true, by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from posture_opt.report.blocks import Report, Summary
from posture_opt.report.presenter import Columns, Presenter
from posture_opt.report.truth_blocks import truth_blocks, truth_lead
from posture_opt.report.units_text import length, percent
from posture_opt.report.words import MODEL_NAMES
from posture_opt.validation.spread_check import SpreadCheck

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem


class SpreadCheckPresenter(Presenter[SpreadCheck]):
    """Predicted spread against measured errors."""

    document = "spread_check"

    @property
    def problem(self) -> Problem:
        return cast("Problem", self.result.calibration.request.problem)

    def summary(self) -> Summary:
        found = self.result
        shares = [(f"In 95 % regions, {MODEL_NAMES[name]}", percent(p)) for name, p in found.coverage95.items()]
        repeats = [("Between repeats", length(found.repeat_sigma))] if found.repeat_sigma else []
        facts = (*shares, *repeats, ("Left by the calibration", f"{length(found.residual_rms)} a coordinate (RMS)"))
        return Summary(f"Check of the predicted spread: {self.problem.name}", facts)

    def report(self) -> Report:
        return Report(self.problem.name or "Spread", (truth_lead(self.result),), truth_blocks(self.result))

    def columns(self) -> Columns:
        """The share of the rows in the predicted 95 % region, by model."""
        shares = self.result.coverage95
        return {"model": list(shares), "share in the 95 % region": list(shares.values())}
