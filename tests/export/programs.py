"""Readers of robot programs, written from the manuals of the languages: joint values in rad and m, stop by stop."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import yaml

Files = Mapping[str, str]
NUMBER = r"[-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?"


def urscript(files: Files, types: Sequence[str]) -> list[list[float]]:
    """``movej([…], a=…, v=…)`` or ``movel([…], a=…, v=…, r=…)`` inside of ``def name(): … end``."""
    (text,) = files.values()
    code = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    assert re.fullmatch(r"def \w+\(\):", code[0])
    assert code[-1] == "end"
    assert all(line.startswith(" ") for line in code[1:-1])
    pattern = rf"\s+move[jl]\(\[(.*)\], a=({NUMBER}), v=({NUMBER})(?:, r=({NUMBER}))?\)"
    moves = [re.fullmatch(pattern, line) for line in code[1:-1]]
    return [[float(v) for v in move[1].split(",")] for move in moves if move]


def krl(files: Files, types: Sequence[str]) -> list[list[float]]:
    """``PTP name`` in the .src file, ``DECL E6AXIS name={A1 …}`` in the .dat file."""
    source = next(text for name, text in files.items() if name.endswith(".src"))
    data = next(text for name, text in files.items() if name.endswith(".dat"))
    name = next(iter(files)).rpartition(".")[0]
    assert f"\nDEF {name}()\n" in source and source.endswith("END\n")  # noqa: PT018
    assert f"\nDEFDAT {name}\n" in data and data.endswith("ENDDAT\n")  # noqa: PT018
    assert source.index("BAS(#INITMOV, 0)") < source.index("PTP ")
    known = {}
    for variable, inside in re.findall(r"^DECL E6AXIS (\w+)=\{(.*)\}$", data, re.MULTILINE):
        axes = dict(entry.split() for entry in inside.split(","))
        assert list(axes)[:6] == [f"A{k}" for k in range(1, 7)]
        known[variable] = si([float(v) for v in axes.values()], types)
    assert len(re.findall("^LIN XL", source, re.MULTILINE)) == source.count("FORWARD(")
    return [known[a or b] for a, b in re.findall(r"^PTP (\w+)$|^XL=FORWARD\((\w+), FAULT\)$", source, re.MULTILINE)]


def rapid(files: Files, types: Sequence[str]) -> list[list[float]]:
    """``MoveAbsJ name\\NoEOffs, v1000, fine, tool0;`` of ``CONST jointtarget name := [[…], […]];``."""
    (text,) = files.values()
    assert text.startswith("MODULE ") and text.endswith("ENDMODULE\n")  # noqa: PT018
    assert all(
        line.endswith(";") for line in text.splitlines() if re.match(r"\s+(CONST|MoveAbsJ|WaitTime|VelSet)", line)
    )
    known = {}
    for variable, robot, external in re.findall(r"CONST jointtarget (\w+) := \[\[(.*)\], \[(.*)\]\];", text):
        assert len(robot.split(",")) == len(external.split(",")) == 6
        values = [float(v) for v in robot.split(",")] + [float(v) for v in external.split(",") if float(v) < 9e9]
        known[variable] = si(values, types)
    joints = r"MoveAbsJ (\w+)\\NoEOffs, v1000, fine, \w+;"
    lines = r"MoveL CalcRobT\((\w+), \w+_tool\), \w+_v, (?:fine|z0|z1), \w+_tool;"
    return [known[a or b] for a, b in re.findall(f"{joints}|{lines}", text)]


def jointstate(files: Files, types: Sequence[str]) -> list[list[float]]:
    """The YAML of a message; a point where the arm waits is in it twice."""
    (text,) = files.values()
    message = yaml.safe_load(text)
    if "position" in message:
        assert len(message["name"]) == len(message["position"])
        return [message["position"]]
    found: list[list[float]] = []
    for point in message["points"]:
        found += [point["positions"]] if not found or point["positions"] != found[-1] else []
    return found


def si(values: Sequence[float], types: Sequence[str]) -> list[float]:
    """Degrees and mm as rad and m; what the arm has no joints for is zero."""
    assert not any(values[len(types) :])
    return [np.radians(v) if kind == "revolute" else v / 1e3 for v, kind in zip(values, types, strict=False)]


READERS: dict[str, Callable[[Files, Sequence[str]], list[list[float]]]] = {
    "urscript": urscript,
    "krl": krl,
    "rapid": rapid,
    "jointstate": jointstate,
}
