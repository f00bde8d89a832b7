"""Files that mix instruments: which rows are whose, and every row as the numbers of its reading."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from posture_opt.errors import listed
from posture_opt.measurements.columns import AXES, Cells, columns_of_kinds
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.faults import Faults
from posture_opt.measurements.kinds import KINDS, Kind, Member, Mixed, Position
from posture_opt.measurements.kinds.mixed import SLOTS
from posture_opt.measurements.kinds.pose_columns import ORIENTATIONS
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Mask
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
    """The rows of a file with the column ``instrument``, one for each number of a reading; faults join ``faults``.

    An instrument is of the kind whose columns its rows fill. Where the base is free, the frame of a tracker is unknown
    beside the places of the others, which are in the frame of the base.
    """
    named = cells.code("instrument")
    assert named is not None, "a file without the column is not mixed"
    found = [
        _rows_of(name, np.flatnonzero(named[0] == k), data, cells, known, faults) for k, name in enumerate(named[1])
    ]
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
    """One row a number: its instrument and place, and the whole reading beside it."""
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
    """What an instrument read; None with a fault where its rows are of no kind, or of several."""
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
            reading[:, k] = np.nan_to_num(_number(cells, column)[rows])
    if kind.further and data.rotation is not None:
        reading = np.concatenate([reading, np.nan_to_num(data.rotation[rows])], axis=1)
    places, place = _names(cells, kind.label, rows) if kind.label else (("",), np.zeros(len(rows), dtype=np.intp))
    seconds, second = _names(cells, kind.second_label, rows) if kind.second_label else ((), place)
    measured = np.array([axis in filled for axis in AXES])
    return _Rows(name, rows, kind, measured, reading, places, place, seconds, second)


def _kind_of(name: str, filled: set[str], known: DataSpec, line: int, faults: Faults) -> type[Kind] | None:
    """The kind whose columns are ``filled``: of two, the one that needs those of the other and more.

    None with a fault where there is none, or several, or where there is more than the kind has.
    """
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


def _number(cells: Cells, column: str) -> Array:
    """(N,) a column of numbers, NaN where a cell is empty."""
    values = cells.number(column)
    assert values is not None, "the column was read"
    return values


def _filled(cells: Cells, column: str, rows: Codes) -> Mask:
    """(n,) whether the cells of a column of some kind are not empty."""
    if column in cells.numbers:
        return np.isfinite(_number(cells, column)[rows])
    code = cells.code(column)
    assert code is not None, "the column was read"
    return np.asarray([code[1][k] != "" for k in code[0][rows]], dtype=bool)


def _names(cells: Cells, column: str, rows: Codes) -> tuple[tuple[str, ...], Codes]:
    """The names in some rows of a column, in the order of their appearance, and their codes (n,)."""
    code = cells.code(column)
    assert code is not None, "the column was read"
    own = list(dict.fromkeys(code[0][rows].tolist()))
    return tuple(code[1][k] for k in own), np.array([own.index(k) for k in code[0][rows]], dtype=np.intp)


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
