"""``Measurements``: what was commanded and what was measured, row by row, in SI units and radians."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.measurements.kinds import Kind, PointContact, Pose, Position, Seen
from posture_opt.measurements.kinds.kind import Vector
from posture_opt.measurements.readings.better_reading import BetterReading
from posture_opt.model.arm import Arm
from posture_opt.model.chain import factor_values, stack, walk
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.result import Summarised
from posture_opt.robot.robot import Robot
from posture_opt.statements import Statement, state

_POSITION, _POSE, _POINT = Position(), Pose(), PointContact()
_MIN_SESSION_ROWS = 20
"""Rows of a session with a clock of its own; fewer that are out of place for each time that a clock goes back were
sorted, or measured again."""
_REST_TOLERANCE_M = 1e-9
"""Motion below which a tool point is at rest; rounding of half turns at a reach of metres is 1e-15."""


@dataclass(frozen=True, eq=False, repr=False)
class Measurements(Summarised):
    """N measurements in the order in which they were made, in SI units and radians.

    Groups of rows are integer codes; the texts of the codes are in the tuples of names. Where the file has no
    ``pose`` column, rows with equal commands are one pose; without ``goal`` every pose is a goal of its own, and
    without ``target`` or ``robot`` all rows share one. Arrays are read-only.

    Args:
        joint_names: (n,) the joints, in the order of the columns of ``q``.
        q: (N, n) commanded joint values [rad or m].
        position: (N, 3) measured tool point [m], in the instrument's frame; ``None`` where something else was read.
        measured_axes: (3,) which coordinates were measured; the others hold the nominal model's value.
        rotation: (N, 4) measured orientation as unit quaternion (w, x, y, z) with w >= 0, or ``None``.
        pose, goal, target, robot, point: (N,) codes; ``point`` is the touched point, plane or anchor, and zero where
            ``position`` was measured.
        target_names, robot_names, point_names: the text of each code; empty without the column.
        approach: (N, n) +1 where the joint value was increasing on arrival, −1 where it was decreasing; 0
            where it is not known.
        approach_length: (N, n) the length of that last move [rad or m]; 0 in a robot's first row.
        payload: (N,) [kg], or ``None``.
        temperature: (N,) [degC], or ``None``.
        time: (N,) [s], or ``None``.
        reading: (N, D) what an instrument showed that measures no position [m, rad]; ``None`` where nothing is read.
        instrument: what was read; ``None``: positions, or touched points.
        second, second_names: (N,) codes and texts of a second column of names, as markers that cameras see.
        inverted: whether the file has poses of a board in a camera, and ``position`` those of the camera in the board.
        lever: (N,) length at the tool that one unit of ``reading`` is [m]; ``None`` where it is read in metres.
        visit: (N,) a number for each stay at a pose, where rows between were taken out; ``None``: as rows follow.
        line: (N,) the line of each row in ``file``; rows of a table in memory are counted from 1.
        file: its name; ``table`` for one in memory.
        pose_given, goal_given, approach_given: whether the file has such columns.
        joint_units: (n,) rad or m; empty where all joints turn.
        warnings: sentences on what looks wrong but can be used.
        notes: sentences on how the file was read.
        unmeasured: lines of rows of which nothing was measured, left out.
        turned_joints: whose values beyond their limits were read a turn nearer.
        better_reading: another reading of the columns that explains the rows far better; None where there is none.

    Example:
        >>> from posture_opt import load_problem, read_measurements
        >>> table = {"joint1 [deg]": [0, 10, 20], "joint2 [deg]": [30, 40, 50], "x [mm]": [1866, 1628, 1282],
        ...          "y [mm]": [500, 940, 1282]}
        >>> data = read_measurements(table, load_problem("insert_planar_2r"))
        >>> len(data), data.joint_names
        (3, ('joint1', 'joint2'))
    """

    joint_names: tuple[str, ...]
    q: Array
    position: Array | None
    measured_axes: Mask
    rotation: Array | None
    pose: Codes
    goal: Codes
    target: Codes
    robot: Codes
    point: Codes
    target_names: tuple[str, ...]
    robot_names: tuple[str, ...]
    point_names: tuple[str, ...]
    approach: Array
    approach_length: Array
    payload: Array | None
    temperature: Array | None
    time: Array | None
    line: Codes
    file: str = ""
    pose_given: bool = False
    goal_given: bool = False
    approach_given: bool = False
    joint_units: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    visit: Codes | None = None
    reading: Array | None = None
    instrument: Kind | None = None
    second: Codes | None = None
    second_names: tuple[str, ...] = ()
    lever: Array | None = None
    part: Codes | None = None
    inverted: bool = False
    better_reading: BetterReading | None = None
    turned_joints: tuple[str, ...] = ()
    unmeasured: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name in _FIELDS_BY_ROW:
            values = getattr(self, name)
            assert values is None or len(values) == len(self.q), f"{name} has a row for each measurement"
            if values is not None:
                values.setflags(write=False)

    def __len__(self) -> int:
        return len(self.q)

    @property
    def kind(self) -> Kind:
        """What the rows show of the pose of the tool."""
        return self.instrument or (_POINT if self.position is None else _POSITION if self.rotation is None else _POSE)

    @property
    def order(self) -> Codes:
        """(N,) the rows in the order in which they were made, see `measuring_order`."""
        return measuring_order(self.time, self.robot)

    @property
    def touches(self) -> bool:
        """Whether the rows touch fixed points and no instrument measured."""
        return self.kind.about_mean

    def seen(self, position: Vector, columns: Sequence[Vector] | Array, values: Array) -> Seen:
        """The rows beside where a model has the tool: point [m] and columns of R_world_tool, three of (N,) each.

        Args:
            values: (P, u) unknowns of the places.
        """
        own = values[self.point]
        if self.second is None:
            return Seen(position, columns, self._shown, self.point, own)
        own = own + values[self.kind.second_place(self.second)]
        part = np.zeros(0, dtype=np.intp) if self.part is None else self.part
        return Seen(position, columns, self._shown, self.point, own, self.second, part)

    @cached_property
    def _shown(self) -> Array:
        """(N, D) what the instrument showed: of a pose the tool point, then the quaternion."""
        if self.position is None:
            return np.zeros((len(self), 0)) if self.reading is None else self.reading
        return self.position if self.rotation is None else np.concatenate([self.position, self.rotation], axis=1)

    @property
    def weighed(self) -> tuple[Sequence[str], Codes]:
        """What may have a standard deviation of its own, as planes of another flatness, and which of it each row is."""
        return self.kind.weighed(self.point_names, self.point, self.part)

    @property
    def reading_statements(self) -> tuple[Statement, ...]:
        """How the columns were read, and how they might be."""
        better = () if self.better_reading is None else (self.better_reading.statement,)
        turned = [state("reading.modulo", joints=self.turned_joints)] if self.turned_joints else []
        rows = len(self.unmeasured)
        return (*better, *turned, *([state("reading.unmeasured", str(self.unmeasured[0]), rows=rows)] if rows else []))

    def without_orientation(self) -> Measurements:
        """The same rows as positions; they themselves where no orientation was measured."""
        return self if self.rotation is None else replace(self, rotation=None)

    @property
    def place_names(self) -> Sequence[str]:
        """(P,) all places of which something is unknown: planes, anchors, cameras and what they see."""
        return self.kind.places(self.point_names)

    def at_place(self, code: int) -> Mask:
        """(N,) the rows that belong to a place."""
        if self.second is None:
            return np.asarray(self.point == code)
        return np.asarray((self.point == code) | (self.kind.second_place(self.second) == code))

    def about_points(self, values: Array) -> Array:
        """Rows ``values`` (N, …) less their mean over all touches of the same point; as they are where none is touched.

        The place of a touched point is not known: errors there count from the mean of its touches.
        """
        return values - self.point_means(values) if self.touches else values

    def held_out_touches(self, values: Array) -> Array:
        """Rows ``values`` (N, …) about the mean of all touches of their point, times ``√(n / (n − 1))`` for n touches.

        A mean takes a share 1/n of each touch with it; with that factor the RMS of independent touches is theirs about
        the point itself. Of one touch alone nothing is known, and 0 is left.
        """
        if not self.touches:
            return values
        codes = np.unique(self.point, return_inverse=True)[1]
        n = np.bincount(codes)[codes].astype(float)
        scale = np.sqrt(n / np.maximum(n - 1, 1))
        return np.asarray(self.about_points(values) * scale.reshape(-1, *[1] * (values.ndim - 1)))

    def point_means(self, values: Array) -> Array:
        """(N, …) the mean of ``values`` (N, …) over all touches of the same point, for each row."""
        codes = np.unique(self.point, return_inverse=True)[1]
        return np.asarray(group_means(values, codes)[codes])

    def to_dataframe(self) -> Any:
        """A pandas ``DataFrame`` in SI units that ``read_measurements`` reads back to the last digit.

        Its index holds the lines of the file, its ``attrs`` the file.

        Raises:
            InputError: pandas is not installed.
        """
        return self._presenter.dataframe()

    def take(self, rows: object) -> Measurements:
        """The measurements of some rows; codes and names keep their meaning.

        Args:
            rows: (m,) indices or (N,) mask.
        """
        index = np.asarray(rows)
        chosen = {name: values[index] for name in _FIELDS_BY_ROW if (values := getattr(self, name)) is not None}
        return replace(self, **chosen)


def rows_back_in_time(time: Array, robots: Codes) -> Codes:
    """Rows whose time (N,) is before that of the row before of the same robot (N,)."""
    order = np.argsort(robots, kind="stable")
    earlier = (np.diff(time[order]) < 0) & (np.diff(robots[order]) == 0)
    return np.sort(order[1:][earlier])


def measuring_order(time: Array | None, robots: Codes) -> Codes:
    """(N,) the rows in the order in which they were made: by their times, robot by robot.

    In that of the file without times, or where the clock started anew: it goes back seldom then, and whole sessions
    overlap, of `_MIN_SESSION_ROWS` rows or more.

    Example:
        >>> measuring_order(np.array([0.0, 30.0, 10.0, 20.0]), np.zeros(4, dtype=int)).tolist()
        [0, 2, 3, 1]
    """
    rows = np.arange(len(robots))
    if time is None or not len(back := rows_back_in_time(time, robots)):
        return rows
    misplaced = sum(_misplaced(time[robots == robot]) for robot in np.unique(robots))
    return rows if misplaced > _MIN_SESSION_ROWS * len(back) else np.lexsort((rows, time, robots))


def _misplaced(time: Array) -> int:
    """How many rows would have to be moved for the times (N,) to rise: N less the longest rising subsequence."""
    ends: list[float] = []
    for t in time.tolist():
        place = bisect_right(ends, t)
        ends[place : place + 1] = [t]
    return len(time) - len(ends)


def group_means(values: Array, groups: Codes) -> Array:
    """(G, …) means of rows ``values`` (N, …) over each group, in the order of their codes.

    Args:
        values: (N, …).
        groups: (N,) codes, not necessarily without gaps.

    Example:
        >>> group_means(np.array([1.0, 3.0, 5.0]), np.array([0, 0, 7])).tolist()
        [2.0, 5.0]
    """
    _, codes, count = np.unique(groups, return_inverse=True, return_counts=True)
    sums = np.zeros((len(count), *values.shape[1:]))
    np.add.at(sums, codes, values)
    return np.asarray(sums / count.reshape(-1, *[1] * (values.ndim - 1)))


_FIELDS_OF_FILE = {
    "joint_names",
    "measured_axes",
    "target_names",
    "robot_names",
    "point_names",
    "second_names",
    "inverted",
    "better_reading",
    "turned_joints",
    "unmeasured",
    "file",
    "warnings",
    "joint_units",
    "notes",
    "instrument",
}
_FIELDS_BY_ROW = tuple(
    f.name for f in fields(Measurements) if f.name not in _FIELDS_OF_FILE and not f.name.endswith("_given")
)


def nominal_poses(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Tool point (N, 3) [m] and rotation (N, 3, 3) R_world_tool of postures (N, n) [rad or m], without effects."""
    reached = walk(robot.factors, factor_values(robot.factors, [np.ascontiguousarray(column) for column in q.T]))
    points = np.broadcast_to(stack(reached.position), (len(q), 3))
    rotations = np.broadcast_to(stack(list(zip(*reached.columns, strict=True))), (len(q), 3, 3))
    return np.asarray(points), np.asarray(rotations)


def reach_of(robot: Robot) -> Array:
    """(32, 3) tool points [m], world, at postures drawn at random within the limits, always the same ones."""
    q = np.random.default_rng(0).uniform(np.array(robot.lower), np.array(robot.upper), (32, robot.n))
    return nominal_poses(robot, q)[0]


def still_axes(robot: Robot) -> Mask:
    """(3,) along which world axes the tool point cannot be moved at will, as z of a planar arm.

    A planar arm that was found to be slightly skew leaves its plane by its errors only: that does not count.
    """
    points = reach_of(robot)
    # A planar arm that was found to be slightly skew leaves its plane by its flaws only.
    extent = np.ptp(points, axis=0)
    return np.asarray(extent < _REST_TOLERANCE_M + 2 * robot.skew * extent.max())


def carried_joint_values(arm: Arm, q: Array) -> Array:
    """(N, n) where the joints are at commands ``q`` (N, n), as far as others carry them along [rad or m]."""
    moved = q.copy()
    for joint, value in arm.carried(list(q.T)).items():
        moved[:, joint] += value
    return moved


def rows_of(codes: Codes) -> list[Codes]:
    """The rows (indices) of each code, in the order of the codes."""
    order = np.argsort(codes, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(codes[order])) + 1)


def outlying_groups(size: Array, freedom: Array) -> Mask:
    """(G,) postures whose repeats differ far more than the others explain: a slip or a wrong reading, no scatter.

    The scale is the median's, which these cannot move far. Gross is twice what Gaussian repeats reach once in a
    thousand sets of data; twice, because scatter is neither round nor the same at every posture.

    Args:
        size: (G,) sum of squares about the mean of each posture's repeats [m²].
        freedom: (G,) how many coordinates it sums, those of the mean taken off.
    """
    from scipy.special import chdtri

    if not len(freedom):
        return np.zeros(0, dtype=bool)
    scale = np.median(size / chdtri(freedom, 0.5))
    return np.asarray(size > 4 * scale * chdtri(freedom, 1e-3 / len(freedom)))
