"""Thinning of large files: so many rows as a fit needs, evenly from the whole session, whole postures kept together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import repeat_of_row
from posture_opt.numerics import Array, Codes, Json, Mask

_MIN_ROWS_OF_POSTURE, _MAX_ROWS_OF_POSTURE = 3, 30
"""Rows of one posture: fewer say nothing of scatter, more say little else."""


@dataclass(frozen=True, eq=False)
class Thinning:
    """Which rows of a file are used, and which are left to judge by.

    The postures (or goals, where these are given), in the order in which they were first measured, are cut into blocks
    of equal length, and one posture of each is drawn at random: the whole session is covered, its drift too, and no
    period of the file can fall in step with the choice. All visits of a chosen posture come along, of many as many as
    are needed, evenly spread.

    Args:
        data: all rows.
        rows: (n,) indices of those that are used, in their order.
        postures, postures_used: how many there are, and how many of them are used.
        block: how many postures in a row are one block.
        blocks: (N,) the block of each row.
        most_of_posture: the most rows that one posture gives for each of its targets.
        seed: of the draw.
    """

    data: Measurements
    rows: Codes
    postures: int
    postures_used: int
    block: float
    blocks: Codes
    most_of_posture: int
    seed: int

    @property
    def used(self) -> Measurements:
        """The rows that are used; readings of two visits stay apart though what lay between them is gone."""
        whole = self.data if self.data.visit is not None else replace(self.data, visit=repeat_of_row(self.data))
        return whole.take(self.rows)

    @property
    def rest(self) -> Codes:
        """Indices of the rows that are left to judge by."""
        return np.setdiff1d(np.arange(len(self.data)), self.rows)

    @property
    def clocked(self) -> Measurements:
        """All rows, with the clock of those that are used: where no time is given, these are counted."""
        if self.data.time is not None:
            return self.data
        return replace(self.data, time=_row_clock(len(self.data), self.rows))

    def to_json(self) -> dict[str, Json]:
        """How the rows were chosen, in numbers."""
        return {
            "rows": len(self.data),
            "rows_used": len(self.rows),
            "rows_left_out": len(self.data) - len(self.rows),
            "postures": self.postures,
            "postures_used": self.postures_used,
            "postures_in_block": self.block,
            "most_rows_of_posture": self.most_of_posture,
            "seed": self.seed,
        }


def thin(data: Measurements, most: int, seed: int = 0) -> Thinning | None:
    """Some ``most`` rows of measurements, one posture out of each block of postures; None where they have no more.

    Args:
        data: all rows of one robot.
        most: how many rows a fit needs; the answer may have some more, as postures are kept whole.
        seed: of the draw; the same seed gives the same rows.
    """
    if len(data) <= most:
        return None
    unit = _thinning_units(data)
    first = np.unique(unit, return_index=True)[1]
    count = len(first)
    each = min(max(most // count, _MIN_ROWS_OF_POSTURE), _MAX_ROWS_OF_POSTURE)
    visit = _evenly_spread(
        np.unique(np.column_stack([unit, data.target]), axis=0, return_inverse=True)[1].ravel(), each
    )
    share = min(most / int(visit.sum()), 1.0)
    drawn, block_of_unit = _drawn_units(data.point[first], max(int(count * share), 1), seed)
    # The clock begins with the earliest row, so that its posture is among them.
    if data.time is not None:
        earliest = int(np.argmin(data.time))
        drawn[unit[earliest]] = visit[earliest] = True
    rows = np.flatnonzero(visit & drawn[unit])
    block = count / (int(block_of_unit.max()) + 1)
    return Thinning(data, rows, count, int(drawn.sum()), block, block_of_unit[unit], each, seed)


def thin_each_robot(data: Measurements, most: int) -> Measurements:
    """Some ``most`` rows of measurements of several robots, as many of each; all where they have no more.

    Args:
        data: all rows of all robots.
        most: rows of all robots together.
    """
    if len(data) <= most:
        return data
    share, visit = max(most // len(data.robot_names), 1), repeat_of_row(data)
    whole, kept = replace(data, visit=visit), []
    for code in range(len(data.robot_names)):
        mine = np.flatnonzero(data.robot == code)
        thinning = thin(whole.take(mine), share)
        kept.append(mine if thinning is None else mine[thinning.rows])
    return whole.take(np.sort(np.concatenate(kept)))


def _thinning_units(data: Measurements) -> Codes:
    """(N,) what stays together, numbered in the order of its first row."""
    labels = data.goal if data.goal_given else data.pose
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    place = np.empty(len(first), dtype=np.intp)
    place[np.argsort(first, kind="stable")] = np.arange(len(first))
    return np.asarray(place[inverse.ravel()], dtype=np.intp)


def _evenly_spread(codes: Codes, most: int) -> Mask:
    """(N,) whether a row is one of at most ``most`` of its code, evenly spread over all of them."""
    order = np.argsort(codes, kind="stable")
    counts = np.bincount(codes)
    start = np.cumsum(counts) - counts
    rank, size = np.arange(len(codes)) - np.repeat(start, counts), np.repeat(counts, counts)
    chosen = np.zeros(len(codes), dtype=bool)
    # Row k of n is one of m where the staircase k m / n makes a step.
    chosen[order] = (size <= most) | ((rank + 1) * most // size > rank * most // size)
    return chosen


def _drawn_units(points: Codes, count: int, seed: int) -> tuple[Mask, Codes]:
    """Which units (U,) are drawn, one out of each of so many blocks, and the block (U,) of each.

    Units that touch one point lie together, so that all points come in; each gives one at least.

    Args:
        points: (U,) code of the touched point of each unit; all equal where none is touched.
        count: of blocks.
        seed: of the draw.
    """
    order = np.argsort(points, kind="stable")
    edges = np.linspace(0, len(points), count + 1).astype(int)
    within = np.random.default_rng(seed).random(count) * np.diff(edges)
    drawn = np.zeros(len(points), dtype=bool)
    drawn[order[edges[:-1] + within.astype(int)]] = True
    drawn[np.unique(points, return_index=True)[1]] |= not np.all(points == points[0])
    blocks = np.empty(len(points), dtype=np.intp)
    blocks[order] = np.repeat(np.arange(count), np.diff(edges))
    return drawn, blocks


def _row_clock(count: int, rows: Codes) -> Array:
    """(N,) the number of the last used row at each row, between them in proportion."""
    return np.asarray(np.interp(np.arange(count), rows, np.arange(len(rows))))
