"""``StationErrors``: the errors at one station, those that all stations share and those drawn anew at each.

By symbols they enter the joint program, by numbers the comparison of postures; both are one expression.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array, DerivedAgain
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.uncertainty.moments.pose_covariance import covariance_root
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.spread.shared_draws import ErrorParts

_NODES = 16  # of the quadrature over a circle
_LEAST_SCATTER = 0.15  # of the clearance: narrower scatter is neither smooth in the draws nor seen by the nodes


@dataclass(frozen=True, eq=False)
class StationErrors(DerivedAgain):
    """The errors of the tool point in the m directions that count, over the clearance.

    Args:
        sources: whose constant part, of r errors, is one draw for all stations.
    """

    problem: OptimisationProblem
    sources: Sources

    @cached_property
    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Bias (m, 1), shift (m, r) by independent standard normals that stay, and whole covariance (m, m)."""
        at = self.problem.quantities
        C, bias = at.projected(at.within)
        shared = at.bases[at.within].T @ self._columns @ ca.DM(self._root)
        return bias / at.clearance, shared / at.clearance, C / at.clearance**2

    @cached_property
    def _columns(self) -> ca.SX:
        """(3, k) shift of the tool point by one unit of each source [m per SI unit], world."""
        at = self.problem.quantities
        point, q = at.tool_point, ca.vertsplit(at.q)
        J = ca.SX(point.jacobian(at.walk))
        return J if point.linear is None else ca.horzcat(J, ca.SX(point.linear_columns(q, at.walk)))

    @cached_property
    def _root(self) -> Array:
        """(k, r) root of the covariance of the errors that stay."""
        point, sources = self.problem.tool_point, self.sources
        names = point.names if point.linear is None else (*point.names, *point.linear.names)
        index = {name: k for k, name in enumerate(sources.names)}
        known = [i for i, name in enumerate(names) if name in index and sources.constant[index[name], index[name]] > 0]
        rows = [index[names[i]] for i in known]
        root = np.zeros((len(names), len(known)))
        root[known] = covariance_root(sources.constant[np.ix_(rows, rows)])
        return root

    @cached_property
    def _numbers(self) -> BatchFunction:
        """Postures (N, n) and parameters (N, p) to the flat symbols; interpreted, as there are thousands at most."""
        nlp = self.problem.nlp
        flat = ca.vertcat(*(ca.vec(part) for part in self.symbols))
        return BatchFunction(ca.Function("station_errors", [nlp.x, nlp.p], [ca.densify(flat)]), compiled=False)

    def at(self, Q: Array, parameters: Array) -> ErrorParts:
        """The parts at postures Q (N, n), each at its target of ``parameters`` (N, p)."""
        (m, r), flat = self.symbols[1].shape, self._numbers(Q, parameters)
        bias, shared, C = np.split(flat, [m, m + m * r], axis=1)
        return ErrorParts.of(bias, shared.reshape(-1, r, m).swapaxes(1, 2), C.reshape(-1, m, m))

    def success(self, delta: Array) -> ca.Function:
        """``(x, p) -> (N, 1)``, the probability given each of the draws ``delta`` (N, r), smooth in both.

        Scatter counts as at least `_LEAST_SCATTER` of the clearance in every direction.
        """
        nlp, (bias, shared, C) = self.problem.nlp, self.symbols
        m, r = shared.shape
        b, A, S = ca.SX.sym("b", m), ca.SX.sym("A", m, r), ca.SX.sym("S", m, m)
        mean = ca.repmat(b, 1, len(delta)) + A @ ca.DM(delta.T)
        conditional = ca.Function("given_draws", [b, A, S], [_within(mean, S).T])
        scatter = C - shared @ shared.T + _LEAST_SCATTER**2 * ca.SX.eye(m)
        parts = ca.Function("parts", [nlp.x, nlp.p], [ca.densify(v) for v in (bias, shared, scatter)])
        x, p = ca.MX.sym("x", nlp.x.shape[0]), ca.MX.sym("p", nlp.p.shape[0])
        return ca.Function("success", [x, p], [conditional(*parts(x, p))])


def _within(mean: ca.SX, covariance: ca.SX) -> ca.SX:
    """(1, N) the probability that Gaussian points of this covariance (m, m) and means (m, N) lie in the unit circle.

    ``∫ φ(x) [Φ((h − μ)/σ) − Φ((−h − μ)/σ)] dx`` along the first axis, ``x = sin θ``, ``h = cos θ``, with mean μ and
    standard deviation σ of the second coordinate given the first.
    """
    s = ca.sqrt(covariance[0, 0])
    if mean.shape[0] == 1:
        return _between(1.0, mean, s)
    slope = covariance[1, 0] / covariance[0, 0]
    sigma = ca.sqrt(covariance[1, 1] - slope * covariance[1, 0])
    total = ca.SX(1, mean.shape[1])
    for node, weight in zip(*np.polynomial.legendre.leggauss(_NODES), strict=True):
        x, h = math.sin(node * math.pi / 2), math.cos(node * math.pi / 2)
        away = x - mean[0, :]
        density = ca.exp(-((away / s) ** 2) / 2) / (math.sqrt(2 * math.pi) * s)
        total += weight * math.pi / 2 * h * density * _between(h, mean[1, :] + slope * away, sigma)
    return total


def _between(half: float, mu: ca.SX, sigma: ca.SX) -> ca.SX:
    """The probability that Gaussian numbers of means ``mu`` lie between -half and half."""
    root = math.sqrt(2) * sigma
    return (ca.erf((half - mu) / root) + ca.erf((half + mu) / root)) / 2
