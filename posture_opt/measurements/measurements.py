"""``Measurements``: what was commanded and what was measured, row by row, in SI units and radians."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.measurements.kinds import CameraPose, Kind, PointContact, Pose, Position, Seen
from posture_opt.measurements.kinds.kind import Vector
from posture_opt.model.arm import Arm
from posture_opt.model.arm_state import REFERENCE_TEMPERATURE, Inputs
from posture_opt.model.chain import factor_values, stack, walk
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.result import Summarised
from posture_opt.robot.robot import Robot
from posture_opt.statements import Quantity, Statement, state


@dataclass(frozen=True)
class ReadingWords:
    """One reading in words."""

    id: str  # of the statement, as ``reading.joint-zero``
    message: str  # what is assumed, after ``if``
    hint: str  # the line to paste, or what to write
    column: str  # that it speaks of


@dataclass(frozen=True)
class BetterReading:
    """The reading that explains the data to their noise, where the one given does not."""

    reading: ReadingWords  # what is read otherwise
    alike: Sequence[ReadingWords]  # others that explain the data as well
    left: tuple[float, float]  # median error of the positions as given, and so read [m]
    turned: tuple[float, float] | None  # of the orientations [rad]; None where none were measured
    usable: bool  # whether the data can be used as given

    @property
    def sentence(self) -> str:
        """What fits, and how well."""
        given, found = (f"{value * 1e3:.3g} mm" for value in self.left)
        said = f"the data fit the arm to {found}"
        if self.turned is not None:
            as_given, so_read = (f"{math.degrees(value):.3g} deg" for value in self.turned)
            said, given = f"{said} and {so_read}", f"{given} and {as_given}"
        return f"{said} if {self.reading.message}, as given only to {given}"

    @property
    def statement(self) -> Statement:
        """The reading as a caution, with the line to paste."""
        read, given = (Quantity(value) for value in (self.left[1], self.left[0]))
        assumed, hint = self.reading.message, self.reading.hint
        return state(self.reading.id, self.reading.column, assumed=assumed, hint=hint, read=read, given=given)


_POSITION, _POSE, _CAMERA, _POINT = Position(), Pose(), CameraPose(), PointContact()
SAME_POSTURE_RAD = 1e-3  # Commands that differ by less [rad] lead to one posture
# An arm does not stop, settle and get measured within a second: faster rows of other postures are of a moving arm
STOP_S = 1.0


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
        if self.instrument is not None or self.position is None:
            return self.instrument or _POINT
        return _POSITION if self.rotation is None else _CAMERA if self.inverted else _POSE

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
        found = [] if self.better_reading is None else [self.better_reading.statement]
        if self.turned_joints:
            found.append(state("reading.modulo", joints=self.turned_joints))
        if self.unmeasured:
            found.append(state("reading.unmeasured", str(self.unmeasured[0]), rows=len(self.unmeasured)))
        return tuple(found)

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
    """(N,) the rows in the order in which they were made: by their times, robot by robot."""
    rows = np.arange(len(robots))
    if time is None or not len(back := rows_back_in_time(time, robots)):
        return rows
    misplaced = sum(_misplaced(time[robots == robot]) for robot in np.unique(robots))
    # Sessions with a clock of their own have more than 20 rows: fewer out of place were sorted, or measured again.
    return rows if misplaced > 20 * len(back) else np.lexsort((rows, time, robots))


def _misplaced(time: Array) -> int:
    """How many rows would have to be moved for the times (N,) to rise: N less the longest rising subsequence."""
    ends: list[float] = []
    for t in time.tolist():
        place = bisect_right(ends, t)
        ends[place : place + 1] = [t]
    return len(time) - len(ends)


def joint_codes(*labels: Array | Codes) -> Codes:
    """(N,) codes of rows that agree in all labels, each (N,) or (N, k)."""
    return np.asarray(np.unique(np.column_stack(labels), axis=0, return_inverse=True)[1].ravel(), dtype=np.intp)


def group_means(values: Array, groups: Codes) -> Array:
    """(G, …) means of rows ``values`` (N, …) over each group, in the order of their codes."""
    # values: (N, …); groups: (N,) codes, not necessarily without gaps
    _, codes, count = np.unique(groups, return_inverse=True, return_counts=True)
    sums = np.zeros((len(count), *values.shape[1:]))
    np.add.at(sums, codes, values)
    return np.asarray(sums / count.reshape(-1, *[1] * (values.ndim - 1)))


# Arrays of integer codes or numbers have a value a row; `measured_axes` is a mask
_FIELDS_BY_ROW = tuple(f.name for f in fields(Measurements) if str(f.type).split(" ")[0] in ("Array", "Codes"))


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
    """(3,) along which world axes the tool point cannot be moved at will, as z of a planar arm."""
    points = reach_of(robot)
    # A planar arm that was found to be slightly skew leaves its plane by its flaws only.
    extent = np.ptp(points, axis=0)
    return np.asarray(extent < 1e-9 + 2 * robot.skew * extent.max())


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
    """(G,) postures whose repeats differ far more than the others explain: a slip or a wrong reading, no scatter."""
    # size: (G,) sum of squares about the mean of each posture's repeats [m²]; freedom: (G,) how many coordinates it
    # sums, those of the mean taken off
    from scipy.special import chdtri

    if not len(freedom):
        return np.zeros(0, dtype=bool)
    scale = np.median(size / chdtri(freedom, 0.5))
    return np.asarray(size > 4 * scale * chdtri(freedom, 1e-3 / len(freedom)))


def reach(robot: Robot) -> float:
    """The length of the stretched chain, slides at their longest [m]."""
    strokes = sum(max(abs(j.lower), abs(j.upper)) for j in robot.joints if j.type == "prismatic")
    return strokes + robot.length


def sample_rows(data: Measurements) -> Codes:
    """(m,) indices of rows of different poses, of the robot and the target that have most rows."""
    # Evenly spread, at most 400
    pairs = data.robot * (data.target.max(initial=0) + 1) + data.target
    chosen = np.flatnonzero(pairs == np.bincount(pairs).argmax())
    if not data.touches:
        _, first = np.unique(data.pose[chosen], return_index=True)
        chosen = chosen[np.sort(first)]
    step = np.unique(np.linspace(0, len(chosen) - 1, min(len(chosen), 400)).round().astype(np.intp))
    return np.asarray(chosen[step])


def moves(data: Measurements) -> bool:
    """Whether most rows of the file were read while the arm moved: their times say so."""
    if data.time is None or len(data) < 3 or np.ptp(data.time) <= 0:
        return False
    order = data.order
    step = np.abs(np.diff(data.q[order], axis=0)).max(axis=1)
    return bool(np.mean((step > SAME_POSTURE_RAD) & (np.diff(data.time[order]) < STOP_S)) > 0.5)


def joint_speeds(data: Measurements) -> Array:
    """(N, n) speed of the joints [rad/s or m/s] by central differences along each path."""
    assert data.time is not None, "the time of the rows is known"
    order, speeds = data.order, np.zeros(data.q.shape)
    steps = np.diff(data.time[order])
    # After five times the usual time from row to row, another path begins.
    for rows in np.split(order, np.flatnonzero(steps > 5 * max(float(np.mean(steps)), 1e-12)) + 1):
        if len(rows) > 2:
            speeds[rows] = np.gradient(data.q[rows], _even_times(data.time[rows]), axis=0)
    return speeds


def _even_times(time: Array) -> Array:
    """(N,) increasing times [s]: evenly spaced ones, where rounding explains how the logged ones differ from them."""
    rows = np.arange(len(time))
    even = np.polyval(np.polyfit(rows, time, 1), rows)
    if float(np.abs(even - time).max()) <= 1.5 * float(np.diff(np.unique(time)).min(initial=np.inf)):
        return np.asarray(even, dtype=float)
    least = 1e-3 * float(np.ptp(time)) / len(time)
    return np.asarray(np.maximum.accumulate(time) + least * rows)


def inputs_of(data: Measurements, robot: Robot) -> Inputs:
    """The inputs of effects in every row."""
    # Temperature above the reference [K], time since the first row [s] or row number
    n = len(data)
    return Inputs(
        speed=list(joint_speeds(data).T) if moves(data) else (),
        payload=data.payload if data.payload is not None else np.full(n, robot.payload),
        approach=list(data.approach.T),
        approach_length=list(data.approach_length.T),
        temperature=data.temperature - REFERENCE_TEMPERATURE if data.temperature is not None else np.zeros(n),
        time=data.time - data.time.min() if data.time is not None else np.arange(n, dtype=float),
    )


def arm_for(arm: Arm, data: Measurements) -> Arm:
    """The arm under the inputs of every row; all sides of approach count as stated."""
    return arm.under(replace(inputs_of(data, arm.robot), stated=data.joint_names))
