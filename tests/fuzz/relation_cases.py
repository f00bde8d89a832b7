"""Pairs of calls whose answers must be related: units, frames, order, names, mirror, scale, split variance."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from tests.fuzz.bases import Base, bases
from tests.fuzz.case import Case, Similarity
from tests.fuzz.yaml_cases import FILE, text_of

_QUANTITY = re.compile(r"(-?[\d.]+(?:[eE][+-]?\d+)?) (m|mm|um|cm|deg|rad|mrad|arcsec)")
_IN_SI = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "cm": 1e-2, "deg": math.pi / 180, "rad": 1.0, "mrad": 1e-3,
          "arcsec": math.pi / 648_000}  # fmt: skip
_LENGTHS, _ANGLES = ("m", "mm", "um", "cm"), ("deg", "rad", "mrad", "arcsec")
_ODD = ("theta", "alpha", "y", "roll", "yaw")  # parameters that a mirror turns round: it keeps x, z, a, d and pitch


_SAME = Similarity()


@dataclass(frozen=True)
class Ask:
    """A problem as data, a posture in SI units, and how its tool point lies to that of the first one."""

    data: dict[str, Any]
    posture: dict[str, float]
    similarity: Similarity = _SAME


def relation_case(rng: random.Random, number: int) -> Case:
    """Two calls: a built-in problem, and the same said or placed otherwise."""
    fits, other = rng.choice(_RELATIONS)
    base = rng.choice([base for base in bases() if fits(base)])
    data = base.copy()
    for name, text in list(data.get("uncertainty", {}).get("sigma", {}).items()):
        data["uncertainty"]["sigma"][name] = _times(text, 10 ** rng.uniform(-2, 0))
    sliding = base.sliding
    posture = {j: rng.uniform(0.05, 0.2) if j in sliding else rng.uniform(-1.5, 1.5) for j in base.joints}
    first = Ask(data, posture)
    second = other(rng, base, first)
    if rng.random() < 0.05 and base.is_quick and len(base.joints) < 3 and other in _SAID_OTHERWISE:
        words: tuple[str, ...] = ("--problem", FILE, "--json")
        return replace(
            _case(number, base, first, words), twin=_case(number, base, second, words), similarity=second.similarity
        )
    one, two = (_case(number, base, ask, _uncertainty(ask, base)) for ask in (first, second))
    return replace(one, twin=two, similarity=second.similarity)


def _case(number: int, base: Base, ask: Ask, words: tuple[str, ...]) -> Case:
    text = text_of(ask.data)
    return Case("relation", number, words, {FILE: text, **base.files})


def _uncertainty(ask: Ask, base: Base) -> tuple[str, ...]:
    units = ["m" if joint in base.sliding else "rad" for joint in base.joints]
    values = ", ".join(f"{value!r} {unit}" for value, unit in zip(ask.posture.values(), units, strict=True))
    return ("uncertainty", "--problem", FILE, "--posture", values, "--json")


def _times(text: Any, factor: float, only: tuple[str, ...] = (*_LENGTHS, *_ANGLES)) -> Any:
    """A quantity times a number; what is none of these units stays."""
    found = _QUANTITY.fullmatch(text) if isinstance(text, str) else None
    return f"{float(found[1]) * factor!r} {found[2]}" if found and found[2] in only else text


def _mapped(value: Any, change: Callable[[Any], Any]) -> Any:
    """A tree with every entry changed."""
    if isinstance(value, dict):
        return {key: _mapped(entry, change) for key, entry in value.items()}
    return [_mapped(entry, change) for entry in value] if isinstance(value, list) else change(value)


def _other_units(rng: random.Random, base: Base, first: Ask) -> Ask:
    def said(text: Any) -> Any:
        found = _QUANTITY.fullmatch(text) if isinstance(text, str) else None
        if found is None:
            return text
        unit = rng.choice(_LENGTHS if found[2] in _LENGTHS else _ANGLES)
        return f"{float(found[1]) * _IN_SI[found[2]] / _IN_SI[unit]!r} {unit}"

    return Ask(_mapped(first.data, said), first.posture)


def _other_names(rng: random.Random, base: Base, first: Ask) -> Ask:
    fresh = rng.sample(("q_a", "axis 1", "é", "z9", "A", "elbow", "j.1", "Gelenk-2", "関節", "x_2"), len(base.joints))
    names = dict(zip(base.joints, fresh, strict=True))

    def named(text: Any) -> Any:
        joint, dot, rest = text.rpartition(".") if isinstance(text, str) else ("", "", "")
        return names.get(text, names[joint] + dot + rest if joint in names else text) if isinstance(text, str) else text

    def keyed(value: Any) -> Any:
        if isinstance(value, dict):
            return {named(key): keyed(entry) for key, entry in value.items()}
        return [keyed(entry) for entry in value] if isinstance(value, list) else named(value)

    return Ask(keyed(first.data), {names[joint]: value for joint, value in first.posture.items()})


def _other_order(rng: random.Random, base: Base, first: Ask) -> Ask:
    def turned(value: Any) -> Any:
        if isinstance(value, dict):
            keys = rng.sample(list(value), len(value))
            return {key: turned(value[key]) for key in keys}
        return [turned(entry) for entry in value] if isinstance(value, list) else value

    data = turned(first.data)
    for section, key in (("cell", "obstacles"), ("uncertainty", "correlation"), ("task", "subject_to")):
        if isinstance(data.get(section), dict) and isinstance(data[section].get(key), list):
            rng.shuffle(data[section][key])
    return Ask(data, first.posture)


def _other_base(rng: random.Random, base: Base, first: Ask) -> Ask:
    yaw, shift = rng.uniform(-3, 3), [rng.uniform(-2, 2) for _ in range(3)]
    frame = {"xyz": [f"{x!r} m" for x in shift], "rpy": ["0 deg", "0 deg", f"{yaw!r} rad"]}
    c, s = math.cos(yaw), math.sin(yaw)
    placed = Similarity(1.0, ((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)), tuple(shift))  # type: ignore[arg-type]
    robot = {**first.data["robot"], "base": frame}
    return Ask({**_arm_alone(first.data), "robot": robot}, first.posture, placed)


def _mirrored(rng: random.Random, base: Base, first: Ask) -> Ask:
    data = _arm_alone(_copied(first.data))
    for joint in data["robot"]["joints"]:
        for key in ("theta", "alpha"):
            joint[key] = _times(joint[key], -1.0)
        if joint.get("type", "revolute") == "revolute" and "limits" in joint:
            joint["limits"] = [_times(end, -1.0) for end in reversed(joint["limits"])]
    tool = data["robot"].get("tool", {})
    if isinstance(tool, dict) and "xyz" in tool:
        tool["xyz"][1] = _times(tool["xyz"][1], -1.0)
    for one in data["uncertainty"].get("correlation", ()):
        turns = sum(str(name).rpartition(".")[2] in _ODD for name in one[:2])
        one[2] = one[2] * (-1) ** turns
    posture = {j: value if j in base.sliding else -value for j, value in first.posture.items()}
    return Ask(data, posture, Similarity(1.0, ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))))


def _ten_times(rng: random.Random, base: Base, first: Ask) -> Ask:
    data = _mapped(_arm_alone(first.data), lambda text: _times(text, 10.0, _LENGTHS))
    posture = {j: 10 * value if j in base.sliding else value for j, value in first.posture.items()}
    return Ask(data, posture, Similarity(10.0))


def _split(rng: random.Random, base: Base, first: Ask) -> Ask:
    """A variance as the sum of two, that of an error that stays and that of a new draw each time."""
    turn = rng.uniform(0.1, 1.4)
    sigma = first.data["uncertainty"]["sigma"]
    parts = {
        name: {key: _times(text, share) for key, text in sigma.items()}
        for name, share in (("sigma", math.cos(turn)), ("scatter", math.sin(turn)))
    }
    return Ask({**first.data, "uncertainty": {**first.data["uncertainty"], **parts}}, first.posture)


def _arm_alone(data: dict[str, Any]) -> dict[str, Any]:
    """Robot and uncertainty: what a task and a cell say lies where it lay."""
    return {key: data[key] for key in ("name", "robot", "uncertainty") if key in data}


def _copied(value: Any) -> Any:
    return _mapped(value, lambda entry: entry)


def _any(base: Base) -> bool:
    data = base.data.get("data", {})
    files = "covariance" in base.data.get("uncertainty", {}) or "cameras" in data or "pairs" in data
    return base.data["robot"]["kind"] != "urdf" and not files


def _own_rows(base: Base) -> bool:
    kinds = ("dh", "mdh")
    return _any(base) and base.data["robot"]["kind"] in kinds and "measurement" not in base.data["uncertainty"]


def _plain_rows(base: Base) -> bool:
    return _own_rows(base) and not base.data.get("effects")


def _placeable(base: Base) -> bool:
    stated = base.data["uncertainty"].get("sigma", {}) if "uncertainty" in base.data else {}
    fixed = "base" not in base.data["robot"] and not any(str(name).startswith("base.") for name in stated)
    return _any(base) and fixed and not base.data.get("effects") and "uncertainty" in base.data


def _stated(base: Base) -> bool:
    stated = base.data.get("uncertainty", {})
    return _any(base) and "sigma" in stated and not {"scatter", "correlation", "repeatability"} & {*stated}


_SAID_OTHERWISE = (_other_units, _other_names, _other_order)
_RELATIONS: tuple[tuple[Callable[[Base], bool], Callable[[random.Random, Base, Ask], Ask]], ...] = (
    (_any, _other_units), (_own_rows, _other_names), (_any, _other_order), (_placeable, _other_base),
    (_plain_rows, _mirrored), (_plain_rows, _ten_times), (_stated, _split),
)  # fmt: skip
