"""``StepGraph``: the best way through candidate postures, one of each point, by dynamic programming (Bellman 1957)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array, Codes, Mask
from posture_opt.selection.paths.joint_steps import JointSteps

_COST_TOLERANCE = 1 + 1e-9  # what is as good as the best
_MAX_CLOSED_STARTS = 24  # candidates of the first point that ways are tried to come back to, the most promising first


@dataclass(frozen=True)
class StepGraph:
    """Candidates of K points and the steps between them.

    Args:
        postures: K arrays (N_k, n); costs: K arrays (N_k,).
        distances: K − 1 arrays (N_k, N_{k+1}): the weighted steps between candidates of neighbours.
    """

    postures: Sequence[Array]
    costs: Sequence[Array]
    distances: Sequence[Array]

    @classmethod
    def of(cls, steps: JointSteps, postures: Sequence[Array], costs: Sequence[Array], weights: Array) -> StepGraph:
        """The graph of some candidates.

        Args:
            weights: (K − 1, n) by which the steps of each joint count.
        """
        pairs = zip(postures, postures[1:], weights, strict=False)
        return cls(postures, costs, [steps.between(A, B, w) for A, B, w in pairs])

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

    def closed_at(self, start: int) -> StepGraph:
        """The ways that begin and end at candidate ``start`` of the first point, which is that of the last one too."""
        postures, costs, distances = list(self.postures), list(self.costs), list(self.distances)
        for end in (0, -1):
            postures[end], costs[end] = postures[end][[start]], costs[end][[start]]
        distances[0] = distances[0][[start]]
        distances[-1] = distances[-1][:, [start]]
        return StepGraph(postures, costs, distances)

    def closed_of_smallest_step(self) -> StepGraph:
        """The ways that come back to the candidate at which the least possible largest step of a closed way is found.

        The candidates of the last point are those of the first one. Ways that need not close bound from below what each
        start can have.
        """
        bound = np.zeros(len(self.postures[-1]))
        for D in reversed(self.distances):
            bound = np.min(np.maximum(D, bound), axis=1)
        found = (np.inf, self)
        for start in self._promising(bound):
            if bound[start] >= found[0]:
                break
            ways = self.closed_at(start)
            step = ways.smallest_step()[0]
            if step < found[0]:
                found = step, ways
        return found[1]

    def closed_of_least_cost(self, largest: float) -> StepGraph | None:
        """The ways that come back to the candidate with the least possible largest cost of a closed way.

        None where no way with steps up to ``largest`` comes back.
        """
        bound = self.worst_costs(largest)[: len(self.postures[0])]
        least, best = np.inf, None
        for start in self._promising(bound):
            if bound[start] >= least:
                break
            ways = self.closed_at(start)
            worst = float(np.min(ways.worst_costs(largest)))
            if worst < least:
                least, best = worst, ways
        return best

    @staticmethod
    def _promising(bound: Array) -> list[int]:
        """The candidates of the first point that closed ways are looked for at, the least bound first."""
        order: list[int] = np.argsort(bound, kind="stable")[:_MAX_CLOSED_STARTS].tolist()
        return order


def _followed(before: Sequence[Codes], last: int) -> Codes:
    """The way (K,) that ends at candidate ``last``, from the best predecessors of each."""
    way = [last]
    for back in reversed(before):
        way.append(int(back[way[-1]]))
    return np.array(way[::-1])
