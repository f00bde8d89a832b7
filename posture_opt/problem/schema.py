"""The problem file as a schema: one field a section; which keys, words and examples belong at a place in a file.

The schema serves three times: it reads files, it is the JSON Schema that editors use, and its examples and bounds are
the hints of error messages.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any, ClassVar

from pydantic import ConfigDict, Field, SerializeAsAny, ValidationError, create_model, field_validator

from posture_opt.collision.cell import CellSpec
from posture_opt.errors import KeyPath
from posture_opt.limits import MOST_EFFECTS
from posture_opt.measurements.data_section import DataSpec
from posture_opt.model import effects as catalogue
from posture_opt.model.effects import CatalogueEntry, effect_class
from posture_opt.output import finite
from posture_opt.problem.plain_data import Plain, Section
from posture_opt.robot import RobotSpec
from posture_opt.selection.registered_tasks import every_task
from posture_opt.selection.solvers import SolverSpec
from posture_opt.selection.solvers.ipopt import Ipopt
from posture_opt.selection.tasks import Task, task_class
from posture_opt.spec import Spec, one_of
from posture_opt.uncertainty.sources.uncertainty_section import UncertaintySpec

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
        """The effects as they are, before any of them is read.

        Raises:
            BadValueError: too many.
        """
        MOST_EFFECTS.check(len(effects) if isinstance(effects, list | tuple) else 0)
        return effects


def read_sections(data: Mapping[str, Plain]) -> ProblemSpec:
    """What the sections of a file say.

    Raises:
        pydantic.ValidationError: everything that does not fit the schema.
    """
    few = _reader_of(data)
    try:
        found = (few or whole_schema()).model_validate(data)
    except ValidationError:
        if few is None:
            raise
        found = whole_schema().model_validate(data)  # its errors say which other kinds there are
    said = {name: getattr(found, name) for name in ProblemSpec.model_fields}
    return ProblemSpec.model_construct(found.model_fields_set, **said)


def _reader_of(data: Mapping[str, Plain]) -> type[ProblemSpec] | None:
    """The schema of the kinds alone that are named; None where one of them is not known here.

    Of all kinds pydantic would build the schema first, and Python would read the files: a quarter of a cold start.
    """
    tasks = _classes([task] if (task := data.get("task")) else [], task_class)
    effects = _classes(data.get("effects") or (), effect_class)
    return None if tasks is None or effects is None else _reader(tasks, effects)


def _classes(entries: Plain, class_of: Callable[[str], type[Spec] | None]) -> tuple[type[Spec], ...] | None:
    """The classes of the kinds that the entries name; None where one is not known, or the entries are no mappings."""
    if not isinstance(entries, list | tuple) or not all(isinstance(entry, dict) for entry in entries):
        return None
    found = dict.fromkeys(class_of(kind) if isinstance(kind := e.get("kind"), str) else None for e in entries)
    return tuple(one for one in found if one is not None) if None not in found else None


@cache
def _reader(tasks: tuple[type[Spec], ...], effects: tuple[type[Spec], ...]) -> type[ProblemSpec]:
    """The schema with these kinds of tasks and effects only."""
    task: Any = one_of(tasks) | None if tasks else None
    entry: Any = one_of(effects) if effects else None
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
    """The schema without defaults that mean "not known" or "no bound": JSON has no NaN and no infinity."""
    if isinstance(node, dict):
        return {
            key: _without_unknown(value) for key, value in node.items() if key != "default" or finite(value) == value
        }
    return [_without_unknown(entry) for entry in node] if isinstance(node, list) else node


def nodes_at(key: KeyPath, data: Plain) -> list[Node]:
    """The alternatives that the schema allows at ``key`` of ``data``; kinds that the data name are followed.

    Args:
        key: names and numbers from the top of the file.
        data: of the whole file; they choose between kinds.
    """
    nodes = list(_alternatives(json_schema(), data))
    for part in key:
        data = _entry(data, part)
        nodes = [found for node in nodes for child in _children(node, part) for found in _alternatives(child, data)]
    return nodes


def known_keys(key: KeyPath, data: Plain) -> list[str]:
    """The keys that are allowed in the mapping at ``key``."""
    return list(dict.fromkeys(name for node in nodes_at(key, data) for name in node.get("properties", {})))


def example_at(key: KeyPath, data: Plain) -> str:
    """An example of what belongs at ``key``, as YAML; empty where the schema has none.

    The example of the node itself, its only value, or a list of the examples of its entries.
    """
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
    """A bound of the value at ``key`` as people write it: with its unit where the value has one.

    Angles are bounded in rad inside and in deg here.
    """
    dimensions = {node.get("dimension") for node in nodes_at(key, data)}
    if not isinstance(bound, int | float):
        return str(bound)
    if "angle" in dimensions:
        return f"{math.degrees(bound):g} deg"
    return f"{bound:g} m" if "length" in dimensions else f"{bound:g}"


def _entry(data: Plain, part: str | int) -> Plain:
    """An entry of data; None where there is none."""
    try:
        return data[part]
    except (KeyError, IndexError, TypeError):
        return None


def _alternatives(node: Node, data: Plain) -> Iterator[Node]:
    """The node itself without references and choices, or all that it leaves to choose from."""
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
    """The nodes of an entry: of a list by its number, of a mapping by its name."""
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
    """A value as YAML in one line."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{name}: {_text(entry)}' for name, entry in value.items())}}}"
    return str(value)
