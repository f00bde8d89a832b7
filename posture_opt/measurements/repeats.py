"""What repeats: rows at one posture and target, measured again after the arm had moved away."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from posture_opt.measurements.measurements import Measurements, group_means, outlying_groups, rows_of
from posture_opt.numerics import Array, Codes, Mask, linked
from posture_opt.robot.robot import Robot

SAME_POSTURE_RAD = 1e-3
"""Commands that differ by less [rad] lead to one posture."""
_SAME_POSTURE_M = 1e-4
"""The same of a slide [m]."""
_MAX_PAIRED_ROWS = 20_000
"""Rows up to which all pairs are compared."""
MIN_FREEDOM = 12
"""Degrees of freedom from which a standard deviation is used: it is then known to a fifth."""
_COPY_TOLERANCE_M = 1e-9
"""Readings that agree to less are one reading written twice."""
_CODE_SEPARATION = 1e6
"""Distance of rows whose codes differ, in units of `SAME_POSTURE_RAD`."""


def repeat_groups(data: Measurements, slides: Mask) -> Codes:
    """(N,) a code for each row: rows of one code repeat one posture with one target.

    Rows of one pose do, and so do rows whose joint values agree within 1 mrad or 0.1 mm: joint values that were
    read back never agree to the last digit. Rows strung out along a slow path are no repeats.

    Args:
        slides: (n,) which joints are prismatic.
    """
    posture = np.column_stack(
        [
            data.q / np.where(slides, _SAME_POSTURE_M, SAME_POSTURE_RAD),
            data.target * _CODE_SEPARATION,
            data.robot * _CODE_SEPARATION,
        ]
    )
    n, code = len(data), linked(posture, 1.0) if len(data) <= _MAX_PAIRED_ROWS else _linked_cells(posture)
    own = np.unique(np.column_stack([data.pose, data.target, data.robot]), axis=0, return_inverse=True)[1].ravel()
    strung = np.array([np.ptp(posture[rows], axis=0).max() > 1.0 for rows in rows_of(code)])
    merged = np.where(strung[code], own + n, code)
    # A pose keeps together whatever its joint values were.
    first = np.full(own.max() + 1, -1)
    first[own[::-1]] = merged[::-1]
    return np.asarray(np.unique(first[own], return_inverse=True)[1], dtype=np.intp)


def repeats_of_one_kind(data: Measurements, slides: Mask, sided: Codes | None = None) -> Codes:
    """(N,) the same as `repeat_groups`, of rows that carry the same payload and arrive from the same sides.

    Args:
        sided: indices of the joints whose stated side of approach matters; none by default.
    """
    alike: list[Array | Codes] = [repeat_groups(data, slides)]
    alike += [] if data.payload is None else [data.payload]
    alike += [data.approach[:, joint] for joint in (() if sided is None or not data.approach_given else sided)]
    return np.asarray(np.unique(np.column_stack(alike), axis=0, return_inverse=True)[1].ravel(), dtype=np.intp)


def repeated_readings(data: Measurements, robot: Robot) -> tuple[float, int]:
    """Standard deviation of a coordinate between readings of one posture [m], and its degrees of freedom; 0, 0 without.

    ``s² = Σ |x − mean|² / Σ d (n_g − 1)`` over groups of n_g readings of d coordinates. It holds the instrument's noise
    and what the arm changes from repeat to repeat. Postures whose readings differ far more than those of the others are
    left out.
    """
    if data.position is None:
        return 0.0, 0
    points = data.position[:, data.measured_axes]
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])
    groups = [points[rows] for rows in rows_of(repeats_of_one_kind(data, slides)) if len(rows) > 1]
    size = np.array([np.sum((p - p.mean(axis=0)) ** 2) for p in groups])
    freedom = np.array([points.shape[1] * (len(p) - 1) for p in groups], dtype=float)
    used = size > freedom * _COPY_TOLERANCE_M**2
    size, freedom = size[used], freedom[used]
    kept = ~outlying_groups(size, freedom)
    total = int(freedom[kept].sum())
    return (float(np.sqrt(size[kept].sum() / total)), total) if total else (0.0, 0)


def _linked_cells(posture: Array) -> Codes:
    """(N,) the same of many rows (N, d), with rows of one cell of side 1 by their mean.

    n readings of one posture have n² / 2 pairs, which would fill the memory.
    """
    _, cell = np.unique(np.floor(posture), axis=0, return_inverse=True)
    cell = cell.ravel()
    return np.asarray(linked(group_means(posture, cell), 1.0)[cell], dtype=np.intp)


def apart(data: Measurements) -> Measurements:
    """The same rows, where the arm left its posture between rows that follow each other with one target.

    Rows of several targets that follow each other belong to one stay, up to where a target is measured again.
    """
    return replace(data, visit=_stay_of_row(data))


def _stay_of_row(data: Measurements) -> Codes:
    """(N,) the stay of each row, were the arm to leave its posture before each further row of a target."""
    repeat = repeat_of_row(data)
    return np.unique(np.column_stack([repeat, _reading_of_row(data, repeat)]), axis=0, return_inverse=True)[1].ravel()


def _reading_of_row(data: Measurements, repeat: Codes) -> Codes:
    """(N,) how many rows of the same target and repeat (N,) come before each."""
    found = np.zeros(len(data), dtype=np.intp)
    for rows in rows_of(np.unique(np.column_stack([repeat, data.target]), axis=0, return_inverse=True)[1].ravel()):
        found[rows] = np.arange(len(rows))
    return found


def repeat_of_row(data: Measurements) -> Codes:
    """(N,) the repeat of each row, counted from 0: rows that follow each other at one pose, whatever their target.

    The arm has not moved between them, so that one draw of the joints' scatter is in all of them. Stated sides of
    approach and visits separate repeats too.
    """
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

    Args:
        cell: (N,) the repeat and group of each row, groups in their order and within them repeats in time.
        group: (cells,) the group of each cell.
        order: (cells,) how many cells of its group come before.
        shared: (C,) contrasts of one code share one draw of the joints' scatter: those of several targets do.
    """

    cell: Codes
    group: Codes
    order: Codes
    shared: Codes

    @classmethod
    def of(cls, data: Measurements, slides: Mask, sided: Codes | None = None) -> Contrasts:
        """All contrasts of measurements, as `repeats_of_one_kind`; none of touched points, whose place is not known."""
        groups = np.arange(len(data)) if data.position is None else repeats_of_one_kind(data, slides, sided)
        pairs, cell = np.unique(np.column_stack([groups, repeat_of_row(data)]), axis=0, return_inverse=True)
        group, repeat = pairs.T
        first = np.searchsorted(group, group)
        order = np.arange(len(group)) - first
        return cls(cell.ravel(), group, order, np.unique(repeat[order > 0], return_inverse=True)[1])

    @classmethod
    def of_readings(cls, data: Measurements) -> Contrasts:
        """The contrasts of rows of one posture and target that follow each other; none of touched points.

        Whether the arm left the posture in between is not known: they scatter by the instrument, and by the joints if
        it did.
        """
        repeat = np.arange(len(data)) if data.position is None else repeat_of_row(data)
        stay = repeat if data.position is None else _stay_of_row(data)
        place = np.unique(np.column_stack([repeat, data.target, data.robot]), axis=0, return_inverse=True)[1].ravel()
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
        own, before, k = self._cell_parts(values)
        return np.asarray(np.sqrt(k / (k + 1)) * (before / k - own))

    def means(self, values: Array) -> Array:
        """(C, …) means of the rows' values (N, …) over the repeats that a contrast is of."""
        own, before, k = self._cell_parts(values)
        return np.asarray((before + own) / (k + 1))

    @property
    def reading(self) -> Array:
        """(C,) variance of a contrast of rows of independent variance 1."""
        one = 1.0 / np.bincount(self.cell)
        own, before, k = self._contrast_parts(one)
        return np.asarray((before / k**2 + own) * k / (k + 1))

    def _cell_parts(self, values: Array) -> tuple[Array, Array, Array]:
        """Of every cell but the first of its group: mean of its rows (N, …), sum of the means before, and how many
        these are.
        """
        return self._contrast_parts(group_means(values, self.cell))

    def _contrast_parts(self, cells: Array) -> tuple[Array, Array, Array]:
        """Of every cell but the first of its group: its value, the sum of those before, and how many these are."""
        total = np.concatenate([np.zeros((1, *cells.shape[1:])), np.cumsum(cells, axis=0)])
        at = np.flatnonzero(self.order > 0)
        k = self.order[at].astype(float).reshape(-1, *[1] * (cells.ndim - 1))
        return cells[at], total[at] - total[at - self.order[at]], k
