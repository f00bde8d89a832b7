"""``StationFunction``: one optimisation problem as a function of the placement of the workpiece."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.program.nlp import Row
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import SIZES, turned_about_z

_POINT_PARAMETERS = ("lower", "upper")  # of the target's parameters; the other ones of three entries are directions


class StationFunction:
    """``(w, q, c) -> (f, extra, g)`` of one optimisation problem at the target that a placement moves ``c`` to.

    ``f`` is the objective's first term and ``extra`` the sum of the further ones; ``g`` are rows between constant ends.

    Args:
        first: ``(x, p) -> f`` in place of the first term, with more than one entry where it likes.

    Attributes:
        call: the CasADi function, of symbols or numbers.
        ends: lower and upper ends (m,) of ``g``.
    """

    def __init__(self, problem: OptimisationProblem, first: ca.Function | None = None) -> None:
        nlp = problem.nlp
        extra = sum((expression for _, expression in nlp.terms[1:]), ca.SX(0))
        parts = [part for row in nlp.rows for part in _one_sided(row)]
        parts += _in_reach(problem)
        rows = ca.vertcat(ca.SX(0, 1), *(expression for expression, _, _ in parts))
        at_target = ca.Function("at_target", [nlp.x, nlp.p], [nlp.terms[0][1], extra, rows])
        kind: Any = ca.SX if first is None else ca.MX
        w, q, c = (kind.sym(name, size) for name, size in zip("wqc", (4, nlp.x.numel(), nlp.p.numel()), strict=True))
        moved = moved_parameters(c, w)
        outputs = list(at_target(q, moved))
        outputs[0] = outputs[0] if first is None else first(q, moved)
        self.call: ca.Function = ca.Function("station", [w, q, c], [ca.densify(output) for output in outputs])
        low, high = np.array([low for _, low, _ in parts]), np.array([high for _, _, high in parts])
        self.ends: tuple[Array, Array] = (low, high)


def moved_parameters(c: Any, w: Any) -> Any:
    """The parameters of a target in the frame of the workpiece, at the placement w (4,), world; SX or MX."""
    parts, at = [], 0
    for name, size in SIZES.items():
        part = c[at : at + size]
        at += size
        if size == 3:
            part = turned_about_z(part, ca.cos(w[3]), ca.sin(w[3]))
            part = part + w[:3] if name in _POINT_PARAMETERS else part
        parts.append(part)
    return ca.vertcat(*parts)


def _one_sided(row: Row) -> list[tuple[ca.SX, float, float]]:
    """A row as expressions between constants: its bounds depend on the target, which depends on the placement."""
    if ca.is_equal(row.lower, row.upper, 2):
        return [(row.expression - row.lower, 0.0, 0.0)]
    sides = []
    if not _infinite(row.lower):
        sides.append((row.expression - row.lower, 0.0, np.inf))
    if not _infinite(row.upper):
        sides.append((row.expression - row.upper, -np.inf, 0.0))
    return sides


def _infinite(bound: ca.SX) -> bool:
    """Whether a bound bounds nothing."""
    return bool(bound.is_constant()) and bool(np.isinf(float(bound)))


def _in_reach(problem: OptimisationProblem) -> list[tuple[ca.SX, float, float]]:
    """The target in the plane (or on the line) that the tool point never leaves."""
    reach = problem.reach
    off = problem.nlp.p[:3] - ca.DM(reach.offset)
    slack = float(reach.plane_slack)
    return [(ca.dot(ca.DM(normal), off), -slack, slack) for normal in reach.normals.T]
