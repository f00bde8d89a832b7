"""``SearchOutcome``: the feasible postures that one search found, and what of them keeps clear of collisions.

Rows that keep the arm clear make each step of a search several times dearer, and most of the time the best posture is
clear without them. So the search is made without: if the best of all postures is clear, it is the best of those that
are. Only otherwise the search is made again with the rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.collision.contact_slack import ContactSlack
from posture_opt.collision.scene import Scene
from posture_opt.numerics import Array, Mask
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.multistart import MultistartResult, Sampled, as_good, rank
from posture_opt.selection.search.search_statistics import Sweep

Seek = Callable[[Engine], tuple[MultistartResult, Sweep | None]]
"""A search with the functions of one engine."""
Keeper = Scene | ContactSlack
"""What says by how much postures keep the distances that are asked for."""
DISTANCE_ROUNDING = 1e-9  # m: rounding of a distance


@dataclass(frozen=True)
class SearchOutcome:
    """What random starts and a sweep led to.

    Args:
        found: the global search; ``swept`` the sweep, None where the problem allows none.
        by_starts, by_sweep: feasible postures that each led to.
    """

    engine: Engine
    found: MultistartResult
    swept: Sweep | None
    by_starts: tuple[CandidatePosture, ...]
    by_sweep: tuple[CandidatePosture, ...]

    @classmethod
    def of(cls, engine: Engine, found: MultistartResult, swept: Sweep | None) -> SearchOutcome:
        """The feasible postures of a search, the best one of its sweep improved."""
        by_sweep = () if swept is None else (engine.polished(swept.best, found.target),)
        return cls(engine, found, swept, tuple(c for c in found.found if c.feasible), by_sweep)

    @cached_property
    def feasible(self) -> list[CandidatePosture]:
        """All of them, best first."""
        return sorted(self.by_starts + self.by_sweep, key=rank)

    def clear_of(self, scene: Keeper) -> SearchOutcome | None:
        """The outcome without what collides; None where nothing that is clear is as good as the best of all."""
        by_starts, by_sweep = (clear_ones(group, scene) for group in (self.by_starts, self.by_sweep))
        left = sorted(by_starts + by_sweep, key=rank)
        if not left or left[0].objective > as_good(self.feasible[0].objective):
            return None
        sampled = self.found.sampled
        clear = is_clear(scene, sampled.Q)
        others = tuple(c for c in self.found.found if not c.feasible)
        kept = Sampled(sampled.robot, sampled.Q[clear], sampled.sigma[clear])
        found = replace(self.found, found=by_starts + others, sampled=kept)
        return replace(self, found=found, by_starts=by_starts, by_sweep=by_sweep)


def searched(seek: Seek, free: Engine, guarded: Callable[[], Engine], scene: Keeper) -> SearchOutcome:
    """The outcome of a search among postures that are clear of collisions.

    Args:
        seek: the search, run once or, where its best posture collides, twice.
        free: the engine without rows that keep the arm clear; ``guarded`` makes the one with them.
        scene: exact distances, which decide.
    """
    outcome = SearchOutcome.of(free, *seek(free))
    if not scene.active or not outcome.feasible:
        return outcome
    clear = outcome.clear_of(scene)
    if clear is not None:
        return clear
    engine = guarded()
    return SearchOutcome.of(engine, *seek(engine))


def clear_ones(candidates: tuple[CandidatePosture, ...], scene: Keeper) -> tuple[CandidatePosture, ...]:
    """Those that keep the distance that is asked for, by exact distances."""
    if not candidates:
        return ()
    clear = is_clear(scene, np.array([candidate.q for candidate in candidates]))
    return tuple(candidate for candidate, yes in zip(candidates, clear, strict=True) if yes)


def is_clear(scene: Keeper, Q: Array) -> Mask:
    """Whether the postures Q (N, n) [rad or m] keep the distance that is asked for, (N,).

    By exact distances between all bodies, up to a rounding of 1e-9 m.
    """
    if not len(Q):
        return np.zeros(0, dtype=bool)
    return np.asarray(scene.slack(Q) >= -DISTANCE_ROUNDING)
