"""The functions that a local search calls: values, slopes and curvature of a nonlinear program at a point."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from posture_opt.selection.program.nlp import Nlp
from posture_opt.selection.search.quadratic_model import INFINITE_BOUND


class Derivatives(NamedTuple):
    """Functions of the variables x (n,) and the parameters p of a nonlinear program with m rows.

    Values are a tenth of the work of the rest: a step that is refused costs no more than they do.

    Args:
        values: ``(x, p) -> objective, rows (m,), their lower and upper ends (m,)``, these finite.
        slopes: ``(x, p) -> gradient (n,) of the objective, Jacobian (m, n) of the rows``.
        curvature: ``(x, p, λ (m,)) -> Hessian (n, n) of the objective and λ times the rows``.
    """

    values: ca.Function
    slopes: ca.Function
    curvature: ca.Function

    @classmethod
    def of(cls, nlp: Nlp) -> Derivatives:
        """The functions of a nonlinear program."""
        x, p, m = nlp.x, nlp.p, len(nlp.rows)
        # Before differentiation: what is alike in a program is alike in its derivatives, which are ten times as long.
        f, g = ca.cse([nlp.objective, nlp.g])
        low, high = ([getattr(row, end) for row in nlp.rows] for end in ("lower", "upper"))
        ends = ca.fmax(_column(low), -INFINITE_BOUND), ca.fmin(_column(high), INFINITE_BOUND)
        weights = ca.SX.sym("weights", m)
        slopes = ca.gradient(f, x), ca.jacobian(g, x)
        hessian = ca.hessian(f + ca.dot(weights, g), x)[0]
        return cls(
            ca.Function("values", [x, p], _dense(f, g, *ends)),
            ca.Function("slopes", [x, p], _dense(*slopes)),
            ca.Function("curvature", [x, p, weights], _dense(hessian)),
        )


def _column(entries: list[ca.SX]) -> ca.SX:
    """Entries (m,) in one column, also where there are none."""
    return ca.vertcat(*entries) if entries else ca.SX(0, 1)


def _dense(*outputs: ca.SX) -> list[ca.SX]:
    """Expressions as the outputs of a function, with what is structurally zero."""
    return [ca.densify(ca.SX(output)) for output in outputs]
