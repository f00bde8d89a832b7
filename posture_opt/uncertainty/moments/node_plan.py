"""Few nodes for shared factors, the same at every posture: for symbols, generated code and many postures at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.robot import Factor
from posture_opt.uncertainty.moments.conditional_moments import Segment
from posture_opt.uncertainty.moments.gaussian_rules import degree_five, degree_three, product_rule
from posture_opt.uncertainty.moments.integration import SharedSpan, polynomial, spans
from posture_opt.uncertainty.moments.shared_factors import SharedFactors

_MAX_FACTORS, _MANY_FACTORS = 3, 6
"""Factors with nodes, and how many shared factors leave nodes to one alone."""
_NODES_PER_RADIAN = 3.0
"""Nodes more of a factor alone for each radian by which it turns the tool."""


@dataclass(frozen=True, eq=False)
class NodePlan:
    """Nodes for some of the shared factors, while the others move the tool point along straight lines.

    What the others add, ``J L Lᵀ Jᵀ``, is positive semidefinite too.

    Args:
        segments: of the factors with nodes.
        straight: (k, r) loadings L of the others.
    """

    segments: tuple[Segment, ...]
    straight: Array

    @property
    def count(self) -> int:
        """How many walks along a segment there are, of means and covariances together."""
        return sum(s.centre.count + (s.width.count if s.width is not s.centre else 0) for s in self.segments)

    @classmethod
    def few(cls, split: SharedFactors, indices: Sequence[int], factors: Sequence[Factor], most: int = 0) -> NodePlan:
        """Complete to fourth order in σ in the ``most`` factors with the largest turn of every span.

        Unless stated these are three, but one where there are more than six, as there are after a calibration: errors
        are small then, and a graph of many factors would be large.

        The mean, whose covariance counts, is taken at nodes of degree 5, and the covariance, which the factors change
        at the second order of σ only, at nodes of degree 3: 5 walks for one factor, 11 for two, 19 for three. A factor
        alone has more nodes where it turns the tool far.

        Args:
            split: the covariance of the sources as independent errors and shared factors.
            indices: (k,) place in the chain of every source.
            factors: the chain.
            most: factors with nodes in each span; 0 for the usual number.
        """
        most = most or (_MAX_FACTORS if split.count <= _MANY_FACTORS else 1)
        kept = [column for span in spans(split, indices, factors) for column in sorted(span.columns)[:most]]
        chosen = SharedFactors(split.own, split.loadings[:, kept])
        segments = tuple(_fourth_order(span) for span in spans(chosen, indices, factors))
        return cls(segments, np.delete(split.loadings, kept, axis=1))

    @classmethod
    def at_level(cls, split: SharedFactors, spans: Sequence[SharedSpan], level: int) -> NodePlan | None:
        """The nodes of one refinement of `integration.converged`, None where they are too many."""
        rules = [polynomial(span, level) for span in spans]
        segments = [span.segment(rule) for span, rule in zip(spans, rules, strict=True) if rule is not None]
        return cls(tuple(segments), split.loadings[:, :0]) if len(segments) == len(spans) else None


def _fourth_order(span: SharedSpan) -> Segment:
    """The segment of a span whose moments are complete to fourth order in σ."""
    if not span.turning.any():
        return span.segment(degree_three(span.count))  # what shifts alone, shifts linearly
    if span.count > 1:
        return span.segment(degree_five(span.count), degree_three(span.count))
    more = round(_NODES_PER_RADIAN * float(np.abs(span.turning).sum()))
    return span.segment(product_rule((3 + more,)), product_rule((2 + more,)))
