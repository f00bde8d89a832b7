"""Cost against the number of obstacles."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

import posture_opt as po
from benchmarks.results.section import Chart, Section

TEXT = (
    "The insertion of a UR10 among vertical posts of 30 mm radius, above its mounting plane, 10 mm clear of all: "
    "repeated solves by `PostureSelector` at {targets} targets, in turns of the cells; processor time. The gap is that "
    "of the standard deviation in the cell over the one in the open, median: the posts matter. The first solve builds "
    "and compiles, in a fresh cache or not."
)
HEADERS = ("posts", "one solve ms", "slowest ms", "to the open", "gap %", "solved %", "first solve s")
POSTS = (0, 1, 3, 10, 30)
FREE_M = 0.15  # between the axis of a post and every target


def targets(count: int) -> np.ndarray:
    """(count, 3) [m], in reach."""
    rng = np.random.default_rng(3)
    return np.column_stack([rng.uniform(0.4, 0.8, count), rng.uniform(-0.3, 0.4, count), rng.uniform(0.05, 0.4, count)])


def problem(posts: int, points: np.ndarray) -> Any:
    """The insertion among the first posts of a row that is always the same."""
    rng, obstacles = np.random.default_rng(1), []
    while len(obstacles) < posts:
        (radius, turn, length) = rng.uniform((0.37, -np.pi, 0.4), (1.0, np.pi, 1.0))
        x, y = radius * np.cos(turn), radius * np.sin(turn)
        if np.min(np.hypot(points[:, 0] - x, points[:, 1] - y)) > FREE_M:
            place = {"xyz": [f"{x} m", f"{y} m", f"{length / 2 - 0.1} m"], "length": f"{length} m", "radius": "30 mm"}
            obstacles.append({"kind": "cylinder", "name": f"post{len(obstacles)}", **place})
    document = {
        "robot": {"kind": "preset", "name": "ur10"},
        "uncertainty": {"repeatability": "0.1 mm"},
        "cell": {"obstacles": obstacles, "clearance": "10 mm"},
        "task": {"kind": "insert", "direction": [0, 0, -1], "position": [f"{x} m" for x in points[0]]},
    }
    return po.problem_from_dict(document)


def measure(quick: bool) -> Iterator[Section]:
    points = targets(5 if quick else 20)
    first, selectors = {}, {}
    for posts in POSTS:
        began = time.perf_counter()
        selectors[posts] = po.PostureSelector(problem(posts, points), explains=False)
        _solved(selectors[posts], points[0])
        first[posts] = time.perf_counter() - began
    found = np.array([[_solved(selectors[posts], point) for posts in POSTS] for point in points])
    ms, sigma = 1e3 * np.median(found[:, :, 0], axis=0), found[:, :, 1]
    gap = 100 * (np.nanmedian(sigma / sigma[:, :1], axis=0) - 1)
    rows = [
        (posts, ms[k], 1e3 * np.max(found[:, k, 0]), ms[k] / ms[0], gap[k],
         100 * float(np.mean(np.isfinite(sigma[:, k]))), first[posts])
        for k, posts in enumerate(POSTS)
    ]  # fmt: skip
    yield Section(
        "cells", "Cost against obstacles", TEXT.format(targets=len(points)), HEADERS,
        tuple(tuple(map(float, row)) for row in rows), (".0f", ".1f", ".1f", ".1f", ".1f", ".0f", ".1f"), (),
        Chart("one solve [ms]", (1,)),
    )  # fmt: skip


def _solved(selector: Any, point: np.ndarray) -> tuple[float, float]:
    """Processor time [s] of one solve and its standard deviation, NaN where there is no answer."""
    began = time.process_time()
    try:
        sigma = selector.solve(position=tuple(map(float, point)), ordinary=0.0).sigma_max
    except po.errors.NoSolutionError:
        sigma = np.nan
    return time.process_time() - began, sigma
