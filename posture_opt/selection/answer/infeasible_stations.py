"""Why several stations of one task are not feasible: the one that lacks most, and changes that do for all of them.

A change of one requirement is sought for every station that fails, each from the compromise of the one next to it; what
is offered is the loosest value that any of them needs, and the whole task is solved with it first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.robot.posture import Posture
from posture_opt.selection.answer.changes import ATTEMPTS, Attempt, Changes
from posture_opt.selection.answer.infeasible import (
    MAX_OFFERED,
    Explanation,
    Infeasibility,
    first_that_does,
    limited,
    specific,
    words_of,
)
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.change import Change
from posture_opt.selection.search.elastic_problem import TARGET, Compromise
from posture_opt.selection.search.relaxation import Reason, Relaxation, plane_reason

_MAX_STATIONS = 40  # that fail and are asked, spread evenly


@dataclass(frozen=True)
class _SharedWay:
    """Requirements that give at every station that fails, with the compromise of each; ``worst`` is the costliest."""

    names: tuple[str, ...]
    ways: tuple[Compromise, ...]

    @property
    def worst(self) -> int:
        return int(np.argmax([way.cost for way in self.ways]))

    @property
    def cost(self) -> float:
        return max(way.cost for way in self.ways)


def explain_stations(inquiry: Infeasibility, targets: Sequence[TaskTarget], names: Sequence[str]) -> Explanation:
    """The reasons at the station that lacks most, with its name, and what makes all of them possible.

    Args:
        inquiry: into the failure at one of the stations, which decides what may give; ``does`` solves the whole task.
        targets: of the stations that fail, in their order, with their ``names``.
    """
    reach = inquiry.problem.reach
    outside = [
        (reason, name) for target, name in zip(targets, names, strict=True) if (reason := plane_reason(reach, target))
    ]
    if outside:
        reason, name = max(outside, key=lambda pair: pair[0].amount)
        return Explanation(inquiry.nearest, (replace(reason, message=f"{name}: {reason.message}"),))
    chosen = np.unique(np.linspace(0, len(targets) - 1, min(_MAX_STATIONS, len(targets))).round().astype(int)).tolist()
    targets, names = [targets[k] for k in chosen], [names[k] for k in chosen]
    start = min(range(len(targets)), key=lambda k: float(np.linalg.norm(targets[k].lower - inquiry.target.lower)))
    ways = [_shared(inquiry, own, targets, start) for own in inquiry.ways() if not own[1].met]
    shared = [way for way in ways if way is not None]
    if not shared:
        return Explanation(inquiry.nearest)
    cell = inquiry.elastic.cell
    changing = [way for way in shared if not {*way.names} & {TARGET, *cell.movable}]
    own = [way for way in shared if not {*way.names} & {*cell.movable}] or shared
    chief = max(own, key=lambda way: (specific(way.names), -way.cost))
    reasons = _reasons(inquiry, chief, targets, names)
    offered: list[Relaxation] = []
    inquiry = replace(inquiry, does=limited(inquiry.does))
    for way in sorted(changing, key=lambda way: way.cost):
        if len(offered) < MAX_OFFERED and (found := _relaxation(inquiry, way, targets, names)) is not None:
            offered.append(found)
    return Explanation(chief.ways[chief.worst].q, reasons, tuple(offered))


def _shared(
    inquiry: Infeasibility,
    own: tuple[tuple[str, ...], Compromise],
    targets: Sequence[TaskTarget],
    start: int,
) -> _SharedWay | None:
    """The least that the same requirements must give at every station, from one of them outwards; None where one of
    them cannot be done so.
    """
    names, first = own
    found: dict[int, Compromise] = {}
    for order in (range(start, len(targets)), range(start - 1, -1, -1)):
        near = first
        for k in order:
            starts = np.array([near.q, first.q, *inquiry.postures_near(targets[k])])
            way = inquiry.elastic.least(targets[k].parameters, names, starts)
            if way is None:
                return None
            found[k] = near = way
    return _SharedWay(names, tuple(found[k] for k in range(len(targets))))


def _reasons(
    inquiry: Infeasibility, way: _SharedWay, targets: Sequence[TaskTarget], names: Sequence[str]
) -> tuple[Reason, ...]:
    """What is missed at the station that lacks most."""
    worst = way.worst
    at = replace(inquiry, found=replace(inquiry.found, target=targets[worst]))
    found = at.reasons(way.names, way.ways[worst])
    return tuple(replace(reason, message=f"{names[worst]}: {reason.message}") for reason in found)


def _relaxation(
    inquiry: Infeasibility, way: _SharedWay, targets: Sequence[TaskTarget], names: Sequence[str]
) -> Relaxation | None:
    """The loosest of the changes that the stations need, with the first digits that do."""
    written = (_changes(inquiry, way, targets, attempt) for attempt in ATTEMPTS if not attempt.digits)
    changes = first_that_does(written, lambda changes: inquiry.does(changes, way.ways[way.worst].q))
    if changes is None:
        return None
    reasons, posture = _reasons(inquiry, way, targets, names), Posture(inquiry.problem.robot, way.ways[way.worst].q)
    return Relaxation(words_of(changes), reasons, posture, way.cost, changes)


def _changes(
    inquiry: Infeasibility, way: _SharedWay, targets: Sequence[TaskTarget], attempt: Attempt
) -> tuple[Change, ...]:
    """What to change for all stations: at each key the loosest value that any of them needs."""
    assert inquiry.asked is not None
    assert inquiry.asked.task is not None
    task, loosest = inquiry.asked.task, dict[str, Change]()
    requirements = inquiry.elastic.requirements
    for target, one in zip(targets, way.ways, strict=True):
        given = [name for name in way.names if one.lacking[requirements.index(name)] > 0]
        changes = Changes(inquiry.problem, task, inquiry.elastic, target, one, attempt).of(given)
        if given and not changes:
            return ()
        for change in changes:
            before = loosest.get(change.path)
            loosest[change.path] = change if before is None else before.with_room_for(change)
    return tuple(loosest.values())
