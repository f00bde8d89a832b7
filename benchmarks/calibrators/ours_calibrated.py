"""`calibrate` as it comes; its stated error is cross-validated within the rows that it learns from."""

from __future__ import annotations

from typing import Any

import posture_opt as po
from benchmarks.calibrators import Answer, Array, Task

TITLE = "posture_opt, calibrate"
PACKAGES = ("posture_opt",)


def measured(task: Task, learned: Array, asked: Array) -> tuple[po.Problem, po.Measurements, po.Measurements]:
    """The problem of a task, the rows to learn from, and those to predict."""
    problem = po.load_problem(task.problem)
    data = po.read_measurements(task.data, problem)
    return problem, data.take(task.rows[learned]), data.take(task.rows[asked])


def fit(task: Task, learned: Array, asked: Array) -> Answer:
    problem, mine, other = measured(task, learned, asked)
    found = po.calibrate(problem, mine, test=other, plan=False)
    assert found.test is not None  # asked for
    document: dict[str, Any] = found.to_json()
    sizes = {p["name"]: (p["estimate"], p["std"]) for p in document["parameters"] if p["determined"] and p["std"]}
    return Answer(found.test.errors["calibrated"], found.calibrated.rms, sizes, found.identifiability.rank)
