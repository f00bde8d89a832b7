"""Files that mix instruments: which rows are whose, and every row as the numbers of its reading."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from posture_opt.errors import BadValueError, InputError, Issue, listed
from posture_opt.measurements.columns import (
    AXES,
    Cells,
    columns_of_kinds,
)
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.kinds import KINDS, Kind, Member, Mixed, Position
from posture_opt.measurements.kinds.kind import Seen
from posture_opt.measurements.kinds.mixed import SLOTS
from posture_opt.measurements.kinds.pose import ORIENTATION, ORIENTATIONS
from posture_opt.measurements.measurements import (
    Measurements,
    carried_joint_values,
    nominal_poses,
    still_axes,
)
from posture_opt.measurements.orientation_columns import NO_ORIENTATION_NOTE
from posture_opt.measurements.plausibility import HasData
from posture_opt.measurements.table import Faults
from posture_opt.model.chain import Walk, factor_values, position_column, rotation_column, walk
from posture_opt.numerics import Array, Codes, Mask, stacked_rows
from posture_opt.robot.robot import Robot
from posture_opt.units import DIMENSIONS


@dataclass(frozen=True, eq=False)
class _Rows:
    """The rows of one instrument: their kind, readings (n, 3), places and seconds with their codes (n,)."""

    name: str
    rows: Codes
    listed: type[Kind]
    measured: Mask
    reading: Array
    places: tuple[str, ...]
    place: Codes
    seconds: tuple[str, ...]
    second: Codes


def mixed_rows(data: Measurements, cells: Cells, known: DataSpec, base_free: bool, faults: Faults) -> Measurements:
    """The rows of a file with the column ``instrument``, one for each number of a reading; faults join ``faults``."""
    # An instrument is of the kind whose columns its rows fill. Where the base is free, the frame of a tracker is
    # unknown beside the places of the others, which are in the frame of the base.
    code, names = cells.code("instrument")
    found = [_rows_of(name, np.flatnonzero(code == k), data, cells, known, faults) for k, name in enumerate(names)]
    parts = [one for one in found if one is not None]
    if len(parts) < len(found):
        return data
    members, first = [], 0
    for one in parts:
        kind = one.listed.of(known, one.places, one.seconds)
        kind = kind.in_own_frame() if base_free else kind  # of a tracker, whose frame is unknown then
        members.append(Member(one.name, kind, first, one.places, one.seconds))
        first += len(one.places)
    fixed = base_free or all(member.kind.fixed_to_base or not member.kind.fixes_size for member in members)
    return _in_numbers(data, parts, Mixed.of_members(members, fixed))


def _in_numbers(data: Measurements, parts: list[_Rows], kind: Mixed) -> Measurements:
    n = len(data)
    width = max(one.reading.shape[1] for one in parts)
    reading, point = np.zeros((n, width)), np.zeros(n, dtype=np.intp)
    second, part = np.zeros(n, dtype=np.intp), np.zeros((n, SLOTS), dtype=np.intp) - 1
    first = 1
    for k, (one, member) in enumerate(zip(parts, kind.members, strict=True)):
        reading[one.rows, : one.reading.shape[1]], point[one.rows] = one.reading, member.first + one.place
        if member.seconds:
            second[one.rows], first = first + one.second, first + len(member.seconds)
        numbers = member.kind.numbers(one.measured)
        part[one.rows[:, None], numbers] = SLOTS * k + numbers
    at, slot = np.nonzero(part >= 0)
    seconds = ("", *(name for member in kind.members for name in member.seconds))
    return replace(
        data.take(at), position=None, rotation=None, reading=reading[at], point=point[at],
        point_names=tuple(kind.names), second=second[at], second_names=seconds, part=part[at, slot], instrument=kind,
    )  # fmt: skip


def _rows_of(name: str, rows: Codes, data: Measurements, cells: Cells, known: DataSpec, faults: Faults) -> _Rows | None:
    there = (columns_of_kinds(known) & {*cells.numbers, *cells.codes}) - {*data.joint_names}
    there -= {*ORIENTATIONS} if data.rotation is None else set()
    filled = {column for column in there if _filled(cells, column, rows).any()}
    kind = _kind_of(name, filled, known, int(cells.line[rows[0]]), faults)
    if kind is None:
        return None
    for column in sorted(kind.required(known, filled)):
        for row in rows[~_filled(cells, column, rows)]:
            faults.add("the cell is empty", column, hint=f"'{name}' reads it in other rows", line=int(cells.line[row]))
    numbers = kind.columns_in(known)
    reading = np.zeros((len(rows), len(numbers)))
    for k, column in enumerate(numbers):
        if column in filled:
            reading[:, k] = np.nan_to_num(cells.present(column)[rows])
    if kind.further and data.rotation is not None:
        reading = np.concatenate([reading, np.nan_to_num(data.rotation[rows])], axis=1)
    places, place = _names(cells, kind.label, rows) if kind.label else (("",), np.zeros(len(rows), dtype=np.intp))
    seconds, second = _names(cells, kind.second_label, rows) if kind.second_label else ((), place)
    measured = np.array([axis in filled for axis in AXES])
    return _Rows(name, rows, kind, measured, reading, places, place, seconds, second)


def _kind_of(name: str, filled: set[str], known: DataSpec, line: int, faults: Faults) -> type[Kind] | None:
    needs = {kind: own for kind in KINDS if (own := kind.required(known, filled)) and own <= filled}
    fits = [kind for kind, own in needs.items() if not any(own < other for other in needs.values())]
    more, turned = sorted(filled - needs[fits[0]]) if fits else [], filled & {*ORIENTATIONS}
    if len(fits) == 1 and not more:
        return fits[0]
    what, hint = "the columns of no kind", "every row is of one kind: leave the columns of the others empty"
    if len(fits) > 1:
        what = f"columns of {listed(kind.noun for kind in fits)}"
    elif fits:
        what = f"{listed(more)} beside the columns of {fits[0].noun}"
    elif turned:
        what = "the columns of an orientation without those of a position"
        hint = f"add {Position.example}: orientations are read beside them"
    faults.add(f"the rows of the instrument '{name}' fill {what}", "instrument", name, hint, line)
    return None


def _filled(cells: Cells, column: str, rows: Codes) -> Mask:
    """(n,) whether the cells of a column of some kind are not empty."""
    if column in cells.numbers:
        return np.isfinite(cells.present(column)[rows])
    code, texts = cells.code(column)
    return np.asarray([texts[k] != "" for k in code[rows]], dtype=bool)


def _names(cells: Cells, column: str, rows: Codes) -> tuple[tuple[str, ...], Codes]:
    """The names in some rows of a column, in the order of their appearance, and their codes (n,)."""
    code, texts = cells.code(column)
    own = list(dict.fromkeys(code[rows].tolist()))
    return tuple(texts[k] for k in own), np.array([own.index(k) for k in code[rows]], dtype=np.intp)


def unmixed(data: Measurements) -> tuple[Measurements, dict[str, list[object]]]:
    """One row a reading again, and the columns of all instruments in SI units: NaN or an empty name where not read."""
    assert isinstance(data.kind, Mixed), "a file of several instruments"
    assert data.part is not None, "a file of several instruments"
    first = np.sort(np.unique(data.line, return_index=True)[1])
    rows, whole = len(first), data.take(first)
    assert whole.part is not None, "rows of a mixed file stay such"
    owner = whole.part // SLOTS
    columns: dict[str, list[object]] = {"instrument": [data.kind.members[k].name for k in owner]}
    seconds = 1
    for k, member in enumerate(data.kind.members):
        own, kind = np.flatnonzero(owner == k), member.kind
        read = np.unique(data.part[data.part // SLOTS == k] % SLOTS)
        for slot, (name, dimension) in enumerate(kind.read_columns.items()):
            if name in AXES and slot not in read:
                continue
            title = f"{name} [{DIMENSIONS[dimension][0]}]" if dimension else name
            cells = columns.setdefault(title, [np.nan] * rows)
            for i in own:
                cells[i] = float(whole.reading[i, slot])  # type: ignore[index]
        for label, codes, names, start in (
            (kind.label, whole.point, member.places, member.first),
            (kind.second_label, whole.second, member.seconds, seconds),
        ):
            if label and codes is not None:
                cells = columns.setdefault(label, [""] * rows)
                for i in own:
                    cells[i] = names[codes[i] - start]
        seconds += len(member.seconds)
    return whole, columns


def likeliest(kind: Kind, robot: Robot, reached: Walk, seen: Seen) -> Kind:
    """The kind, with those of its `Kind.alternatives` by which its rows are likelier."""
    # To first order the readings are off those of the nominal arm by ``r = J p + n``, p small errors of the arm and
    # of what is unknown of the instrument, n noise: the likelier one has the lesser ``rᵀ (σ² + J S² Jᵀ)⁻¹ r``
    for i in range(len(kind.alternatives(seen))):
        other, rows = kind.alternatives(seen)[i]
        if _misfit(other, robot, reached, seen, rows) < _misfit(kind, robot, reached, seen, rows):
            kind = other
    return kind


def _misfit(kind: Kind, robot: Robot, reached: Walk, seen: Seen, rows: Codes) -> float:
    """``rᵀ (1 + A Aᵀ)⁻¹ r`` of some rows with ``A = J S / σ``, over σ²."""
    n = len(seen.place)
    names = [i for i, factor in enumerate(robot.factors) if factor.parameter]
    columns = [kind.slope(seen, position_column(reached, i), rotation_column(reached, i)) for i in names]
    axes = sorted({axis for place in kind.places(kind.names) for axis in kind.slots(place)})
    columns += [kind.unknown_slope(seen, axis) for axis in axes]
    r, *J = (stacked_rows(slots, n)[rows].ravel() for slots in (kind.error(seen), *columns))
    A: Array = np.stack(J, axis=1) * (1e-3 / 1e-5)  # errors of 1 mm or mrad of every parameter, noise small beside them
    left = A.T @ r
    return float(r @ r - left @ np.linalg.solve(np.eye(A.shape[1]) + A.T @ A, left))


def with_instrument(data: Measurements, cells: Cells, problem: HasData, faults: Faults) -> Measurements:
    """The rows with what they show of the pose, where that is neither a position nor a touched point."""
    if "instrument" in cells.codes:
        return _mixed(data, cells, problem, faults)
    required, read = {k: k.required(problem.data, ()) for k in KINDS}, {*cells.numbers, *cells.codes}
    kind = next((k for k, own in required.items() if own and own <= read), None)
    if kind is None or data.position is not None or kind.kind == data.kind.kind:
        return data
    numbers = [cells.present(column) for column in kind.columns_in(problem.data)]
    reading = np.column_stack([np.zeros((len(data), 0)), *numbers])
    try:
        instrument = kind.of(problem.data, data.point_names, data.second_names)
        return _prepared(replace(data, reading=reading, instrument=instrument), problem)
    except BadValueError as error:
        raise InputError(Issue(error.message, ("data", kind.settings), hint=error.hint, file=data.file)) from None


def _mixed(data: Measurements, cells: Cells, problem: HasData, faults: Faults) -> Measurements:
    of_board = problem.data.frame == "camera"
    if of_board and data.rotation is None:
        raise no_board_poses(data)
    if data.rotation is not None and not getattr(problem.measurement, ORIENTATION.key, None):
        if of_board:
            message, hint = "no σ of the orientation of a board is stated", "write 0.01 deg, say, as the camera is"
            raise InputError(Issue(message, ("uncertainty", "measurement", ORIENTATION.key), hint=hint))
        data = replace(data.without_orientation(), notes=(NO_ORIENTATION_NOTE,))
    try:
        found = mixed_rows(data, cells, problem.data, problem.robot.base_free, faults)
        return found if found.part is None else _prepared(found, problem)
    except BadValueError as error:
        raise InputError(Issue(error.message, ("data",), hint=error.hint, file=data.file)) from None


def _prepared(data: Measurements, problem: HasData) -> Measurements:
    q = carried_joint_values(problem.arm, data.q)
    points, rotations = nominal_poses(problem.robot, q)
    places = max(len(data.place_names), 1)
    seen = data.seen(points.T, np.moveaxis(rotations, 0, -1).swapaxes(0, 1), np.zeros((places, data.kind.width)))
    gravity = np.array(problem.robot.gravity)
    up = -gravity / np.linalg.norm(gravity) if gravity.any() else np.array([0.0, 0.0, 1.0])
    prepared = data.kind.prepared(seen, ~still_axes(problem.robot), up)
    factors = problem.robot.factors
    reached = walk(factors, factor_values(factors, [np.ascontiguousarray(column) for column in q.T]))
    prepared = likeliest(prepared, problem.robot, reached, seen)
    return replace(data, instrument=prepared, lever=prepared.levers(seen))


def no_board_poses(data: Measurements) -> InputError:
    """The file says that a camera reports poses of a board, and its rows hold none."""
    hint, message = "add qw, qx, qy, qz, or a rotation vector", "poses of a board have x, y, z and an orientation"
    return InputError(Issue(message, ("data", "frame"), "camera", hint, data.file))
