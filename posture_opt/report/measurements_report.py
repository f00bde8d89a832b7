"""Measurements in a few lines, for those who work with them in Python."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.blocks import Summary
from posture_opt.report.presenter import SummaryPresenter

if TYPE_CHECKING:
    from posture_opt.measurements.measurements import Measurements


class MeasurementsPresenter(SummaryPresenter["Measurements"]):
    """How many rows of what."""

    def summary(self) -> Summary:
        data = self.result
        poses = len(np.unique(data.pose))
        repeated = f" of {poses} postures" if poses < len(data) else ", each of another posture"
        facts = [("Rows", f"{len(data)}{repeated}"), ("Measured", _measured(data)), ("Joints", _ranges(data))]
        if len(data.robot_names) > 1:
            facts.append(("Robots", ", ".join(data.robot_names)))
        inputs = ("approach", "payload", "temperature", "time")
        there = [name for name in inputs if getattr(data, f"{name}_given", getattr(data, name) is not None)]
        facts += [("Also", ", ".join(there))] if there else []
        facts += [("Note" if k == 0 else "", note) for k, note in enumerate(data.warnings[:2])]
        return Summary(f"Measurements of {Path(data.file).name or 'a table'}", tuple(facts))


def _measured(data: Measurements) -> str:
    if data.position is None:
        return f"touches of {len(data.point_names)} points"
    axes = ", ".join(name for name, seen in zip("xyz", data.measured_axes, strict=True) if seen)
    return f"position ({axes})" + (" and orientation" if data.rotation is not None else "")


def _ranges(data: Measurements) -> str:
    """The largest and the smallest range that a joint was moved over, as far as angles go."""
    spans = np.ptp(data.q, axis=0)
    moved = sum(span > 0 for span in spans)
    return f"{moved} of {len(spans)} moved; the widest range is {math.degrees(float(max(spans))):.0f} deg"
