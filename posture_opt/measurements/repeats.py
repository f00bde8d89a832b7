"""What repeats: rows at one posture, and thinning of large files by whole postures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from posture_opt.encoding import Encoded
from posture_opt.measurements.measurements import (
    SAME_POSTURE_RAD,
    Measurements,
    group_means,
    joint_codes,
    moves,
    outlying_groups,
    rows_of,
)
from posture_opt.numerics import Array, Codes, Mask, linked
from posture_opt.robot.robot import Robot

MIN_FREEDOM = 12  # Degrees of freedom from which a standard deviation is used: it is then known to a fifth


def repeat_groups(data: Measurements, slides: Mask) -> Codes:
    """(N,) a code for each row: rows of one code repeat one posture with one target."""
    # slides: (n,) which joints are prismatic
    scaled = data.q / np.where(slides, 1e-4, SAME_POSTURE_RAD)  # of a slide 0.1 mm
    posture = np.column_stack([scaled, data.target * 1e6, data.robot * 1e6])  # other codes are far apart
    # n readings of one posture have n² / 2 pairs, which would fill the memory: of many, cells of side 1 are linked.
    cell = np.arange(len(data)) if len(data) <= 20_000 else joint_codes(np.floor(posture))
    n, code = len(data), linked(posture if len(data) <= 20_000 else group_means(posture, cell), 1.0)[cell]
    own = joint_codes(data.pose, data.target, data.robot)
    strung = np.array([np.ptp(posture[rows], axis=0).max() > 1.0 for rows in rows_of(code)])
    merged = np.where(strung[code], own + n, code)
    # A pose keeps together whatever its joint values were.
    first = np.full(own.max() + 1, -1)
    first[own[::-1]] = merged[::-1]
    return np.asarray(np.unique(first[own], return_inverse=True)[1], dtype=np.intp)


def repeats_of_one_kind(data: Measurements, slides: Mask, sided: Codes | None = None) -> Codes:
    """(N,) the same as `repeat_groups`, of rows that carry the same payload and arrive from the same sides."""
    alike: list[Array | Codes] = [repeat_groups(data, slides)]
    alike += [] if data.payload is None else [data.payload]
    alike += [] if sided is None or not data.approach_given else [data.approach[:, sided]]
    return joint_codes(*alike)


def repeated_readings(data: Measurements, robot: Robot) -> tuple[float, int]:
    """Standard deviation of a coordinate between readings of one posture [m], and degrees of freedom; or 0, 0."""
    # ``s² = Σ |x − mean|² / Σ d (n_g − 1)`` over groups of n_g readings of d coordinates. It holds the instrument's
    # noise and what the arm changes from repeat to repeat. Postures whose readings differ far more than those of the
    # others are left out.
    if data.position is None:
        return 0.0, 0
    points = data.position[:, data.measured_axes]
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])
    groups = [points[rows] for rows in rows_of(repeats_of_one_kind(data, slides)) if len(rows) > 1]
    size = np.array([np.sum((p - p.mean(axis=0)) ** 2) for p in groups])
    freedom = np.array([points.shape[1] * (len(p) - 1) for p in groups], dtype=float)
    used = size > freedom * 1e-9**2  # readings that agree to a nanometre are one reading written twice
    size, freedom = size[used], freedom[used]
    kept = ~outlying_groups(size, freedom)
    total = int(freedom[kept].sum())
    return (float(np.sqrt(size[kept].sum() / total)), total) if total else (0.0, 0)


def apart(data: Measurements) -> Measurements:
    """The same rows, where the arm left its posture between rows that follow each other with one target."""
    return replace(data, visit=_stay_of_row(data))


def _stay_of_row(data: Measurements) -> Codes:
    """(N,) the stay of each row, were the arm to leave its posture before each further row of a target."""
    repeat, before = repeat_of_row(data), np.zeros(len(data), dtype=np.intp)
    for rows in rows_of(joint_codes(repeat, data.target)):
        before[rows] = np.arange(len(rows))  # how many rows of this target and repeat come before
    return joint_codes(repeat, before)


def repeat_of_row(data: Measurements) -> Codes:
    """(N,) the repeat of each row, counted from 0: rows that follow each other at one pose, whatever their target."""
    sides = data.approach if data.approach_given else np.zeros((len(data), 0))
    visits = [] if data.visit is None else [data.visit]
    place = np.column_stack([data.pose, data.robot, *visits, sides])
    return np.asarray(np.cumsum(np.any(np.diff(place, axis=0, prepend=place[:1]) != 0, axis=1)), dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Contrasts:
    """Differences between the repeats of one posture and target: all that repeats say of scatter.

    The means of V repeats have V − 1 orthonormal contrasts (Helmert's): the k-th is the mean of the first k less the
    next one, times ``√(k / (k + 1))``. Where a model errs alike at every repeat, nothing of that is left in them.
    Readings of one repeat, which the arm may not have left in between, count by their mean. Repeats carry the same
    payload; where the side of a joint matters, they arrive from the same one (ISO 9283:1998, 7.2: repeatability is that
    of one direction).
    """

    cell: Codes  # (N,) the repeat and group of each row, groups in their order and within them repeats in time
    group: Codes  # (cells,) the group of each cell
    order: Codes  # (cells,) how many cells of its group come before
    shared: Codes  # (C,) contrasts of one code share one draw of the joints' scatter: those of several targets do

    @classmethod
    def of(cls, data: Measurements, slides: Mask, sided: Codes | None = None) -> Contrasts:
        groups = np.arange(len(data)) if data.position is None else repeats_of_one_kind(data, slides, sided)
        pairs, cell = np.unique(np.column_stack([groups, repeat_of_row(data)]), axis=0, return_inverse=True)
        group, repeat = pairs.T
        first = np.searchsorted(group, group)
        order = np.arange(len(group)) - first
        return cls(cell.ravel(), group, order, np.unique(repeat[order > 0], return_inverse=True)[1])

    @classmethod
    def of_readings(cls, data: Measurements) -> Contrasts:
        """The contrasts of rows of one posture and target that follow each other; none of touched points."""
        repeat = np.arange(len(data)) if data.position is None else repeat_of_row(data)
        stay = repeat if data.position is None else _stay_of_row(data)
        place = joint_codes(repeat, data.target, data.robot)
        rows = np.argsort(place, kind="stable")
        group, cell = place[rows], np.empty(len(rows), dtype=np.intp)
        cell[rows] = np.arange(len(rows))
        order = np.arange(len(rows)) - np.searchsorted(group, group)
        return cls(cell, group, order, np.unique(stay[rows][order > 0], return_inverse=True)[1])

    def __len__(self) -> int:
        """Number of contrasts C."""
        return len(self.shared)

    def differences(self, values: Array) -> Array:
        """(C, …) contrasts of the rows' values (N, …)."""
        own, before, k = self._parts(group_means(values, self.cell))
        return np.asarray(np.sqrt(k / (k + 1)) * (before / k - own))

    def means(self, values: Array) -> Array:
        """(C, …) means of the rows' values (N, …) over the repeats that a contrast is of."""
        own, before, k = self._parts(group_means(values, self.cell))
        return np.asarray((before + own) / (k + 1))

    @property
    def reading(self) -> Array:
        """(C,) variance of a contrast of rows of independent variance 1."""
        own, before, k = self._parts(1.0 / np.bincount(self.cell))
        return np.asarray((before / k**2 + own) * k / (k + 1))

    def _parts(self, cells: Array) -> tuple[Array, Array, Array]:
        """Of every cell but the first of its group: its value (…), the sum of those before, and how many these are."""
        total = np.concatenate([np.zeros((1, *cells.shape[1:])), np.cumsum(cells, axis=0)])
        at = np.flatnonzero(self.order > 0)
        k = self.order[at].astype(float).reshape(-1, *[1] * (cells.ndim - 1))
        return cells[at], total[at] - total[at - self.order[at]], k


@dataclass(frozen=True, eq=False)
class Thinning(
    Encoded,
    json="rows=data.line.size rows_used=rows.size rows_left_out=rest.size postures postures_used "
    "postures_in_block=block most_rows_of_posture=most_of_posture seed",
):
    """Which rows of a file are used, and which are left to judge by."""

    data: Measurements  # all rows
    rows: Codes  # (n,) indices of those that are used, in their order
    # postures, postures_used: how many there are, and how many of them are used
    postures: int
    postures_used: int
    block: float  # how many postures in a row are one block
    blocks: Codes  # (N,) the block of each row
    most_of_posture: int  # the most rows that one posture gives for each of its targets
    seed: int  # of the draw

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
        clock = np.interp(np.arange(len(self.data)), self.rows, np.arange(len(self.rows)))  # proportional in between
        return replace(self.data, time=np.asarray(clock))


def thin(data: Measurements, most: int, seed: int = 0) -> Thinning | None:
    """Some ``most`` rows of measurements, one posture out of each block of postures; None where they have no more."""
    if len(data) <= most:
        return None
    # What stays together, numbered in the order of its first row
    unit = joint_codes(data.goal if data.goal_given else data.pose)
    first = np.unique(unit, return_index=True)[1]
    unit, first = np.argsort(np.argsort(first))[unit], np.sort(first)
    count = len(first)
    each = min(max(most // count, 3), 30)  # fewer rows of a posture say nothing of scatter, more say little else
    visit = _evenly_spread(joint_codes(unit, data.target), each)
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
    """Some ``most`` rows of measurements of several robots, as many of each; all where they have no more."""
    if len(data) <= most:
        return data
    share, visit = max(most // len(data.robot_names), 1), repeat_of_row(data)
    whole, kept = replace(data, visit=visit), []
    for code in range(len(data.robot_names)):
        mine = np.flatnonzero(data.robot == code)
        thinning = thin(whole.take(mine), share)
        kept.append(mine if thinning is None else mine[thinning.rows])
    return whole.take(np.sort(np.concatenate(kept)))


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
    """Which units (U,) are drawn, one out of each of so many blocks, and the block (U,) of each."""
    # points: (U,) code of the touched point of each unit; all equal where none is touched
    order = np.argsort(points, kind="stable")
    edges = np.linspace(0, len(points), count + 1).astype(int)
    within = np.random.default_rng(seed).random(count) * np.diff(edges)
    drawn = np.zeros(len(points), dtype=bool)
    drawn[order[edges[:-1] + within.astype(int)]] = True
    drawn[np.unique(points, return_index=True)[1]] |= not np.all(points == points[0])
    blocks = np.empty(len(points), dtype=np.intp)
    blocks[order] = np.repeat(np.arange(count), np.diff(edges))
    return drawn, blocks


def on_a_path(data: Measurements) -> bool:
    """Whether the rows follow each other along a path: their times say so, or without times steps that are small.

    Steps of a tenth of the usual distance of two rows: of the paths that were simulated 0.06, and of static real sets,
    grids among them, 0.14 and more.
    """
    if data.time is not None or len(data) < 50:
        return moves(data)
    rng = np.random.default_rng(0)
    q = data.q[data.order]
    one, other = q[rng.integers(0, len(q), (2, 2000))]
    near, far = (np.abs(steps).max(axis=1) for steps in (np.diff(q, axis=0), one - other))
    moved = near > SAME_POSTURE_RAD
    return bool(moved.mean() > 0.5 and np.median(near[moved]) < 0.1 * np.median(far))
