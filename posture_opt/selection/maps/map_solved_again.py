"""Which cells of a map are solved again: at the edge of the reach, a share of all, and outliers among neighbours.

Cells whose best posture collides are solved again by :mod:`posture_opt.selection.maps.map_collisions`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from posture_opt.selection.maps.map_candidate import MapCandidate
from posture_opt.selection.maps.map_exchange import NeighbourExchange
from posture_opt.selection.maps.map_neighbours import Neighbourhood

OUTLIER_EXCESS = 2e-3  # of the objective: a target so much above what its neighbours predict is an outlier
MAX_OUTLIER_SHARE = 0.03  # of the targets: how many of them are searched again


def outlying_targets(exchange: NeighbourExchange, searched: set[int]) -> list[int]:
    """Targets that are worse than their neighbours predict, the worst first, as many as are still worth a search.

    At most 3 % of the targets in all, half of what is left of them in each round.
    """
    excess = exchange.excess()
    left = math.ceil(MAX_OUTLIER_SHARE * len(excess)) - len(searched)
    odd = [int(k) for k in np.argsort(-excess, kind="stable") if excess[k] > OUTLIER_EXCESS and int(k) not in searched]
    return odd[: min(max(left, 0), math.ceil(left / 2))]


def targets_to_search_again(
    candidates: Sequence[MapCandidate], neighbourhood: Neighbourhood, share: float, seed: int
) -> list[int]:
    """A share of the targets, from which rare branches spread; and all that few random starts arrive at.

    These are where reach begins or ends, and where no start met the requirements. Where no start reached any target,
    all of them.
    """
    reached = np.array([candidate.status != "not reached" for candidate in candidates])
    if not reached.any():
        return list(range(len(candidates)))
    chosen = reached & (np.random.default_rng(seed).random(len(candidates)) < share)
    chosen |= np.array([candidate.status == "requirement not met" for candidate in candidates])
    for here, there in neighbourhood.on_grid:
        chosen[here[reached[here] != reached[there]]] = True
    return [int(k) for k in np.flatnonzero(chosen)]
