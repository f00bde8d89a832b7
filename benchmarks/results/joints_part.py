"""Cost against the number of joints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

import posture_opt as po
from benchmarks.calibration import timed
from benchmarks.results.section import Chart, Section

TEXT = (
    "Arms of 2 to 12 turning joints (a 0.3 m, d 0.1 m, α ±90° in turn), four sources a joint: one exact covariance of "
    "{count} in a call; and one insertion solved again by `PostureSelector`, tilt within 60°, at {targets} targets "
    "that a random posture reaches."
)
SIZES = {"theta": "0.3 mrad", "alpha": "0.1 mrad", "a": "0.05 mm", "d": "0.05 mm"}
JOINTS = (2, 3, 4, 5, 6, 7, 8, 9, 12)
HEADERS = ("joints", "one covariance ns", "one solve ms", "solved %")


def problem(n: int) -> Any:
    """A snake of n joints as the content of a problem file."""
    joints = [
        {"name": f"j{i}", "type": "revolute", "limits": ["-150 deg", "150 deg"], "a": "0.3 m", "d": "0.1 m"}
        | {"alpha": f"{90 if i % 2 else -90} deg", "theta": "0 deg"}
        for i in range(n)
    ]
    sigma = {f"j{i}.{key}": size for i in range(n) for key, size in SIZES.items()}
    task = {"kind": "insert", "direction": [0, 0, -1], "tilt": "60 deg", "position": ["0.3 m", "0.1 m", "0.1 m"]}
    return po.problem_from_dict(
        {"robot": {"kind": "dh", "joints": joints}, "cell": "none", "uncertainty": {"sigma": sigma}, "task": task}
    )


def measure(quick: bool) -> Iterator[Section]:
    rng = np.random.default_rng(0)
    count, targets = (10_000, 5) if quick else (100_000, 20)
    rows = []
    for n in JOINTS:
        given = problem(n)
        spread, selector = po.SpreadFunction(given), po.PostureSelector(given)
        Q = rng.uniform(-2.5, 2.5, (count, n))
        spread(Q)
        nanoseconds = 1e9 * timed(lambda s=spread, q=Q: s(q), 5)[0] / count
        seconds = []
        for position in reached(given, spread, rng, targets):
            answered, found = timed(lambda s=selector, p=position: _solved(s, p), 1)
            seconds.append((answered, found))
        solved = [t for t, found in seconds if found]
        milliseconds = 1e3 * float(np.median(solved)) if solved else None
        rows.append((n, nanoseconds, milliseconds, 100 * len(solved) / max(len(seconds), 1)))
    yield Section(
        "joints", "Cost against joints", TEXT.format(count=f"{count:,}".replace(",", " "), targets=targets),
        HEADERS, tuple(rows), ("d", ".0f", ".1f", ".0f"), (), Chart("one solve [ms]", (2,)),
    )  # fmt: skip


def reached(given: Any, spread: Any, rng: np.random.Generator, count: int) -> Iterator[tuple[float, ...]]:
    """Tool points of random postures whose tool axis points down within 50°."""
    n, found = given.robot.n, 0
    while found < count:
        Q = rng.uniform(-2.4, 2.4, (200, n))
        for q, position in zip(Q, spread.position(Q), strict=True):
            if found < count and _tool_axis(q)[2] < -np.cos(np.radians(50)):
                found += 1
                yield tuple(map(float, position))


def _tool_axis(q: np.ndarray) -> np.ndarray:
    """(3,) z of the tool in the base frame: turns by q about z and by ±90° about x, joint by joint."""
    axis = np.array([0.0, 0.0, 1.0])
    for i in reversed(range(len(q))):
        sign, c, s = (1 if i % 2 else -1), np.cos(q[i]), np.sin(q[i])
        x, y, z = axis[0], -sign * axis[2], sign * axis[1]
        axis = np.array([c * x - s * y, s * x + c * y, z])
    return axis


def _solved(selector: Any, position: tuple[float, ...]) -> bool:
    try:
        return bool(selector.solve(position=position).status != "infeasible")
    except po.errors.NoSolutionError:
        return False
