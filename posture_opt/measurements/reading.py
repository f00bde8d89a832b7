"""Measurements from a CSV file or a table in memory, checked against the robot of a problem."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from posture_opt.errors import InputError, Issue, did_you_mean, listed
from posture_opt.limits import MOST_PLACES, MOST_ROBOTS
from posture_opt.measurements.columns import (
    AXES,
    Cells,
    Column,
    check_inputs,
    columns_of_kinds,
    read_cells,
    without_unmeasured,
)
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.header import column_kinds, read_header
from posture_opt.measurements.kinds import KINDS
from posture_opt.measurements.measurements import (
    Measurements,
    measuring_order,
    nominal_poses,
    rows_back_in_time,
    still_axes,
)
from posture_opt.measurements.mixing import no_board_poses, with_instrument
from posture_opt.measurements.orientation_columns import OrientationColumns, joint_turns, orientation_of
from posture_opt.measurements.plausibility import HasData, plausibility_checks
from posture_opt.measurements.repeats import apart
from posture_opt.measurements.rotations import inverted_poses
from posture_opt.measurements.table import Faults, TableLike, open_table
from posture_opt.numerics import TURN, Array, Codes
from posture_opt.robot.robot import Robot


def read_measurements(source: TableLike, problem: HasData) -> Measurements:
    """The measurements in a CSV file, a pandas DataFrame or a mapping from column header to values.

    Column headers carry their unit: ``joint1 [deg], joint2 [deg], x [mm], y [mm], z [mm]``; other headers, decimal
    marks and units are stated in the section ``data`` of the problem. Commas, semicolons, tabs or blanks separate the
    columns, lines that begin with ``#``, ``%`` or ``//`` are comments. Values that look like another unit, swapped
    columns or a mirrored frame are guessed and reported, never converted.

    Args:
        source: the path, or the table.
        problem: names ``arm``, ``robot``, ``data`` and ``measurement``.

    Returns:
        ``Measurements``: all rows in SI units and radians, in the order of the file.

    Raises:
        InputError: everything wrong with the file, each with line, column and a hint.

    Example:
        >>> from posture_opt import load_problem
        >>> table = {"joint1 [deg]": [0, 90], "joint2 [deg]": [0, 0], "x [mm]": [2000, 0], "y [mm]": [0, 2000]}
        >>> read_measurements(table, load_problem("insert_planar_2r")).position.tolist()
        [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0]]
    """
    table = open_table(source, column_kinds(problem.robot, problem.data), problem.data)
    faults = table.faults
    columns, left_out = read_header(table.titles, problem.robot, table.line, faults, problem.data)
    joints, unmeasured = problem.robot.joint_names, list[int]()
    own = columns_of_kinds(problem.data) - {*joints, *AXES} | {*AXES}
    blocks = without_unmeasured(table.blocks, columns, own, unmeasured)
    cells = read_cells(blocks, columns.values(), faults, problem.data, joints)
    if not cells.line.size and not faults.count:
        faults.stop("there is no row behind the header", "add one row for each measurement", table.line)
    faults.refuse()
    places = dict.fromkeys(("target", *(kind.label for kind in KINDS if kind.label)), MOST_PLACES)
    for name, limit in {"robot": MOST_ROBOTS, **places}.items():
        count = len(cells.code(name)[1])
        if count > limit.most:
            faults.add(limit.message(count), name, count, limit.hint)
    faults.refuse()
    turned = orientation_of(cells, columns, problem.robot, problem.data, faults)
    data = _assemble_rows(cells, columns, problem, turned, faults)
    faults.refuse()
    data = _as_stated(data, problem, "instrument" in cells.codes)
    data = with_instrument(data, cells, problem, faults)
    faults.refuse()
    notes, better = plausibility_checks(data, problem, columns, turned, faults)
    faults.refuse()
    restarted, in_time = _clock_notes(data)
    data = apart(data) if problem.data.repeats == "visits" else data
    notes += [*restarted, *_repeated_rows(data), *_moved_poses(data), *_idle_distances(data, problem.data)]
    unused = (f"columns of the file that are not used: {listed(left_out)}",) if left_out else ()
    notes_of_file = (*data.notes, *table.notes, *in_time, *unused)
    return replace(
        data, warnings=tuple(notes), notes=notes_of_file, better_reading=better, unmeasured=tuple(unmeasured)
    )


def _assemble_rows(
    cells: Cells, columns: dict[str, Column], problem: HasData, turned: OrientationColumns | None, faults: Faults
) -> Measurements:
    line, robot = cells.line, problem.robot
    turns = joint_turns(cells, columns, robot, problem.data, faults)
    faults.refuse()
    q = np.column_stack([turns[n] if n in turns else cells.present(n) for n in robot.joint_names])
    q, turned_joints = _as_counted(q, robot, problem.data)
    _check_limits(q, robot, columns, line, faults)
    check_inputs(cells, robot, faults)
    mixed = "instrument" in columns
    labels = [] if mixed else [name for kind in KINDS for name in (kind.label,) if name in cells.codes]
    seconds = [] if mixed else [name for kind in KINDS for name in (kind.second_label,) if name in cells.codes]
    pose = cells.code("pose")[0] if "pose" in columns else _codes_of_rows(q)
    goal = cells.code("goal")[0] if "goal" in columns else pose.copy()
    targets, robots = cells.code("target"), cells.code("robot")
    points, second = cells.code(next(iter(labels), "")), cells.code(next(iter(seconds), ""))
    measured = np.array([axis in columns for axis in AXES])
    order = measuring_order(cells.number("time"), robots[0])
    side, length, given = _approach_sides(cells, q, robots[0], robot, order)
    return Measurements(
        joint_names=robot.joint_names,
        q=q,
        position=_measured_position(cells, q, robot, faults) if measured.any() and not mixed else None,
        measured_axes=measured,
        rotation=None if turned is None else turned.quaternions(),
        pose=pose,
        goal=goal,
        target=targets[0],
        robot=robots[0],
        point=points[0],
        target_names=targets[1],
        robot_names=robots[1],
        point_names=points[1],
        second=second[0] if second[1] else None,
        second_names=second[1],
        approach=side,
        approach_length=length,
        payload=cells.number("payload"),
        temperature=cells.number("temperature"),
        time=cells.number("time"),
        visit=_visits(pose, robots[0], order),
        line=line,
        file=faults.file,
        pose_given="pose" in columns,
        goal_given="goal" in columns,
        approach_given=given,
        joint_units=tuple(joint.unit for joint in robot.joints),
        turned_joints=turned_joints,
    )


def _as_counted(q: Array, robot: Robot, spec: DataSpec) -> tuple[Array, tuple[str, ...]]:
    """(N, n) joint values by the stated signs and zeros, and by limits that tell the turn; which joints were turned."""
    q, turned_joints = q.copy(), []
    for i, joint in enumerate(robot.joints):
        zero = spec.joint_zeros.get(joint.name)
        q[:, i] = spec.joint_signs.get(joint.name, 1) * (q[:, i] - (zero.value if zero else 0.0))
        if joint.type != "revolute" or joint.upper - joint.lower >= TURN:
            continue
        least, most = joint.lower - 1e-3, joint.upper + 1e-3  # rounding, and what an arm stops beyond a limit
        turned = q[:, i] + TURN * ((q[:, i] < least).astype(float) - (q[:, i] > most))
        if np.all((turned >= least) & (turned <= most)) and np.any(turned != q[:, i]):
            q[:, i] = turned
            turned_joints.append(joint.name)
    return q, tuple(turned_joints)


def _as_stated(data: Measurements, problem: HasData, mixed: bool) -> Measurements:
    """Poses in the direction that the file states, those of a board in a camera as of the camera in the board."""
    # ``T_board_camera = T_camera_board⁻¹``: the board stands for a tracker that sees the camera, so that the base (in
    # the board's frame) and the tool (the camera on the flange) are free.
    known, robot, inverted = problem.data, problem.robot, problem.data.direction == "inverted"
    of_camera, key = known.frame == "camera" and not mixed, ("data", "frame")
    if not inverted and not of_camera:
        return data
    if inverted and (data.position is None or data.rotation is None):
        hint = "leave out data: {direction: inverted}, or add the orientation"
        raise InputError(Issue("only poses can be inverted", ("data", "direction"), "inverted", hint, data.file))
    if data.position is None or data.rotation is None or (of_camera and not data.measured_axes.all()):
        raise no_board_poses(data)
    frames = (robot.base_free, robot.base), (robot.tool_free, robot.tool)
    if of_camera and not all(free or any(factor.nominal for factor in factors) for free, factors in frames):
        hint = "write base: free and tool: free in the section robot"
        raise InputError(Issue("where the camera and the board are is not known", key, "camera", hint))
    position, rotation = data.position, data.rotation
    for _ in range(inverted + of_camera):
        position, rotation = inverted_poses(position, rotation)
    return replace(data, position=position, rotation=rotation, inverted=of_camera and not inverted)


def _approach_sides(
    cells: Cells, q: Array, robots: Codes, robot: Robot, order: Codes
) -> tuple[Array, Array, bool]:  # fmt: skip
    """Side and length (N, n) of the last moves, and whether the file states any side: what it states counts."""
    side, length = np.zeros_like(q), np.zeros_like(q)
    for code in np.unique(robots):
        rows = order[robots[order] == code]
        step = np.diff(q[rows], axis=0, prepend=q[rows[:1]])
        last = np.maximum.accumulate(np.where(step != 0, np.arange(len(rows))[:, None], 0), axis=0)
        move = np.take_along_axis(step, last, axis=0)
        side[rows], length[rows] = np.sign(move), np.abs(move)
    given = {j: name for j, joint in enumerate(robot.joint_names) if (name := f"{joint}.approach") in cells.numbers}
    for j, name in given.items():
        stated = cells.present(name)
        side[:, j] = np.where(np.isnan(stated), side[:, j], stated)
    return side, length, bool(given)


def _visits(pose: Codes, robots: Codes, order: Codes) -> Codes | None:
    """(N,) the stays at poses (N,) where rows were not made in the order of the file; None where they were."""
    if np.array_equal(order, np.arange(len(order))):
        return None
    place, visit = np.column_stack([pose, robots])[order], np.zeros(len(order), dtype=np.intp)
    visit[order] = np.cumsum(np.any(np.diff(place, axis=0, prepend=place[:1]) != 0, axis=1))
    return visit


def _codes_of_rows(values: Array) -> Codes:
    """(N,) codes of equal rows in the order of first appearance."""
    rows = np.ascontiguousarray(values + 0.0)  # of 0.0 and -0.0 only the bytes differ
    keys = rows.view(f"V{rows.itemsize * rows.shape[1]}").ravel().tolist()
    known: dict[bytes, int] = {}
    return np.fromiter((known.setdefault(key, len(known)) for key in keys), dtype=np.intp, count=len(keys))


def _measured_position(cells: Cells, q: Array, robot: Robot, faults: Faults) -> Array:
    """(N, 3) measured points [m]; a coordinate may be left out in which the tool cannot move."""
    position = np.zeros((len(q), 3))
    still = still_axes(robot)
    for k, axis in enumerate(AXES):
        if axis in cells.numbers:
            position[:, k] = cells.present(axis)
        elif still[k]:
            position[:, k] = nominal_poses(robot, q[:1])[0][0, k]
        else:
            faults.add(f"the column {axis} is missing, and this arm moves along {axis}", axis, hint=f"add {axis} [mm]")
    return position


def _check_limits(q: Array, robot: Robot, columns: dict[str, Column], line: Codes, faults: Faults) -> None:
    for values, joint in zip(q.T, robot.joints, strict=True):
        turns = joint.type == "revolute"
        margin = TURN if turns else joint.upper - joint.lower
        beyond = np.flatnonzero((values > joint.upper + margin) | (values < joint.lower - margin))
        if not len(beyond):
            continue
        column = columns[joint.name]
        other, ratio = ("deg", math.pi / 180) if turns else ("mm", 1e-3)
        text = f"more than {'a turn' if turns else 'their whole range'} beyond the limits"
        converted = values / column.factor * ratio
        fits = converted.max() <= joint.upper + margin and converted.min() >= joint.lower - margin
        if column.unit != other and fits:
            first, reach = int(line[beyond[0]]), np.abs(values).max() / column.factor
            message = f"values up to {reach:.4g} {column.unit} lie {text} ({len(beyond)} rows, first line {first})"
            faults.add(message, joint.name, None, f"they look like {other}: write {joint.name} [{other}]", first)
            continue
        for row in beyond:
            value = values[row] / column.factor
            bounds = ", ".join(f"{bound / column.factor:.4g}" for bound in (joint.lower, joint.upper))
            message = f"{value:.6g} {column.unit} lies {text.replace('their', 'its')} [{bounds}]"
            faults.add(message, joint.name, value, "correct the value or the joint's limits", int(line[row]))


def _clock_notes(data: Measurements) -> tuple[list[str], tuple[str, ...]]:
    """A warning where the clock started anew, and a note where rows are in another order than they were made."""
    back = np.zeros(0, dtype=np.intp) if data.time is None else rows_back_in_time(data.time, data.robot)
    if not len(back):
        return [], ()
    if data.visit is None:
        lines = ", ".join(str(data.line[row]) for row in back)
        return [
            f"the time goes back at line {lines}, as if the clock had started anew: count it from the first row on, or "
            "a drift, a slip or growth with time is not seen as it was"
        ], ()
    rows = "1 row" if len(back) == 1 else f"{len(back)} rows"
    first = data.line[back[0]]
    return [], (f"times go back at {rows} (first line {first}): the row before one is that before it in time",)


def _repeated_rows(data: Measurements) -> list[str]:
    if data.position is None:
        return []
    further = (data.rotation, data.time, data.temperature, data.payload)
    parts = [data.q, data.position, data.robot, *(part for part in further if part is not None)]
    codes = _codes_of_rows(np.column_stack(parts))
    _, first = np.unique(codes, return_index=True)
    again = np.setdiff1d(np.arange(len(codes)), first)
    if not len(again):
        return []
    pairs = [f"{data.line[row]} (of {data.line[first[codes[row]]]})" for row in again[:10]]
    more = ", …" if len(again) > 10 else ""
    rows = "1 row repeats" if len(again) == 1 else f"{len(again)} rows repeat"
    return [f"{rows} an earlier one to the last digit, as if copied: lines {', '.join(pairs)}{more}"]


def _moved_poses(data: Measurements) -> list[str]:
    if not data.pose_given:
        return []
    _, first, inverse = np.unique(data.pose, return_index=True, return_inverse=True)
    apart = np.abs(data.q - data.q[first[inverse]]).max(axis=1)
    rows = np.flatnonzero(apart > 1e-3)
    if not len(rows):
        return []
    worst = rows[np.argmax(apart[rows])]
    return [
        f"{len(rows)} rows have another posture than the first row of their pose, by up to {apart[worst]:.3g} rad or m "
        f"(line {data.line[worst]}): repeats are taken as one commanded posture"
    ]


def _idle_distances(data: Measurements, known: DataSpec) -> list[str]:
    names = data.point_names
    points = data.kind.touched_points(names)
    named = dict.fromkeys(name for a, b, _ in known.distances for name in (a, b))
    idle = [name for name in named if points and name not in points]
    unseen = [name for name in data.kind.stated if data.kind.label and name not in names]
    return [
        *(f"data.distances names the point '{n}', which no row touches; {did_you_mean(n, list(points))}" for n in idle),
        *(f"data.{data.kind.settings} names '{n}', which no row has; {did_you_mean(n, names)}" for n in unseen),
    ]
