"""Every parameter of the arm with its nominal value, its correction and their sum, as CSV."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from posture_opt.export.export_format import Exported, ExportFormat, ExportSource
from posture_opt.texts import csv_line

_EFFECTS_NOTE = "the effects of the arm are no parameters of its geometry and are left out"


class DhTable(ExportFormat):
    """A table for controllers that take corrected parameters, and for people."""

    summary: ClassVar[str] = "CSV of every parameter: nominal value, correction, sum"
    default: ClassVar[str] = "dh"

    kind: Literal["dh"] = "dh"

    def write(self, source: ExportSource) -> Exported:
        """``NAME.csv``; a note says where effects are left out."""
        problem = source.problem
        corrections = problem.corrections
        lines = [csv_line(("parameter", "unit", "nominal", "correction", "sum"))]
        for name, factor in problem.nominal.parameters.items():
            unit, size = ("deg", math.degrees(1.0)) if factor.kind == "rotate" else ("mm", 1e3)
            added = corrections.get(name, 0.0)
            values = (factor.nominal, added, problem.robot.parameters[name].nominal)
            lines.append(csv_line([name, unit, *(f"{value * size + 0.0:.15g}" for value in values)]))
        notes = (_EFFECTS_NOTE,) if problem.arm.effects else ()
        return Exported({f"{self.stem}.csv": "\n".join([*lines, ""])}, notes)
