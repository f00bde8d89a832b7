"""``optimize-posture calibrate`` on measurements of several robots of one type."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import posture_opt as po
from posture_opt.cli.options import Common
from posture_opt.cli.output import Answer, progress_bar, rendered


def calibrated_batch(
    common: Common, folder: Path | None, problem: Any, data: po.Measurements, folds: int, by: Any
) -> Answer:
    """Calibrates every robot, writes the files, and returns what can be shown."""
    with progress_bar(common, "calibrating robots") as progress:
        found = po.calibrate_batch(problem, data, folds=folds, by=by, progress=progress)
    if folder is not None:
        from posture_opt.report.batch_files import write_batch

        write_batch(folder, problem, data, found, common.plots)
    return found.to_json, rendered("batch_report", problem, data, found)
