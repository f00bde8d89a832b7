"""The problem file as a schema: one field a section; which keys, words and examples belong at a place in a file."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache
from typing import Any, ClassVar

from pydantic import ConfigDict, Field, SerializeAsAny, ValidationError, create_model, field_validator

from posture_opt.collision.cell import CellSpec
from posture_opt.encoding import encode
from posture_opt.errors import InputError, Issue, KeyPath, key_text, one_of
from posture_opt.limits import MOST_EFFECTS
from posture_opt.measurements.data_section import DataSpec
from posture_opt.model import effects as catalogue
from posture_opt.model.effects import CatalogueEntry, effect_class
from posture_opt.problem.yaml_source import Plain, Section, plain
from posture_opt.robot import RobotSpec
from posture_opt.robot.robot import Robot
from posture_opt.selection.registered_tasks import every_task
from posture_opt.selection.solvers import SolverSpec
from posture_opt.selection.solvers.ipopt import Ipopt
from posture_opt.selection.tasks import Task, known_to, task_class
from posture_opt.spec import Spec
from posture_opt.spec import one_of as any_of
from posture_opt.uncertainty.uncertainty_section import UncertaintySpec
from posture_opt.units import BY_JOINT_TYPE, BY_NAME, DIMENSIONS

TITLE = "Problem file of posture_opt"
_TASK_WORDS = "what the tool point has to do"
_EFFECTS_WORDS = "what moves the tool point beyond the geometry"


class ProblemSpec(Spec):
    """A problem file of posture_opt: the robot, what is uncertain about it, and what it has to do."""

    # Read by `read_sections`: what belongs in a task or an effect depends on its kind.
    model_config: ClassVar[ConfigDict] = ConfigDict(title=TITLE)

    name: str = Field("", description="what reports call the problem")
    robot: RobotSpec = Field(description="the nominal arm", examples=[{"kind": "preset", "name": "ur10e"}])
    uncertainty: UncertaintySpec = Field(UncertaintySpec(), description="where the scatter comes from")
    task: SerializeAsAny[Task] | None = Field(None, description=_TASK_WORDS)
    cell: CellSpec | None = Field(None, description="obstacles around the arm; none leaves collisions unchecked")
    effects: tuple[SerializeAsAny[CatalogueEntry], ...] = Field((), description=_EFFECTS_WORDS)
    solver: SolverSpec = Field(Ipopt(), description="how the best posture is searched for")
    data: DataSpec = Field(DataSpec(), description="what is known about measurements besides their file")

    @field_validator("effects", mode="before")
    @classmethod
    def _not_too_many(cls, effects: object) -> object:
        MOST_EFFECTS.check(len(effects) if isinstance(effects, list | tuple) else 0)
        return effects


def read_sections(data: Mapping[str, Plain]) -> ProblemSpec:
    """What the sections of a file say."""
    tasks = _classes([task] if (task := data.get("task")) else [], task_class)
    effects = _classes(data.get("effects") or (), effect_class)
    few = None if tasks is None or effects is None else _reader(tasks, effects)
    try:
        found = (few or whole_schema()).model_validate(data)
    except ValidationError:
        if few is None:
            raise
        found = whole_schema().model_validate(data)  # its errors say which other kinds there are
    said = {name: getattr(found, name) for name in ProblemSpec.model_fields}
    return ProblemSpec.model_construct(found.model_fields_set, **said)


def _classes(entries: Plain, class_of: Callable[[str], type[Spec] | None]) -> tuple[type[Spec], ...] | None:
    if not isinstance(entries, list | tuple) or not all(isinstance(entry, dict) for entry in entries):
        return None
    found = dict.fromkeys(class_of(kind) if isinstance(kind := e.get("kind"), str) else None for e in entries)
    return tuple(one for one in found if one is not None) if None not in found else None


@cache
def _reader(tasks: tuple[type[Spec], ...], effects: tuple[type[Spec], ...]) -> type[ProblemSpec]:
    task: Any = any_of(tasks) | None if tasks else None
    entry: Any = any_of(effects) if effects else None
    entries: Plain = tuple[entry, ...] if effects else tuple[()]
    return create_model(
        "ProblemSpec", __base__=ProblemSpec, __doc__=ProblemSpec.__doc__,
        task=(task, Field(None, description=_TASK_WORDS)), effects=(entries, Field((), description=_EFFECTS_WORDS)),
    )  # fmt: skip


def whole_schema() -> type[ProblemSpec]:
    """The schema of every kind of task and effect that there is."""
    return _reader(every_task(), catalogue.CATALOGUE)


Node = Section


@cache
def json_schema() -> Node:
    """The JSON Schema of the problem file."""
    schema: Node = _without_unknown(whole_schema().model_json_schema())
    return schema


def _without_unknown(node: Plain) -> Plain:
    if isinstance(node, dict):
        return {
            key: _without_unknown(value) for key, value in node.items() if key != "default" or encode(value) == value
        }
    return [_without_unknown(entry) for entry in node] if isinstance(node, list) else node


def nodes_at(key: KeyPath, data: Plain) -> list[Node]:
    """The alternatives that the schema allows at ``key`` of ``data``; kinds that the data name are followed."""
    nodes = list(_alternatives(json_schema(), data))
    for part in key:
        data = entry_at(data, (part,))
        nodes = [found for node in nodes for child in _children(node, part) for found in _alternatives(child, data)]
    return nodes


def known_keys(key: KeyPath, data: Plain) -> list[str]:
    """The keys that are allowed in the mapping at ``key``."""
    return list(dict.fromkeys(name for node in nodes_at(key, data) for name in node.get("properties", {})))


def example_at(key: KeyPath, data: Plain) -> str:
    """An example of what belongs at ``key``, as YAML; empty where the schema has none."""
    for node in nodes_at(key, data):
        if node.get("examples"):
            return _text(node["examples"][0])
        if "const" in node:
            return _text(node["const"])
        parts = node.get("prefixItems") or [node.get("items", {})] * node.get("minItems", 0)
        inner = [next(_alternatives(part, None)).get("examples", [""])[0] for part in parts]
        if inner and all(inner):
            return _text(inner)
    return ""


def size_at(key: KeyPath, data: Plain) -> int:
    """The number of entries of the list at ``key``; 0 where it is open."""
    return max((node.get("minItems", 0) for node in nodes_at(key, data)), default=0)


def bound_at(key: KeyPath, data: Plain, bound: Plain) -> str:
    """A bound of the value at ``key`` as people write it: with its unit where the value has one."""
    dimensions = {node.get("dimension") for node in nodes_at(key, data)}
    if not isinstance(bound, int | float):
        return str(bound)
    if "angle" in dimensions:
        return f"{math.degrees(bound):g} deg"
    return f"{bound:g} m" if "length" in dimensions else f"{bound:g}"


def entry_at(data: Plain, key: KeyPath) -> Plain:
    """The entry of nested data at a key; None where there is none."""
    for part in key:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _alternatives(node: Node, data: Plain) -> Iterator[Node]:
    while "$ref" in node:
        node = json_schema()["$defs"][node["$ref"].rsplit("/", 1)[1]]
    choices = node.get("anyOf") or node.get("oneOf")
    if not choices:
        yield node
        return
    discriminator = node.get("discriminator")
    if discriminator and isinstance(data, dict):
        chosen = discriminator["mapping"].get(str(data.get(discriminator["propertyName"])))
        choices = [{"$ref": chosen}] if chosen else choices
    said = {word: node[word] for word in ("examples", "description") if word in node}
    for choice in choices:
        yield from ({**said, **found} for found in _alternatives(choice, data))


def _children(node: Node, part: str | int) -> Iterator[Node]:
    if isinstance(part, int):
        fixed = node.get("prefixItems", [])
        if part < len(fixed):
            yield fixed[part]
        elif isinstance(node.get("items"), dict):
            yield node["items"]
    elif part in node.get("properties", {}):
        yield node["properties"][part]
    elif isinstance(node.get("additionalProperties"), dict):
        yield node["additionalProperties"]


def _text(value: Plain) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{name}: {_text(entry)}' for name, entry in value.items())}}}"
    return str(value)


# Keys of a task that say where, one of them at a time, each with those that mean nothing without it
_TARGET_KEYS: dict[str, tuple[str, ...]] = {
    "position": (),
    "region": (),
    "features": ("workpiece", "combine"),
    **dict.fromkeys(("path", "points"), ("workpiece", "axes", "spacing", "largest_step", "closed", "speed")),
}


def kept_of_task(former: Mapping[str, Plain], kind: str | None, given: Collection[str]) -> Section:
    """What a task keeps where it becomes one of another ``kind``, or is ``given`` other keys."""
    task = dict(former) if former.get("kind") == kind else known_to(kind, former, every_task())
    for rival in set(_TARGET_KEYS) & set(given):
        for other in set(_TARGET_KEYS) - {rival, *given}:
            gone = {other, *_TARGET_KEYS[other]} - set(given)
            task = {key: value for key, value in task.items() if key not in gone}
    return task


def replaced_data(
    document: Mapping[str, Plain], changes: Mapping[str, Plain], robot: Robot
) -> tuple[Section, frozenset[KeyPath]]:
    """The data of a problem with other values, and the first two parts of the keys that changed."""
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
        container: Plain = data
        for part in key[:-1]:
            container = container[part]
        last: Plain = key[-1]
        if last < len(container) if isinstance(container, list) else last in container:  # it may have been removed
            container[last] = _with_units(container[last], key, data, robot)
    return data, frozenset(key[:2] for key in keys)


def _put(data: Plain, parts: tuple[str, ...], value: Plain, issues: list[Issue]) -> KeyPath:
    key: KeyPath = ()
    for part in parts[:-1]:
        entry = _named_entry(data, part, key, issues)
        if entry is None:
            return ()
        key = (*key, entry)
        if isinstance(data, dict) and data.get(str(entry)) is None:
            data[str(entry)] = {}
        data = data[entry]
    last: Plain = _named_entry(data, parts[-1], key, issues)
    if last is None:
        return ()
    if value is not None:
        data[last] = value
    elif isinstance(data, list) or last in data:
        del data[last]
    return (*key, last)


def _named_entry(data: Plain, part: str, key: KeyPath, issues: list[Issue]) -> str | int | None:
    if isinstance(data, dict):
        return part
    if not isinstance(data, list):
        here = f"'{data}'" if isinstance(data, str) else str(data)
        issues.append(Issue(f"{here} stands here, which has no key '{part}'", key, data, f"replace {key_text(key)}"))
        return None
    numbers = [str(i) for i in range(len(data))]
    names = [str(e["name"]) if isinstance(e, dict) and "name" in e else i for e, i in zip(data, numbers, strict=True)]
    for known in (names, numbers):
        if part in known:
            return known.index(part)
    issues.append(Issue("the list has no such entry", (*key, part), None, one_of(part, names)))
    return None


def _with_units(value: Plain, key: KeyPath, data: Section, robot: Robot) -> Plain:
    if isinstance(value, dict):
        return {name: _with_units(entry, (*key, name), data, robot) for name, entry in value.items()}
    if isinstance(value, list):
        return [_with_units(entry, (*key, i), data, robot) for i, entry in enumerate(value)]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return value
    unit = _unit_at(key, data, robot)
    return f"{value!r} {unit}" if unit else value


def _unit_at(key: KeyPath, data: Section, robot: Robot) -> str:
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
