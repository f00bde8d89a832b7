"""Changes of a problem without a file: ``task__position=(0.6, 0.2, 0.1)``, in SI or with units as in the file.

Plain numbers are given the SI unit of their place in the schema, so that the changed problem can be written as a file.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from posture_opt.errors import InputError, Issue, KeyPath, key_text, one_of
from posture_opt.problem.plain_data import Plain, Section, plain
from posture_opt.problem.schema import nodes_at
from posture_opt.robot.robot import Robot
from posture_opt.selection.registered_tasks import every_task
from posture_opt.selection.tasks import known_to
from posture_opt.units import BY_JOINT_TYPE, BY_NAME, DIMENSIONS

_TARGET_KEYS: dict[str, tuple[str, ...]] = {
    "position": (),
    "region": (),
    "features": ("workpiece", "combine"),
    **dict.fromkeys(("path", "points"), ("workpiece", "axes", "spacing", "largest_step", "closed", "speed")),
}
"""Keys of a task that say where, one of them at a time, each with those that mean nothing without it."""


def kept_of_task(former: Mapping[str, Plain], kind: str | None, given: Collection[str]) -> Section:
    """What a task keeps where it becomes one of another ``kind``, or is ``given`` other keys.

    Keys that the kind knows stay; of the keys that say where, only those that are given.
    """
    task = dict(former) if former.get("kind") == kind else known_to(kind, former, every_task())
    for rival in set(_TARGET_KEYS) & set(given):
        for other in set(_TARGET_KEYS) - {rival, *given}:
            gone = {other, *_TARGET_KEYS[other]} - set(given)
            task = {key: value for key, value in task.items() if key not in gone}
    return task


def replaced_data(
    document: Mapping[str, Plain], changes: Mapping[str, Plain], robot: Robot
) -> tuple[Section, frozenset[KeyPath]]:
    """The data of a problem with other values, and the first two parts of the keys that changed.

    Args:
        document: as the problem has it; it is not changed.
        changes: key -> value, the parts of a key joined by ``__``; None removes a key. Entries of a list are named
            by their number, or by their ``name``.
        robot: its joints and parameters say whether a number is an angle or a length.

    Raises:
        InputError: keys that lead nowhere; whether the values fit is not checked here.
    """
    data = plain(document)
    words = {name: tuple(name.split("__")) for name in changes}
    given = {parts[1] for parts in words.values() if parts[0] == "task" and len(parts) > 1}
    if given and isinstance(data.get("task"), dict):
        data["task"] = kept_of_task(data["task"], changes.get("task__kind"), given)
    issues: list[Issue] = []
    keys = [_put(data, parts, plain(changes[name]), issues) for name, parts in words.items()]
    if issues:
        raise InputError(issues)
    for key in keys:
        _give_units(data, key, robot)
    return data, frozenset(key[:2] for key in keys)


def _put(data: Plain, parts: tuple[str, ...], value: Plain, issues: list[Issue]) -> KeyPath:
    """Writes a value into nested data; returns where, or adds the reason why there is no such place.

    Args:
        parts: of the key; mappings on the way that are missing are made.
        value: None removes the entry.
    """
    key: KeyPath = ()
    for part in parts[:-1]:
        entry = _entry(data, part, key, issues)
        if entry is None:
            return ()
        key = (*key, entry)
        if isinstance(data, dict) and data.get(str(entry)) is None:
            data[str(entry)] = {}
        data = data[entry]
    last: Plain = _entry(data, parts[-1], key, issues)
    if last is None:
        return ()
    there = isinstance(data, list) or last in data
    if value is not None:
        data[last] = value
    elif there:
        del data[last]
    return (*key, last)


def _entry(data: Plain, part: str, key: KeyPath, issues: list[Issue]) -> str | int | None:
    """The key of a mapping, or the number of a list's entry, that ``part`` names."""
    if isinstance(data, dict):
        return part
    if not isinstance(data, list):
        here = f"'{data}'" if isinstance(data, str) else str(data)
        issues.append(Issue(f"{here} stands here, which has no key '{part}'", key, data, f"replace {key_text(key)}"))
        return None
    names = [
        str(entry["name"]) if isinstance(entry, dict) and "name" in entry else str(i) for i, entry in enumerate(data)
    ]
    numbers = [str(i) for i in range(len(data))]
    for known in (names, numbers):
        if part in known:
            return known.index(part)
    issues.append(Issue("the list has no such entry", (*key, part), None, one_of(part, names)))
    return None


def _give_units(data: Section, key: KeyPath, robot: Robot) -> None:
    """Adds the SI unit to the plain numbers at ``key`` that have a dimension: ``0.05`` of a length becomes "0.05 m"."""
    container: Plain = data
    for part in key[:-1]:
        container = container[part]
    last: Plain = key[-1]
    if last < len(container) if isinstance(container, list) else last in container:  # it may have been removed
        container[last] = _with_units(container[last], key, data, robot)


def _with_units(value: Plain, key: KeyPath, data: Section, robot: Robot) -> Plain:
    """Numbers of nested data as quantities with their SI unit; booleans, texts and ratios as they are."""
    if isinstance(value, dict):
        return {name: _with_units(entry, (*key, name), data, robot) for name, entry in value.items()}
    if isinstance(value, list):
        return [_with_units(entry, (*key, i), data, robot) for i, entry in enumerate(value)]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return value
    unit = _unit_at(key, data, robot)
    return f"{value!r} {unit}" if unit else value


def _unit_at(key: KeyPath, data: Section, robot: Robot) -> str:
    """The SI unit of a number at ``key``; empty where the schema knows no dimension."""
    dimensions = [node["dimension"] for node in nodes_at(key, data) if "dimension" in node]
    if not dimensions:
        return ""
    name = str(key[-1])
    joints = {joint.name: joint.unit for joint in robot.joints}
    if dimensions[0] == BY_JOINT_TYPE:
        return f"{joints[name]}/s" if name in joints else ""
    if dimensions[0] != BY_NAME:
        return DIMENSIONS[dimensions[0]][0]
    parameters = {known: "rad" if factor.kind == "rotate" else "m" for known, factor in robot.parameters.items()}
    return (joints | parameters).get(name, "")
