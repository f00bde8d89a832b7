"""``confirmed_cells``: the targets of a map that reports name, after the solver of the problem was started there."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from posture_opt.collision.scene import Scene
from posture_opt.selection.maps.map_candidate import MapCandidate
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.confirmation import Confirmation, joined_confirmation
from posture_opt.selection.search.confirmed_posture import confirmed
from posture_opt.selection.search.engine import CandidatePosture, Engine


def confirmed_cells(
    engine_of: Callable[[TaskTarget, bool], Engine],
    targets: Sequence[TaskTarget],
    candidates: Sequence[MapCandidate],
    named: Iterable[int],
    scene: Scene,
) -> tuple[dict[int, MapCandidate], Confirmation | None]:
    """The better candidates that the solver found, by number, and what it says of all that were asked about.

    Args:
        engine_of: the functions that solve a target, without or with rows that keep the arm clear.
        targets, candidates: N of the map.
        named: the numbers of those that reports name.
        scene: what the arm keeps clear of.
    """
    better: dict[int, MapCandidate] = {}
    every: list[Confirmation | None] = []
    for k in dict.fromkeys(named):
        given = candidates[k]
        if given.best is None:
            continue
        best, said = _confirmed(engine_of, replace(targets[k], scale=given.scale), given.best, scene)
        every.append(said)
        if said is not None and said.taken:
            better[k] = replace(given, best=best)
    return better, joined_confirmation(every)


def _confirmed(
    engine_of: Callable[[TaskTarget, bool], Engine], target: TaskTarget, given: CandidatePosture, scene: Scene
) -> tuple[CandidatePosture, Confirmation | None]:
    """One of them; with rows that keep the arm clear where the solver goes elsewhere without."""
    (best, *_), said = confirmed(engine_of(target, False), [given], target, scene)
    if said is not None and said.differs and not said.taken and scene.active:
        (best, *_), said = confirmed(engine_of(target, True), [given], target, scene)
    return best, said
