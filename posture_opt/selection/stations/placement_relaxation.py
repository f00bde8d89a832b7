"""How far outside of its range a workpiece must go for all of its features to be possible; how it must be turned.

Placements beyond the range are tried at random; from the nearest one at which every feature can be done the way back
to the range is searched, and then the neighbourhood of what was found, so that the move reported suffices and is nearly
the least.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from posture_opt.collision.mounting import base_frame
from posture_opt.numerics import Array
from posture_opt.selection.answer.placement import PlacementRange
from posture_opt.selection.stations.placed_stations import PlacedStations

_PLACEMENTS_BEYOND = 96  # placements beyond the range, towards the base and anywhere
_PLACEMENTS_ALONG = 12  # of the way back
_BESIDE = 0.1  # of the reach: so far from the way to the base
_MAX_ROUNDS = 3
_STARTS_PER_PLACEMENT = 8


def nearest_feasible(stations: PlacedStations, seed: int) -> Array | None:
    """(4,) a placement outside of the range, yaw within it, at which every feature can be done; None if none was seen.

    The smallest shift [m] that was found.
    """
    rng, box = np.random.default_rng(seed), stations.placement
    reach = stations.engines[0].optimisation_problem.reach
    far = np.append(np.full(3, reach.radius), 0.0)
    share = rng.random((_PLACEMENTS_BEYOND, 1)) ** 2  # more of them near the range
    inside = box.lower + rng.random((_PLACEMENTS_BEYOND, 4)) * (box.upper - box.lower)
    anywhere = inside + share * rng.uniform(-1, 1, (_PLACEMENTS_BEYOND, 4)) * far
    # What is out of reach is reached on the way to the base, at its own height or nearly so.
    foot = np.append(base_frame(stations.engines[0].robot)[0][:2], inside[0, 2:])
    nearer = inside + np.linspace(0, 1, _PLACEMENTS_BEYOND)[:, None] * (foot - inside) * [1, 1, 0, 0]
    nearer += _BESIDE * rng.uniform(-1, 1, (_PLACEMENTS_BEYOND, 4)) * far
    return _led_back(stations, np.vstack([nearer, anywhere]), rng)


def turned_feasible(stations: PlacedStations, seed: int) -> Array | None:
    """(4,) a placement in the range of x, y and z, with any yaw, at which every feature can be done, turned least."""
    rng, box = np.random.default_rng(seed), stations.placement
    if box.all_round:
        return None
    tried = box.lower + rng.random((_PLACEMENTS_BEYOND, 4)) * (box.upper - box.lower)
    tried[:, 3] = box.centre[3] + rng.uniform(-math.pi, math.pi, _PLACEMENTS_BEYOND)
    return _led_back(stations, tried, rng)


def outside(box: PlacementRange, W: Array) -> Array:
    """(M,) how far placements lie outside of a range, a radian counted as a metre."""
    return np.asarray(np.linalg.norm(W - np.clip(W, box.lower, box.upper), axis=1))


def _led_back(stations: PlacedStations, W: Array, rng: np.random.Generator) -> Array | None:
    """The placement (4,) nearest to the range, from tried ones W (M, 4), at which all can be done; None if none."""
    box = stations.placement
    # Whether all can be done does not depend on the errors that they share.
    anywhere = replace(stations, placement=PlacementRange(np.full(4, -np.inf), np.full(4, np.inf)), shared=None)
    best: Array | None = None
    known: Array | None = None
    for _ in range(2 * _MAX_ROUNDS + 1):
        found = anywhere.best(anywhere.in_plane(W), _STARTS_PER_PLACEMENT, rng, known)
        feasible = np.flatnonzero((found.gap == 0).all(axis=1))
        if len(feasible):
            nearest = feasible[np.argmin(outside(box, found.W[feasible]))]
            if best is None or outside(box, found.W[nearest][None])[0] < outside(box, best[None])[0]:
                best, known = found.W[nearest], found.Q[nearest][None]
        if best is None:
            return None
        # In turn: the way back to the range, and what lies about the best.
        edge = np.clip(best, box.lower, box.upper)
        away = outside(box, best[None])[0]
        if away < 1e-6:
            return best
        along = np.linspace(0, 1, _PLACEMENTS_ALONG, endpoint=False)[:, None]
        about = rng.uniform(-1, 1, (2 * _PLACEMENTS_ALONG, 4)) * np.where(
            best == edge, 0.3 * (box.upper - box.lower), away / 3
        )
        W = np.vstack([edge + along * (best - edge), np.clip(best + about, edge - away, edge + away)])
    return best
