"""Covariance, objective and its derivatives as a Python module that needs NumPy alone.

The functions take postures (…, n) [rad or m] and return (…, 3) [m], (…, 3, 3) [m²] and so on, world frame.
"""

from __future__ import annotations

import keyword
from collections.abc import Mapping
from typing import ClassVar, Literal

from posture_opt import __version__
from posture_opt.export.export_format import Exported, ExportFormat, ExportSource, objective_or_note
from posture_opt.model.c_source import python_source
from posture_opt.texts import one_line
from posture_opt.uncertainty.spread_function import spread_expressions

_MODULE_HEADER = '''"""{title}

Written by posture_opt {version}; needs NumPy alone. q is an array (..., n) of joint values [rad or m]: {joints}.

{functions}
"""

import math

import numpy as np

JOINTS = {names!r}


def _shaped(q, values, shape):
    """Entries, column by column, as arrays (..., *shape)."""
    every = np.broadcast_arrays(q[..., 0], *values)[1:]
    flat = np.stack(every, axis=-1).reshape((*q.shape[:-1], *reversed(shape)))
    return flat.swapaxes(-1, -2) if len(shape) == 2 else flat


_erf = np.vectorize(math.erf, otypes=[float])
'''
_SPREAD = '''
def position(q):
    """(..., 3) {position}."""
    return _spread(q)[0]


def covariance(q):
    """(..., 3, 3) {covariance}."""
    return _spread(q)[1]


def first_order(q):
    """(..., 3, 3) {first_order}."""
    return _spread(q)[2]
'''
_OBJECTIVE = '''
def objective(q):
    """(...) {objective}."""
    return _objective(q)[0]


def gradient(q):
    """(..., n) {gradient}."""
    return _objective(q)[1]


def hessian(q):
    """(..., n, n) {hessian}."""
    return _hessian(q)[0]
'''


class PythonCode(ExportFormat):
    """``NAME.py`` with position, covariance, first_order, and objective, gradient and hessian of the task."""

    summary: ClassVar[str] = "covariance of the tool point, objective, gradient and Hessian as Python, NumPy alone"
    default: ClassVar[str] = "tool_covariance"
    reserved: ClassVar[frozenset[str]] = frozenset((*keyword.kwlist, "math", "numpy"))

    kind: Literal["python"] = "python"

    def write(self, source: ExportSource) -> Exported:
        """The module with a docstring that lists functions and joints with their units."""
        problem = source.problem
        function, said = spread_expressions(problem)
        parts = [python_source(function, "_spread"), _SPREAD.format(**_safe(said))]
        objective, notes = objective_or_note(problem)
        described = dict(said)
        if objective is not None:
            # The Hessian apart, because it takes three times as long as both others.
            parts += [python_source(objective[0], "_objective", (0, 1)), python_source(objective[0], "_hessian", (2,))]
            parts += [_OBJECTIVE.format(**_safe(objective[1]))]
            described |= {key: text for key, text in objective[1].items() if key != "q"}
        lines = [f"{key}(q): {text}" for key, text in _safe(described).items() if key != "q"]
        head = _MODULE_HEADER.format(
            title=_safe({"": problem.name or "Spread of a tool point"})[""],
            version=__version__,
            joints=_safe({"": ", ".join(f"{j.name} [{j.unit}]" for j in problem.arm.robot.joints)})[""],
            functions="\n".join(lines),
            names=tuple(problem.arm.robot.joint_names),
        )
        return Exported({f"{self.stem}.py": "\n\n".join([head, *parts])}, notes)


def _safe(texts: Mapping[str, str]) -> dict[str, str]:
    return {key: one_line(text).replace("\\", "/").replace('"', "'") for key, text in texts.items()}
