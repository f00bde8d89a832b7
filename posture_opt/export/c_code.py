"""Covariance, objective and its derivatives as C99 that needs math.h alone."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.export.c_check import CheckedFunction, check_text
from posture_opt.export.export_format import Exported, ExportFormat, ExportSource
from posture_opt.export.objective_note import objective_or_note
from posture_opt.model.c_source import c_source
from posture_opt.uncertainty.spread.spread_function import spread_expressions


class CCode(ExportFormat):
    """``NAME.c`` and ``.h`` with the moments of the tool point; ``NAME_objective.c`` and ``.h`` with the task's;
    ``NAME_check.c`` with a ``main`` that holds them against postures whose numbers are known.
    """

    summary: ClassVar[str] = "covariance of the tool point, objective, gradient and Hessian as C99, math.h alone"
    default: ClassVar[str] = "tool_covariance"

    kind: Literal["c"] = "c"

    def write(self, source: ExportSource) -> Exported:
        name, problem = self.name or self.default, source.problem
        spread, described = spread_expressions(problem)
        files = _written(name, c_source(spread, name, described, rows=True))
        checked = [CheckedFunction(name, spread, rows=True)]
        objective, notes = objective_or_note(problem)
        if objective is not None:
            # The gradient goes on from the objective, and the Hessian from both.
            files |= _written(
                f"{name}_objective", c_source(objective[0], f"{name}_objective", objective[1], shared=True)
            )
            checked.append(CheckedFunction(f"{name}_objective", objective[0], rows=False))
        return Exported(files | {f"{name}_check.c": check_text(problem.robot, checked)}, notes)


def _written(name: str, texts: tuple[str, str]) -> dict[str, str]:
    """Header and source by file name."""
    text, header = texts
    return {f"{name}.h": header, f"{name}.c": text}
