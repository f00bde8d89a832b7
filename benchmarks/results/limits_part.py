"""What a user waits for, as ratios to something measured in the same run, beside the ratio that it may have.

Most are beside 200 inverse kinematics samples of roboticstoolbox for a UR10, about 10 ms of one core: a limit of 8 s is
a ratio of 800. Processor time, the ways in turns; medians over the targets of the shortest of a few runs each.
"""

from __future__ import annotations

import contextlib
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import posture_opt as po
from benchmarks.arms import ARMS, UR10
from benchmarks.results import cells_part, joints_part
from benchmarks.results.section import Section
from benchmarks.rows import measured_run, write_files
from benchmarks.targets import draw
from benchmarks.ways import ours, rtb_sampling

HEADERS = ("what", "CPU ms", "beside", "its CPU ms", "ratio", "at most")
SAMPLES = "200 IK samples, {}"
HELD = {
    "robot": {"kind": "preset", "name": "panda"},
    "cell": {"obstacles": [], "clearance": "20 mm"},
    "uncertainty": {"repeatability": "0.1 mm"},
    "task": {"kind": "measure", "position": ["0.4 m", "0.1 m", "0.6 m"]},
}
"""With joint 6 held at 0.3 rad the wrist is nearer to itself than the clearance; at 0.97 rad it is not."""
COMMANDS = {
    "--task insert --robot ur10, cold": (["--task", "insert", "--robot", "ur10", "--json", "--quiet"], 200.0),
    "diagnosis with its plan, 110 rows": (
        ["diagnose", "problems/ur10_measured.csv", "--problem", "problems/insert_ur10_measured.yaml", "--json"], 250.0
    ),
}  # fmt: skip
Row = tuple[str, float, str, float, float, float]


def measure(quick: bool) -> Iterator[Section]:
    runs, count = (2, 4) if quick else (5, 20)
    rows, clock = [], 0.0
    for arm in ARMS:
        points, ways = draw(arm, count, 0).positions, (ours.build(arm), rtb_sampling.build(arm))
        mine, clock = _together([[partial(way, point) for way in ways] for point in points], runs)
        rows.append(
            _row(
                f"repeated solve, {arm.name}", mine, SAMPLES.format(arm.name), clock, {"Panda": 0.08}.get(arm.name, 0.1)
            )
        )
    rows += _cells(count, runs)
    beside = SAMPLES.format(UR10.name), clock
    rows += [
        _row(f"repeated solve, {n} joints", _joints(n, count, runs), *beside, most) for n, most in ((9, 4.0), (12, 8.0))
    ]
    rows.append(
        _row(
            "success of ten features, shared errors",
            _seconds(partial(po.select_posture, _ten_features())),
            *beside,
            800.0,
        )
    )
    rows.append(_row("no solution, and why", _failing(0.3), "a solution of it", _failing(0.97), 3.0))
    rows += [_row(what, 1e3 * _command(given), *beside, most) for what, (given, most) in COMMANDS.items()]
    with tempfile.TemporaryDirectory() as name:
        write_files(Path(name), "ur10", 1000, False)
        given = ["diagnose", f"{name}/data.csv", "--problem", f"{name}/problem.yaml", "--json"]
        rows.append(_row("diagnosis with its plan, 1 000 rows", 1e3 * _command(given), *beside, 800.0))
    yield Section(
        "limits", "What a user waits for", " ".join((__doc__ or "").split("\n\n", 1)[1].split()),
        HEADERS, tuple(rows), ("", ".2f", "", ".2f", ".3g", ".3g"),
    )  # fmt: skip


def _row(what: str, mine: float, beside: str, its: float, most: float) -> Row:
    return what, mine, beside, its, mine / its, most


def _seconds(call: Callable[[], Any]) -> float:
    """Processor time of one call [ms]; one without a solution counts as any other."""
    began = time.process_time()
    with contextlib.suppress(po.errors.NoSolutionError):
        call()
    return 1e3 * (time.process_time() - began)


def _together(calls: list[list[Callable[[], Any]]], runs: int) -> np.ndarray:
    """Of each way the median over the targets [ms]; each target is done by all ways in turns, and ``runs`` times."""
    for call in calls[0]:
        call()
    return np.median([[min(_seconds(call) for _ in range(runs)) for call in ways] for ways in calls], axis=0)


def _cells(count: int, runs: int) -> Iterator[Row]:
    """A UR10 among one post and thirty, beside the one in the open."""
    points = cells_part.targets(count)
    arms = [po.PostureSelector(cells_part.problem(posts, points), explains=False) for posts in (0, 1, 30)]
    calls = [[partial(arm.solve, tuple(point)) for arm in arms] for point in points]
    bare, one, many = _together(calls, runs)
    yield _row("repeated solve, UR10, one post", one, "no post", bare, 3.0)
    yield _row("repeated solve, UR10, 30 posts", many, "no post", bare, 7.0)


def _joints(n: int, count: int, runs: int) -> float:
    """A repeated solve of an arm of n joints [ms]."""
    given = joints_part.problem(n)
    selector, rng = po.PostureSelector(given), np.random.default_rng(0)
    points = joints_part.reached(given, po.SpreadFunction(given), rng, count)
    return float(_together([[partial(selector.solve, point)] for point in points], runs)[0])


def _ten_features() -> Any:
    """A UR10 and ten holes in two rows on a workpiece that may move, joint errors the same at all of them."""
    places = [(40 * (k % 5) - 80, 60 * (k // 5) - 30) for k in range(10)]
    features = [{"name": f"hole {k}", "position": [f"{x} mm", f"{y} mm", "0 mm"]} for k, (x, y) in enumerate(places)]
    workpiece = {"x": ["0.5 m", "0.8 m"], "y": ["-0.3 m", "0.3 m"], "z": "0.1 m", "yaw": "0 deg"}
    task = {"kind": "insert", "direction": [0, 0, -1], "clearance": "0.3 mm", "combine": "success"}
    sigma = {f"{joint}.theta": "0.3 mrad" for joint in ("shoulder_pan", "shoulder_lift", "elbow")}
    return po.problem_from_dict({
        "robot": {"kind": "preset", "name": "ur10"}, "uncertainty": {"sigma": sigma},
        "task": task | {"workpiece": workpiece, "features": features},
    })  # fmt: skip


def _failing(held: float) -> float:
    """Processor time of a solve with joint 6 held at so many rad [ms]."""
    term = {"kind": "fixed_joints", "values": {"panda_joint6": f"{held} rad", "panda_joint7": "0 rad"}}
    problem = po.problem_from_dict(HELD | {"task": HELD["task"] | {"subject_to": [term]}})  # type: ignore[operator]
    return _seconds(partial(po.select_posture, problem))


def _command(given: list[str]) -> float:
    """Processor time of a command in a process of its own [s]."""
    return measured_run([sys.executable, "-m", "posture_opt", *given])[0]
