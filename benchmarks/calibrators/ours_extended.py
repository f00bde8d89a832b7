"""`diagnose` as it comes: geometry and the effects that it finds; sizes of effects stand in `benchmarks.halves`."""

from __future__ import annotations

import posture_opt as po
from benchmarks.calibrators import Answer, Array, Task
from benchmarks.calibrators.ours_calibrated import measured

TITLE = "posture_opt, diagnose"
PACKAGES = ("posture_opt",)


def fit(task: Task, learned: Array, asked: Array) -> Answer:
    problem, mine, other = measured(task, learned, asked)
    found = po.diagnose(problem, mine, test=other, plan=False)
    assert found.test is not None  # asked for
    return Answer(found.test.file.errors["extended"], found.errors["extended"].rms)
