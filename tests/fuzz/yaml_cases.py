"""Problem files: built-in ones with entries changed, sections made from the schema, and text that is hardly YAML."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from typing import Any

from posture_opt.problem.yaml_source import dump_yaml
from tests.fuzz.bases import Base, bases
from tests.fuzz.case import Case
from tests.fuzz.sections import definitions, section
from tests.fuzz.text_faults import spoil
from tests.fuzz.values import NUMBERS, UNITS, odd, word
from tests.helpers.shipped import json_schema

FILE = "p.yaml"
_SECTIONS = tuple(name for name in json_schema()["properties"] if name != "name")
_SNIPPETS = (
    "<<: *a", "<<: {kind: dh}", "<<: [1, 2]", "a: &a {b: *a}", "a: &a [*a, *a]", "? [1, 2] : 3", "? {a: b}",
    "!!python/name:os", "!!binary aGk=", "!!set {a, b}", "!!omap [a: 1]", "!!int x", "!!float mm", "!!bool 3",
    "!!null x", "!<x> y", "!!timestamp 2", "--- ", "...", "%YAML 1.1", "%TAG ! x:", "key: |\n  text\n",
    "key: >-\n  text", "key: 'a", 'key: "\\ud800"', 'key: "\\x00"', "{", "[", "}", "- -", ":", ": :", "- : -", "&",
    "*", "*x", "&x &y z", "!", "|", ">", "@", "`", "\t- x", "  \tx: 1", "#", "key:\tvalue", "'': 1", "~: 1",
    "null: 1", "true: 1", "1: 1", "1.5: 1", ".nan: 1", "[a]: 1", "name: [" * 30, "- " * 200, "{a: " * 100,
    "name: " + "x" * 9000,
    "a: &a [1]" + "".join(f"\n{b}: &{b} [{', '.join(['*' + a] * 8)}]" for a, b in zip("abcdef", "bcdefg", strict=True)),
)  # fmt: skip


def yaml_case(rng: random.Random, number: int) -> Case:
    """One call with a random problem file."""
    base = rng.choice(bases())
    data = base.copy()
    if rng.random() < 0.35:
        name = rng.choice(_SECTIONS)
        data[name] = section(rng, name, base.joints)
        if name == "robot" and isinstance(data[name], dict) and rng.random() < 0.5:
            data[name] = {**base.copy()["robot"], **data[name], "kind": base.data["robot"]["kind"]}
    if rng.random() < 0.15:
        name = rng.choice(_SECTIONS)
        data[name] = rng.choice(bases()).copy().get(name)
    for _ in range(rng.choice((0, 1, 1, 1, 2, 3))):
        change(rng, data)
    text = text_of(data)
    if rng.random() < 0.12:
        text = _with_snippet(rng, text)
    if rng.random() < 0.12:
        text = spoil(rng, text)
    words, out = command_words(rng, base)
    return Case("yaml", number, words, {FILE: text, **base.files}, out)


def command_words(rng: random.Random, base: Base) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """A command that reads the file, mostly a quick one; and what it may make."""
    problem = ("--problem", FILE)
    posture = ("--posture", base.posture)
    choice = rng.random()
    if choice < 0.6:
        return ("uncertainty", *problem, *posture, *_manner(rng)), ()
    if choice < 0.78:
        to = rng.choice((*("dh", "urdf", "urscript", "krl", "rapid", "jointstate") * 3, "python", "c"))
        placed = posture if to in ("urscript", "krl", "rapid", "jointstate") else ()
        return ("export", "--to", to, *problem, *placed, "--out", "o"), ("o",)
    if choice < 0.82:
        return ("simulate", *problem, *posture, "-n", "40", *_manner(rng)), ()
    if choice < 0.85:
        return ("uncertainty", *problem, *posture, "--out", "o", "--no-plots"), ("o",)
    if choice < 0.857:
        return ("plan-measurements", *problem, "--count", "3", "--candidates", "20", *_manner(rng)), ()
    if choice < 0.862 and base.is_quick:
        return ("map", *problem, "--grid", "2x2", *_manner(rng)), ()
    if choice < 0.865 and base.is_quick:
        return ("compare", FILE, "insert_planar_2r", *_manner(rng)), ()
    if choice < 0.8655:
        return ("uncertainty", *problem, *posture, "--out", "o"), ("o",)
    if choice < 0.9 and base.is_quick:
        return (*problem, *_manner(rng)), ()
    return ("uncertainty", *problem, "--posture", "0, 0", *_manner(rng)), ()


def _manner(rng: random.Random) -> tuple[str, ...]:
    return rng.choice(((), ("--json",), ("--json",), ("--full",), ("--quiet",)))


def change(rng: random.Random, data: dict[str, Any]) -> None:
    """Changes one entry somewhere."""
    places = list(_places(data))
    if not places:
        return
    if rng.random() < 0.5:  # not always in the longest list
        top = rng.choice([place[2] for place in places])
        places = [place for place in places if place[2] == top]
    holder, key, _ = rng.choice(places)
    rng.choice(_CHANGES)(rng, holder, key, data)


def _places(value: Any, top: Any = None) -> Iterator[tuple[Any, Any, Any]]:
    """All (mapping or list, key, top key)."""
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in list(entries):
        yield value, key, key if top is None else top
        yield from _places(entry, key if top is None else top)


def _drop(rng: random.Random, holder: Any, key: Any, data: Any) -> None:
    del holder[key]


def _odd(rng: random.Random, holder: Any, key: Any, data: Any) -> None:
    holder[key] = odd(rng)


def _rename(rng: random.Random, holder: Any, key: Any, data: Any) -> None:
    if isinstance(holder, dict):
        value, name = holder.pop(key), str(key)
        at = rng.randrange(len(name) + 1)
        holder[rng.choice((name[:at] + name[at + 1 :], name.upper(), f"{name}2", word(rng)))] = value


def _borrow(rng: random.Random, holder: Any, key: Any, data: Any) -> None:
    """Puts there what stands elsewhere in this file."""
    other, at, _ = rng.choice(list(_places(data)))
    holder[key] = _copied(other[at])


def _wrap(rng: random.Random, holder: Any, key: Any, data: Any) -> None:
    value = holder[key]
    holder[key] = rng.choice(([value], {"kind": value}, [value, value], {str(key): value}, str(value)))


def _length(rng: random.Random, holder: Any, key: Any, data: Any) -> None:
    """A list gets longer or shorter, a mapping one more key."""
    value = holder[key]
    if isinstance(value, list) and value:
        copies = rng.choice((0, 1, 2, 5))
        holder[key] = value[:-1] if copies == 0 else value + [_copied(value[-1]) for _ in range(copies)]
    elif isinstance(value, dict):
        value[word(rng)] = odd(rng)


def _number(rng: random.Random, holder: Any, key: Any, data: Any) -> None:
    """Another number, the unit stays; or another unit."""
    value = holder[key]
    if isinstance(value, str) and " " in value:
        number, unit = value.split(" ", 1)
        units = [unit for group in UNITS.values() for unit in group]
        if rng.random() < 0.75:
            number = str(rng.choice(NUMBERS))
        else:
            unit = rng.choice(units)
        holder[key] = f"{number} {unit}"
    elif isinstance(value, int | float):
        holder[key] = rng.choice(NUMBERS)


def _scale(rng: random.Random, holder: Any, key: Any, data: Any) -> None:
    """Times a power of ten: still a number with its unit."""
    value = holder[key]
    try:
        number, _, unit = str(value).partition(" ")
        changed = float(number) * rng.choice((-1, 0, 1e-12, 1e-6, 1e-3, 0.1, 10, 1e3, 1e6, 1e12))
    except ValueError:
        return
    holder[key] = f"{changed:g} {unit}" if unit else changed


def _kind(rng: random.Random, holder: Any, key: Any, data: Any) -> None:
    """Another kind of section with the keys of this one."""
    kinds = [node["properties"]["kind"] for node in definitions().values() if "kind" in node.get("properties", {})]
    for place, name, _ in _places(data):
        if name == "kind" and rng.random() < 0.4:
            place["kind"] = rng.choice(kinds).get("const")


def _shuffle(rng: random.Random, holder: Any, key: Any, data: Any) -> None:
    if isinstance(holder[key], list):
        rng.shuffle(holder[key])


_CHANGES: tuple[Callable[..., None], ...] = (
    _drop, _odd, _odd, _rename, _borrow, _wrap, _length, _number, _number, _scale, _scale, _scale, _kind, _shuffle,
)  # fmt: skip


def _copied(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copied(entry) for key, entry in value.items()}
    return [_copied(entry) for entry in value] if isinstance(value, list) else value


def text_of(data: Any) -> bytes:
    """The YAML of a document, whatever characters it has."""
    return dump_yaml(plain(data)).encode("utf-8", "surrogatepass")


def plain(value: Any) -> Any:
    """What YAML can write: trees without shared parts, keys that are texts."""
    if isinstance(value, dict):
        return {str(key): plain(entry) for key, entry in value.items()}
    return [plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def _with_snippet(rng: random.Random, text: bytes) -> bytes:
    lines = text.decode("utf-8", "surrogatepass").split("\n")
    at = rng.randrange(len(lines) + 1)
    lines.insert(at, " " * rng.choice((0, 0, 2, 4)) + rng.choice(_SNIPPETS))
    return "\n".join(lines).encode("utf-8", "surrogatepass")
