"""Sections of problem files made from the schema: whatever kinds it lists, they are made without a new line here."""

from __future__ import annotations

import random
from functools import cache
from typing import Any

from tests.fuzz.values import NUMBERS, odd, size, word
from tests.helpers.shipped import json_schema

_DEEPEST = 7


@cache
def definitions() -> dict[str, Any]:
    """All named nodes of the schema."""
    return dict(json_schema()["$defs"])


def section(rng: random.Random, name: str, joints: tuple[str, ...]) -> Any:
    """A value of a top key, ``task`` say, most of it plausible."""
    return made(rng, json_schema()["properties"][name], joints, name)


def made(rng: random.Random, node: dict[str, Any], joints: tuple[str, ...], key: str) -> Any:
    """A value for ``key`` by its schema, most of it plausible."""
    return _made(rng, node, joints, key, 0)


def resolved(node: dict[str, Any]) -> dict[str, Any]:
    """The schema that a reference names."""
    while "$ref" in node:
        node = definitions()[node["$ref"].rsplit("/", 1)[1]]
    return node


def _made(rng: random.Random, node: dict[str, Any], joints: tuple[str, ...], key: str, depth: int) -> Any:
    node = resolved(node)
    if rng.random() < 0.01 or depth > _DEEPEST:
        return odd(rng)
    choices = node.get("oneOf") or node.get("anyOf")
    if choices:
        return _made(rng, rng.choice(choices), joints, key, depth)
    if "const" in node or "enum" in node:
        return node["const"] if "const" in node else rng.choice(node["enum"])
    if "dimension" in node:
        return _quantity(rng, node["dimension"])
    kind = node.get("type")
    if kind == "object":
        return _mapping(rng, node, joints, key, depth)
    if kind == "array":
        return _list(rng, node, joints, key, depth)
    return _scalar(rng, node, joints, key)


def _mapping(rng: random.Random, node: dict[str, Any], joints: tuple[str, ...], key: str, depth: int) -> Any:
    needed = {*node.get("required", ()), "kind", "estimate"}
    share = rng.choice((0.1, 0.3, 0.7))
    made = {
        name: _made(rng, child, joints, name, depth + 1)
        for name, child in node.get("properties", {}).items()
        if name in needed or rng.random() < share
    }
    others = node.get("additionalProperties")
    if isinstance(others, dict):
        made |= {
            _parameter(rng, joints, key): _made(rng, others, joints, key, depth + 1) for _ in range(rng.randrange(4))
        }
    return made


def _list(rng: random.Random, node: dict[str, Any], joints: tuple[str, ...], key: str, depth: int) -> Any:
    fixed = node.get("prefixItems")
    if fixed:
        return [_made(rng, child, joints, key, depth + 1) for child in fixed]
    least = node.get("minItems", 0)
    return [_made(rng, node.get("items", {}), joints, key, depth + 1) for _ in range(rng.randrange(least, least + 4))]


def _scalar(rng: random.Random, node: dict[str, Any], joints: tuple[str, ...], key: str) -> Any:
    kind = node.get("type")
    if kind == "boolean":
        return rng.random() < 0.5
    if kind == "integer":
        return rng.choice((0, 1, 2, 3, 5, 10, 1000, -1))
    if kind == "number":
        return rng.choice((0, 1, -1, 0.5, 0.8, -0.3, 2, 1e-3, round(rng.gauss(0, 1), 3), rng.choice(NUMBERS)))
    if kind == "null":
        return None
    if node.get("examples") and rng.random() < 0.7:
        return rng.choice(node["examples"])
    if key in ("joint", "driver", "joints", "from_joint", "correlation") or rng.random() < 0.3:
        return rng.choice([*joints, *(f"{joint}.theta" for joint in joints), "base", "tool", "all"])
    return word(rng)


def _parameter(rng: random.Random, joints: tuple[str, ...], key: str) -> str:
    joint = rng.choice([*joints, "base", "tool"])
    if rng.random() < 0.1:
        return word(rng)
    if key in ("weights", "approach", "joints", "posture"):
        return joint
    return f"{joint}.{rng.choice(('theta', 'theta', 'a', 'd', 'alpha', 'beta', 'x', 'y', 'z', 'roll', 'yaw'))}"


def _quantity(rng: random.Random, dimension: str) -> Any:
    if rng.random() < 0.05:
        return rng.choice((0, odd(rng)))
    if dimension == "angle or length":
        dimension = rng.choice(("angle", "angle", "length"))
    return size(rng, dimension)
