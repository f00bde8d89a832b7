"""``edited``: a problem file with other values at some keys, and all its comments where they were."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import yaml

from posture_opt.errors import InputError
from posture_opt.problem.plain_data import Plain, Section
from posture_opt.problem.yaml_source import compose, dump_flow, parse_yaml


class _Edit(NamedTuple):
    """Characters ``start`` to ``end`` of a text, and what comes in their place."""

    start: int
    end: int
    text: str


def edited(text: str, data: Mapping[str, Plain]) -> str | None:
    """The text of a problem file with the values of ``data``; only what differs is written anew.

    >>> print(edited("robot: {name: ur5}  # ours\\n", {"robot": {"name": "ur10"}}), end="")
    robot: {name: ur10}  # ours

    None where that cannot be done, as with values that several keys share by an alias: what is written is read again,
    and has to be ``data`` exactly.
    """
    try:
        before, node = parse_yaml(text).data, compose(text)
        edits = sorted(_edits(text, node, before, data), reverse=True)
        for edit in edits:
            text = text[: edit.start] + edit.text + text[edit.end :]
        return text if parse_yaml(text).data == data else None
    except InputError:
        return None


def _edits(text: str, node: yaml.Node | None, before: Plain, after: Plain) -> Iterator[_Edit]:
    """What to write in place of what, for a value at a node."""
    if before == after or node is None:
        return
    if isinstance(node, yaml.MappingNode) and isinstance(after, Mapping) and after:
        yield from _of_mapping(text, node, before, after)
    elif isinstance(node, yaml.SequenceNode) and isinstance(after, list) and len(after) == len(before):
        for child, old, new in zip(node.value, before, after, strict=True):
            yield from _edits(text, child, old, new)
    else:
        yield _Edit(node.start_mark.index, _end(text, node), dump_flow(after))


def _of_mapping(text: str, node: yaml.MappingNode, before: Section, after: Mapping[str, Plain]) -> Iterator[_Edit]:
    children = {str(name.value): (name, child) for name, child in node.value}
    for key, (name, child) in children.items():
        if key in after:
            yield from _edits(text, child, before.get(key), after[key])
        elif node.flow_style:  # a comma before or after it would have to go too
            yield _Edit(node.start_mark.index, _end(text, node), dump_flow(dict(after)))
            return
        else:
            yield _Edit(_line_start(text, name.start_mark.index), _line_end(text, _end(text, child)), "")
    new = {key: value for key, value in after.items() if key not in children}
    if not new:
        return
    if node.flow_style:
        end = _end(text, node) - 1
        yield _Edit(end, end, "".join(f", {dump_flow({key: value})[1:-1]}" for key, value in new.items()))
    else:
        end = _line_end(text, _end(text, node))
        indent = " " * node.start_mark.column
        lines = "".join(f"{indent}{dump_flow({key: value})[1:-1]}\n" for key, value in new.items())
        yield _Edit(end, end, lines if text[:end].endswith("\n") else f"\n{lines}")


def _end(text: str, node: yaml.Node) -> int:
    """Where a node ends: PyYAML counts the blank lines and comments after a block to it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style:
        last = node.value[-1]
        return _end(text, last[1] if isinstance(last, tuple) else last)
    return int(node.end_mark.index)


def _line_start(text: str, at: int) -> int:
    return text.rfind("\n", 0, at) + 1


def _line_end(text: str, at: int) -> int:
    found = text.find("\n", at)
    return len(text) if found < 0 else found + 1
