"""Errors of touched points that were held out: those of a touch about its point, however few touches a fold holds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import posture_opt as po

LENGTHS = (0.5, 0.4, 0.2)  # m
NOISE = 1e-4  # m
PLACES = {"p": (0.5, 0.1), "q": (0.2, 0.5), "r": (-0.4, 0.4), "s": (0.1, -0.6)}  # m


def distance(a: str, b: str) -> str:
    return f"{float(np.linalg.norm(np.subtract(PLACES[a], PLACES[b])))!r} m"


def problem() -> po.Problem:
    joints = [{"name": f"joint{i + 1}", "a": f"{length} m"} for i, length in enumerate(LENGTHS)]
    return po.problem_from_dict({
        "robot": {"kind": "dh", "joints": joints},
        "uncertainty": {"measurement": {"position": f"{NOISE} m"}},
        "data": {"distances": [["p", "q", distance("p", "q")], ["r", "s", distance("r", "s")]]},
    })  # fmt: skip


def touches(rng: np.random.Generator, count: int) -> dict[str, Any]:
    """Touches of each place in ``count`` postures, off by the noise: the last link from anywhere, elbow up or down."""
    a, b, c = LENGTHS
    rows: list[tuple[Any, ...]] = []
    for name, place in PLACES.items():
        while len(rows) < count * (1 + list(PLACES).index(name)):
            angle = rng.uniform(-np.pi, np.pi)
            x, y = np.array(place) + rng.normal(0, NOISE, 2) - c * np.array([np.cos(angle), np.sin(angle)])
            cosine = (x * x + y * y - a * a - b * b) / (2 * a * b)
            if abs(cosine) < 0.98:
                second = rng.choice([-1, 1]) * np.arccos(cosine)
                first = np.arctan2(y, x) - np.arctan2(b * np.sin(second), a + b * np.cos(second))
                rows.append((name, first, second, angle - first - second))
    point, *q = zip(*rows, strict=True)
    return {"point": point} | {f"joint{j + 1} [rad]": values for j, values in enumerate(q)}


def test_the_rms_of_held_out_touches_is_that_about_their_points() -> None:
    """4 touches of a point in 5 folds: from the mean of what a fold holds, less than half would be left."""
    rng, given = np.random.default_rng(100), problem()
    tables = [po.read_measurements(touches(rng, 4), given) for _ in range(5)]
    found = [po.calibrate(given, table, by="place", priors=False) for table in tables]
    true = NOISE * np.sqrt(2)
    nominal, calibrated = (
        float(np.sqrt(np.mean([getattr(one, name).rms ** 2 for one in found]))) for name in ("nominal", "calibrated")
    )
    assert nominal == pytest.approx(true, rel=0.15)  # of 5 · 4 · 6 free coordinates: 6 % is one standard deviation
    assert nominal < calibrated < 1.4 * true  # what rows teach of five parameters costs


def test_a_fold_without_the_end_of_a_distance_does_not_shrink_the_arm() -> None:
    """Two touches of p, both left out: what lies at 0.5 m from q is then anywhere, and an arm of no size fits."""
    given = po.problem_from_dict({**problem().to_dict(), "data": {"distances": [["p", "q", distance("p", "q")]]}})
    table = touches(np.random.default_rng(7), 10)
    rows = [i for i, name in enumerate(table["point"]) if name != "p" or i < 2]
    few = {name: [values[i] for i in rows] for name, values in table.items()}
    found = po.calibrate(given, po.read_measurements(few, given), by="place", priors=False)
    assert found.held["calibrated"].unsettled == 0
    others = [np.asarray(few["point"]) == name for name in "qrs"]
    for own in others:
        assert np.sqrt(np.mean(np.sum(found.held["calibrated"].errors[own] ** 2, axis=1))) > 0.6 * NOISE * np.sqrt(2)


def test_four_touches_of_one_spike_give_the_tool() -> None:
    """No more numbers than an arm has parameters: the arm is held within its tolerances, and the tool is found."""
    robot = {"kind": "preset", "name": "ur5e", "tool": "free"}
    problem = po.problem_from_dict({"robot": robot, "uncertainty": {"measurement": {"position": "0.2 mm"}}})
    degrees = (
        (-14.6866, -112.4709, -91.0631, -101.4136, 111.2446, -114.2785),
        (-8.7684, -92.7152, -111.5720, -76.7178, 108.9927, -12.7890),
        (-16.6020, -101.0274, -109.7662, -63.9449, 119.9254, -174.2740),
        (-11.3507, -103.9577, -101.7317, -76.9925, 110.3538, -180.3466),
    )  # of an arm with errors and a tool at 12, -35, 168 mm
    table = {
        f"{name} [deg]": column
        for name, column in zip(problem.robot.joint_names, zip(*degrees, strict=True), strict=True)
    }
    found = po.calibrate(problem, po.read_measurements({**table, "point": ["spike"] * 4}, problem), plan=False)
    estimate = {p.name: float(x) for p, x in zip(found.fit.residuals.parameters, found.x, strict=True)}
    assert [estimate[f"tool.{axis}"] for axis in "xyz"] == pytest.approx((0.012, -0.035, 0.168), abs=5e-4)
