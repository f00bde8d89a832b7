"""``StepGraph``: the best way through candidate postures, one of each point, by dynamic programming (Bellman 1957)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.numerics import Array, Codes, Mask
from posture_opt.selection.paths.joint_steps import JointSteps

_COST_TOLERANCE = 1 + 1e-9  # what is as good as the best


@dataclass(frozen=True)
class StepGraph:
    """Candidates of K points and the steps between them.

    Args:
        postures: K arrays (N_k, n); costs: K arrays (N_k,).
        parts: (K − 1,) into how many steps the step between two listed points is divided there; steps count so many
            times.
    """

    steps: JointSteps
    postures: Sequence[Array]
    costs: Sequence[Array]
    parts: Codes

    @cached_property
    def distances(self) -> list[Array]:
        """K − 1 arrays (N_k, N_{k+1}): the step between listed points that steps like this one add up to."""
        pairs = zip(self.postures, self.postures[1:], self.parts.tolist(), strict=False)
        return [m * self.steps.between(A, B) for A, B, m in pairs]

    def smallest_step(self) -> tuple[float, Codes]:
        """The least possible largest step on the way, and the candidates (K,) of such a way."""
        value, before = np.zeros(len(self.postures[0])), []
        for D in self.distances:
            reached = np.maximum(value[:, None], D)
            before.append(np.argmin(reached, axis=0))
            value = reached[before[-1], np.arange(D.shape[1])]
        return float(np.min(value)), _followed(before, int(np.argmin(value)))

    def worst_costs(self, largest: float) -> Array:
        """(N,) of the candidates of all points: the least possible largest cost of a way through each of them.

        No step is larger than ``largest``; infinite where there is no such way.
        """
        forth = self._largest_costs(self.costs, [largest * _COST_TOLERANCE >= D for D in self.distances])
        back = self._largest_costs(
            self.costs[::-1], [(largest * _COST_TOLERANCE >= D).T for D in self.distances[::-1]]
        )[::-1]
        return np.concatenate([np.maximum(f, b) for f, b in zip(forth, back, strict=True)])

    @staticmethod
    def _largest_costs(costs: Sequence[Array], allowed: Sequence[Mask]) -> list[Array]:
        """K arrays (N_k,): the least possible largest cost up to each candidate."""
        values = [costs[0]]
        for cost, may in zip(costs[1:], allowed, strict=True):
            before = np.min(np.where(may, values[-1][:, None], np.inf), axis=0, initial=np.inf)
            values.append(np.maximum(cost, before))
        return values

    def best_way(self, largest: float, worst: float, through: tuple[int, int] | None = None) -> Codes | None:
        """The candidates (K,) of least total cost, none costing more than ``worst``; None where there is no way.

        Args:
            largest: step that is allowed.
            through: point and candidate of it that the way has to pass.
        """
        costs = [np.where(cost <= worst * _COST_TOLERANCE, cost, np.inf) for cost in self.costs]
        if through is not None:
            point, chosen = through
            costs[point] = np.where(np.arange(len(costs[point])) == chosen, costs[point], np.inf)
        value, before = costs[0], []
        for D, cost in zip(self.distances, costs[1:], strict=True):
            total = np.where(largest * _COST_TOLERANCE >= D, value[:, None], np.inf)
            before.append(np.argmin(total, axis=0))
            value = total[before[-1], np.arange(D.shape[1])] + cost
        return _followed(before, int(np.argmin(value))) if np.isfinite(np.min(value)) else None

    def motion(self, way: Codes) -> Array:
        """(K, n) the postures of a way."""
        return np.array([Q[k] for Q, k in zip(self.postures, way, strict=True)])


def _followed(before: Sequence[Codes], last: int) -> Codes:
    """The way (K,) that ends at candidate ``last``, from the best predecessors of each."""
    way = [last]
    for back in reversed(before):
        way.append(int(back[way[-1]]))
    return np.array(way[::-1])
