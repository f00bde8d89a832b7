"""``optimize-posture diagnose`` on measurements of several robots of one type."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import posture_opt as po
from posture_opt.cli.options import Common
from posture_opt.cli.output import Answer, progress_bar, rendered


def diagnosed_batch(
    common: Common, folder: Path | None, problem: Any, data: po.Measurements, folds: int, by: Any
) -> Answer:
    """Diagnoses the batch, writes the files, and returns what can be shown."""
    with progress_bar(common, "diagnosing robots") as progress:
        found = po.diagnose_batch(problem, data, folds=folds, by=by, seed=common.seed or 0, progress=progress)
    if folder is not None:
        from posture_opt.report.batch_diagnosis_report import write_batch_diagnosis

        write_batch_diagnosis(folder, problem, data, found, common.plots)
    return found.to_json, rendered("batch_diagnosis_report", problem, data, found)
