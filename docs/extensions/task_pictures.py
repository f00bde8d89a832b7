"""A picture of every task, and a table that compares them: one planar arm, one place, solved for each task."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from drawing import BLUE, DARK, PALE, RED, Array, arm, arrow, at, canvas, ellipse, note, save
from matplotlib.axes import Axes

import posture_opt as po

LINK = {"alpha": "0 deg", "limits": ["-180 deg", "180 deg"]}
NAMES = ("shoulder", "elbow", "wrist")
ROBOT = {
    "kind": "dh",
    "joints": [{"name": n, "a": a, **LINK} for n, a in zip(NAMES, ("0.5 m", "0.4 m", "0.2 m"), strict=True)],
    "tool": {"xyz": ["0 m", "0 m", "0 m"], "rpy": ["0 deg", "90 deg", "0 deg"]},
}
SIGMA = {"shoulder.theta": "2 mrad", "elbow.theta": "2 mrad", "wrist.theta": "4 mrad", "elbow.a": "3 mm"}
TARGET = ["0.55 m", "0.25 m", "0 m"]
DOWN = {"direction": [0, -1, 0]}
ENLARGED, ENLARGED_ON_PATHS = 40, 15  # times one standard deviation is drawn
SINGLE = {
    "insert": DOWN,
    "drill": DOWN,
    "probe": DOWN,
    "measure": {},
    "hold": DOWN,
    "place": {**DOWN, "lever": "80 mm"},
}
PATHS = ("trace", "weld")


def draw_tasks(folder: Path) -> str:
    """Write ``task_KIND.png`` of every task, of paths with a free and a held tool; the comparison in Markdown."""
    rows = ["| task | across [mm] | along [mm] | worst in space [mm] | elbow |", "| --- | --: | --: | --: | --- |"]
    for kind, keys in SINGLE.items():
        found = po.select_posture(_problem({"kind": kind, "position": TARGET, **keys}))
        _draw_single(kind, found, folder)
        rows.append(_row(kind, found))
    for kind in PATHS:
        points = [[f"{x} m", "0.25 m", "0 m"] for x in (0.45, 0.55, 0.65)]
        direction = {} if kind == "trace" else DOWN
        _draw_path(kind, po.select_posture(_problem({"kind": kind, "points": points, **direction})), folder)
    return "\n".join(rows) + "\n"


def _problem(task: dict[str, Any]) -> po.Problem:
    return po.problem_from_dict({"robot": ROBOT, "uncertainty": {"sigma": SIGMA}, "task": task})


def _row(kind: str, found: Any) -> str:
    across, along = _sizes(found.covariance)
    worst = 1e3 * float(np.sqrt(np.linalg.eigvalsh(found.covariance)[-1]))
    cells = {"across": f"{across:.2f}", "along": f"{along:.2f}", "all": f"{worst:.2f}"}
    within = found.problem.task.within
    cells[within] = f"**{cells[within]}**"
    side = "up" if found.posture["elbow"] < 0 else "down"
    return f"| {{doc}}`{kind}` | {cells['across']} | {cells['along']} | {cells['all']} | {side} |"


def _sizes(covariance: Array) -> tuple[float, float]:
    """Standard deviation across the vertical and along it, in the plane of the arm [mm]."""
    across, along = 1e3 * np.sqrt(np.diag(covariance)[:2])
    return float(across), float(along)


def _draw_single(kind: str, found: Any, folder: Path) -> None:
    figure, axes = canvas()
    tool = arm(axes, list(found.posture.values()))[-1]
    ellipse(axes, tool, found.covariance[:2, :2], ENLARGED)
    across, along = (ENLARGED * size / 1e3 for size in _sizes(found.covariance))
    task = found.problem.task
    if task.within == "across":
        arrow(axes, tool - at(across, 0), tool + at(across, 0), RED, both=True)
    elif task.within == "along":
        arrow(axes, tool - at(0, along), tool + at(0, along), RED, both=True)
    else:
        ellipse(axes, tool, found.covariance[:2, :2], ENLARGED, RED, fill=False)
    if kind != "measure":
        _direction(axes, tool)
    note(axes, tool, f"σ that counts, × {ENLARGED}", RED, (-125, -3) if tool[0] > 0.5 else (8, 6))
    save(figure, folder, f"task_{kind}")


def _direction(axes: Axes, tool: Array) -> None:
    start = tool + at(0.22, 0.1)
    arrow(axes, start, start - at(0, 0.2), DARK, "direction")


def _draw_path(kind: str, found: Any, folder: Path) -> None:
    figure, axes = canvas()
    postures = [list(station.posture.values()) for station in found.stations]
    for k, q in enumerate(postures):
        tool = arm(axes, q, color=DARK if k == len(postures) - 1 else PALE)[-1]
        covariance = found.stations[k].spread.covariance[:2, :2]
        ellipse(axes, tool, covariance, ENLARGED_ON_PATHS, BLUE)
        height = ENLARGED_ON_PATHS * float(np.sqrt(covariance[1, 1]))
        arrow(axes, tool - at(0, height), tool + at(0, height), RED, both=True)
    arrow(axes, tool + at(0.04, 0), tool + at(0.22, 0), DARK, "travel")
    save(figure, folder, f"task_{kind}")
