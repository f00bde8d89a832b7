"""The problems that travel with the package, as data to change: what random files begin with."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

import posture_opt as po
from tests.helpers.shipped import PROBLEMS, builtin_names

_PLAIN = {"type": "revolute", "a": "0.3 m", "alpha": "0 deg", "d": "0 m", "theta": "0 deg"}
_LIMITS = {"limits": ["-170 deg", "170 deg"]}
_OWN: dict[str, dict[str, Any]] = {
    # formats and joints that no built-in problem has
    "mdh": {
        "name": "mdh",
        "robot": {
            "kind": "mdh",
            "joints": [
                {"name": "j1", **_PLAIN, **_LIMITS, "mass": "3 kg", "com": ["0.1 m", "0 m", "0 m"]},
                {"name": "j2", **_PLAIN, "alpha": "90 deg", **_LIMITS, "gear_ratio": 101},
                {"name": "j3", **_PLAIN, "type": "prismatic", "limits": ["0 m", "0.4 m"]},
            ],
        },
        "uncertainty": {"sigma": {"j1.theta": "1 mrad", "j3.d": "0.1 mm", "base.x": "0.1 mm", "tool.z": "50 um"}},
        "effects": [{"kind": "backlash", "joint": "j1", "estimate": {"width": "0.2 mrad"}}],
    },
    "one": {
        "name": "one joint",
        "robot": {"kind": "dh", "joints": [{"name": "j", **_PLAIN, **_LIMITS}]},
        "uncertainty": {"sigma": {"j.theta": "1 mrad"}},
    },
}


@dataclass(frozen=True)
class Base:
    """A problem file as data, the joints of its robot, and the files that it names."""

    name: str
    data: dict[str, Any]
    joints: tuple[str, ...]
    files: dict[str, bytes]

    def copy(self) -> dict[str, Any]:
        """Its data, to change."""
        return copy.deepcopy(self.data)

    @property
    def is_quick(self) -> bool:
        """Whether its task is solved within a second or so: one target, and nothing in the way."""
        task = self.data.get("task") or {}
        return not {"features", "path", "workpiece"} & {*task} and "cell" not in self.data

    @property
    def posture(self) -> str:
        """A posture somewhere in its range."""
        return ", ".join(
            f"{name}={0.1 if unit == 'm' else 20 + 7 * i} {unit}" for i, (name, unit) in enumerate(self._units)
        )

    @property
    def sliding(self) -> frozenset[str]:
        """Its prismatic joints."""
        return _sliding(self.name)

    @property
    def _units(self) -> list[tuple[str, str]]:
        return [(joint, "m" if joint in self.sliding else "deg") for joint in self.joints]


@cache
def bases() -> tuple[Base, ...]:
    """All of them, the own ones last."""
    return (*map(_builtin, builtin_names()), *(_own(name) for name in _OWN))


@cache
def _sliding(name: str) -> frozenset[str]:
    return frozenset(joint.name for joint in _problem(name).robot.joints if joint.type == "prismatic")


@cache
def _problem(name: str) -> po.Problem:
    return po.problem_from_dict(_OWN[name]) if name in _OWN else po.load_problem(name)


def _builtin(name: str) -> Base:
    folder = PROBLEMS
    text = (folder / f"{name}.yaml").read_text(encoding="utf-8")
    named = [path for path in folder.iterdir() if path.suffix in (".csv", ".urdf") and path.name in text]
    files = {path.name: path.read_bytes() for path in named}
    return Base(name, yaml.safe_load(text), _joints(name), files)


def _own(name: str) -> Base:
    return Base(name, _OWN[name], _joints(name), {})


def _joints(name: str) -> tuple[str, ...]:
    return tuple(joint.name for joint in _problem(name).robot.joints)


def problem_file(name: str) -> Path:
    """A file of the folder of built-in problems."""
    return PROBLEMS / name
