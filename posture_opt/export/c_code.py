"""Covariance, objective and gradient as C99 that needs math.h alone."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.export.export_format import Exported, ExportFormat, ExportSource
from posture_opt.export.objective_note import objective_or_note
from posture_opt.model.c_source import c_source
from posture_opt.uncertainty.spread_function import covariance_c


class CCode(ExportFormat):
    """``NAME.c`` and ``.h`` with the moments of the tool point; ``NAME_objective.c`` and ``.h`` with the task's."""

    summary: ClassVar[str] = "covariance of the tool point, objective and gradient as C99, math.h alone"
    default: ClassVar[str] = "tool_covariance"

    kind: Literal["c"] = "c"

    def write(self, source: ExportSource) -> Exported:
        name = self.name or self.default
        text, header = covariance_c(source.problem, name)
        files = {f"{name}.h": header, f"{name}.c": text}
        objective, notes = objective_or_note(source.problem)
        if objective is not None:
            text, header = c_source(objective[0], f"{name}_objective", objective[1])
            files |= {f"{name}_objective.h": header, f"{name}_objective.c": text}
        return Exported(files, notes)
