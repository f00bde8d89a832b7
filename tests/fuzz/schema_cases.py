"""One case for every key that the schema of the problem file knows: a new key is tried without a new line here."""

from __future__ import annotations

import random
from collections.abc import Iterator
from functools import cache
from typing import Any

from tests.fuzz.bases import Base, bases
from tests.fuzz.case import Case
from tests.fuzz.sections import made, resolved
from tests.fuzz.yaml_cases import FILE, command_words, text_of
from tests.helpers.shipped import json_schema

Step = tuple[str, Any]
"""Into a key (``"key", name``), one of several schemas (``"choice", number``), or a list (``"item", None``)."""
Path = tuple[Step, ...]
_DEEPEST = 12


@cache
def every_path() -> tuple[Path, ...]:
    """The way to every key of the schema, in every section that may have it."""
    return tuple(_paths(json_schema(), ()))


def _paths(node: dict[str, Any], path: Path) -> Iterator[Path]:
    node = resolved(node)
    if len(path) > _DEEPEST:
        return
    for number, choice in enumerate(node.get("oneOf") or node.get("anyOf") or ()):
        yield from _paths(choice, (*path, ("choice", number)))
    if isinstance(node.get("items"), dict):
        yield from _paths(node["items"], (*path, ("item", None)))
    for name, child in node.get("properties", {}).items():
        yield (*path, ("key", name))
        yield from _paths(child, (*path, ("key", name)))


def schema_case(rng: random.Random, number: int) -> Case:
    """One call with a built-in problem in which one key is stated: each key in turn."""
    ways = every_path()
    way = ways[number * 7919 % len(ways)]  # a prime: few cases reach all sections too
    base = rng.choice(bases())
    data = _with(rng, json_schema(), base.copy(), way, base.joints, "")
    text = text_of(data)
    words, out = _solved(base) if rng.random() < 0.03 else command_words(rng, base)
    return Case("schema", number, words, {FILE: text, **base.files}, out)


def _solved(base: Base) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The solve of a quick problem, else its uncertainty: rows, cells and terms are built by it."""
    if base.is_quick:
        return ("--problem", FILE, "--json"), ()
    return ("uncertainty", "--problem", FILE, "--posture", base.posture, "--json"), ()


def _with(rng: random.Random, node: dict[str, Any], data: Any, way: Path, joints: tuple[str, ...], key: str) -> Any:
    """The data with what the last step of the way leads to; what stands there already stays where it fits."""
    node = resolved(node)
    if not way:
        return made(rng, node, joints, key)
    (step, which), rest = way[0], way[1:]
    if step == "choice":
        choice = resolved((node.get("oneOf") or node["anyOf"])[which])
        kind = choice.get("properties", {}).get("kind", {}).get("const")
        fits = isinstance(data, dict) and (kind is None or data.get("kind") == kind)
        return _with(rng, choice, data if fits or isinstance(data, list) else None, rest, joints, key)
    if step == "item":
        held = list(data) if isinstance(data, list) else []
        if held and rng.random() < 0.5:
            held[0] = _with(rng, node["items"], held[0], rest, joints, key)
            return held
        return [*held, _with(rng, node["items"], None, rest, joints, key)]
    held = data if isinstance(data, dict) else _needed(rng, node, joints)
    child = node["properties"][which]
    held[which] = _with(rng, child, held.get(which), rest, joints, which)
    return held


def _needed(rng: random.Random, node: dict[str, Any], joints: tuple[str, ...]) -> dict[str, Any]:
    """A section with the keys that it cannot do without."""
    needed = {*node.get("required", ()), "kind"} & {*node.get("properties", {})}
    return {name: made(rng, node["properties"][name], joints, name) for name in sorted(needed)}
