"""What the report says and draws of residuals: sentences in plain words, figures that show what they claim."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from matplotlib.quiver import Quiver

import posture_opt as po
from posture_opt.report.figures.residual_trends import Binned
from posture_opt.report.figures.residuals import (
    Shown,
)
from tests.helpers.planar_2r import first_order, position

NOISE, LONGER = 2e-5, 3e-3  # m: the instrument, and what the second link has more than the problem file says
SHAKE = np.array([1e-4, 2e-4])  # rad, of the joints from repeat to repeat
JOINTS = [{"name": f"joint{k}", "type": "revolute", "a": "1 m"} for k in (1, 2)]
DOCUMENT = {
    "name": "Planar arm",
    "robot": {"kind": "dh", "joints": JOINTS},
    "uncertainty": {
        "sigma": {"joint1.theta": "0.1 mrad", "joint2.theta": "0.2 mrad"},
        "measurement": {"position": "0.02 mm"},
    },
    "task": {"kind": "insert", "direction": [0, -1, 0]},
}


def table(q: np.ndarray, points: np.ndarray, **more: Any) -> dict[str, Any]:
    columns = {f"joint{k + 1} [rad]": q[:, k] for k in range(2)}
    return {**columns, "x [m]": points[:, 0], "y [m]": points[:, 1], **more}


def learned(document: dict[str, Any], columns: dict[str, Any]) -> tuple[Any, po.Assessment]:
    problem = po.problem_from_dict(document)
    data = po.read_measurements(columns, problem)
    calibration = po.calibrate(problem, data, folds=2)
    return problem, po.assess(problem, data, calibration)


@pytest.fixture(scope="module")
def visited() -> tuple[Any, po.Assessment]:
    """Forty poses, eight visits each, with every input that an effect may have."""
    rng = np.random.default_rng(1)
    q = np.repeat(rng.uniform(-2.5, 2.5, (40, 2)), 8, axis=0)
    points = position(q + rng.normal(0, SHAKE, q.shape), (1.0, 1.0 + LONGER)) + rng.normal(0, NOISE, q.shape)
    inputs = {
        "pose": np.repeat(np.arange(40), 8),
        "time [s]": 40.0 * np.arange(320),
        "temperature [degC]": 20 + rng.uniform(0, 5, 320),
        "payload [kg]": np.repeat(rng.choice([0.0, 2.0, 5.0], 40), 8),
        "joint2.approach": rng.choice([-1, 1], 320),
    }
    return learned(DOCUMENT, table(q, points, **inputs))


@pytest.fixture(scope="module")
def once() -> tuple[Any, po.Assessment]:
    """Six hundred poses, visited once each, with gears that err three times a turn."""
    rng = np.random.default_rng(2)
    q = rng.uniform(-2.5, 2.5, (600, 2))
    off = np.column_stack([np.zeros(600), 1e-4 * np.sin(3 * q[:, 0])])
    return learned(DOCUMENT, table(q, position(q + off, (1.0, 1.0 + LONGER)) + rng.normal(0, NOISE, q.shape)))


@pytest.fixture(scope="module")
def figures(visited: tuple[Any, po.Assessment]) -> dict[str, Any]:
    return visited[1].figures()


def said(found: po.Assessment) -> dict[str, Any]:
    return {one.id.removeprefix("validation."): one for one in found.statements}


def test_the_rules_are_kept_or_broken(visited: Any, once: Any) -> None:
    kept, broken = said(visited[1]), said(once[1])
    assert kept["mean-zero"].severity == "result"
    assert "mean-remains" not in kept
    assert broken["mean-remains"].severity == "caution"
    assert all(re.match(r"[xy] is -?\d", where) for where in broken["largest-mean"].values["where"])
    assert "scatter-systematic" in broken
    assert "scatter-systematic" not in kept
    assert visited[1].residual_scatter.dof == 40


def test_the_instrument_is_warned_of_with_both_figures(visited: Any) -> None:
    found = said(visited[1])
    assert visited[1].ratios["nominal"] > 100  # nothing to warn of
    assert found["instrument-inaccurate"].about == "calibrated"
    assert found["instrument-inaccurate"].values["ratio"] == pytest.approx(visited[1].ratios["calibrated"])
    assert str(found["instrument-inaccurate"].values["sigma"]) == "0.02 mm"


def test_arrows_are_the_errors_enlarged_as_stated(visited: Any, figures: dict[str, Any]) -> None:
    shown, figure = Shown.of(visited[1].calibration), figures["residual_vectors"]
    before, after = figure.axes
    assert before.get_xlim() == after.get_xlim()
    assert before.get_ylim() == after.get_ylim()
    for axes, name in ((before, "nominal"), (after, "calibrated")):
        factor = float(re.search(r", (\d+)\N{MULTIPLICATION SIGN}", axes.get_title(loc="left"))[1])
        (arrows,) = [a for a in axes.get_children() if isinstance(a, Quiver)]
        np.testing.assert_allclose(arrows.U, factor * shown.errors[name][:, 0])
        np.testing.assert_allclose(arrows.V, factor * shown.errors[name][:, 1])
    assert after.get_title(loc="left").startswith("calibrated, ")
    data = visited[1].calibration.request.data
    off = 1e3 * (data.position[:, :2] - position(data.q))
    np.testing.assert_allclose(shown.errors["nominal"][:, :2], off, atol=1e-9)


def test_the_band_of_a_mean_holds_it_in_95_of_100() -> None:
    rng = np.random.default_rng(4)
    x = np.linspace(0, 1, 200)
    inside = []
    for _ in range(200):
        binned = Binned.of(x, rng.normal(size=200))
        inside.append(np.abs(binned.mean) <= binned.band)
    # 2000 bins: 95 % ± 0.5 %
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)


def test_the_drawn_ellipse_is_the_one_of_the_text_and_holds_the_errors(visited: Any, figures: dict[str, Any]) -> None:
    axes, left = figures["residual_region"].axes[0], visited[1].residual_scatter
    (line,) = [li for li in axes.lines if "95 % ellipse for 40 poses" in str(li.get_label())]
    lengths = np.linalg.norm(line.get_xydata(), axis=1)
    np.testing.assert_allclose([lengths.min(), lengths.max()], 1e3 * left.factor * left.ellipse.semi_axes, rtol=1e-3)


def test_visits_stand_beside_the_ellipse_that_joints_and_instrument_predict(
    visited: Any, figures: dict[str, Any]
) -> None:
    data: po.Measurements = visited[1].calibration.request.data
    panels = figures["residual_repeats"].axes
    assert len(panels) == 6
    for axes in panels:
        row = np.flatnonzero(data.line == int(axes.get_title().rsplit(" ", 1)[1]))[0]
        C = first_order(data.q[row], np.diag([*SHAKE**2, 0, 0]), (1.0, 1.0 + LONGER)) + NOISE**2 * np.eye(2)
        (line,) = [li for li in axes.lines if li.get_label() == "95 % ellipse, predicted"]
        inner = 1e-6 * np.einsum("ni,ij,nj->n", line.get_xydata(), np.linalg.inv(C), line.get_xydata())
        np.testing.assert_allclose(inner, 2 * np.log(20), rtol=2e-3)  # χ² of a plane; the link is 10 µm surer or so
        (dots,) = [li for li in axes.lines if li.get_label() == "visits about their mean"]
        offsets = 1e3 * (data.position[row : row + 8, :2] - data.position[row : row + 8, :2].mean(axis=0))
        np.testing.assert_allclose(dots.get_xydata(), offsets, atol=1e-9)


def test_rows_under_another_payload_repeat_no_posture() -> None:
    """Loads that move the tool point by a millimetre are no scatter."""
    rng = np.random.default_rng(5)
    q, load = np.repeat(rng.uniform(-2.5, 2.5, (30, 2)), 6, axis=0), np.tile([0.0, 0.0, 0.0, 5.0, 5.0, 5.0], 30)
    points = position(q, (1.0, 1.0)) + 2e-4 * load[:, None] + rng.normal(0, NOISE, q.shape)
    found = learned(DOCUMENT, table(q, points, **{"payload [kg]": load}))[1]
    assert len(found.repeats.poses) == 60
    assert np.median([pose.nominal.repeatability for pose in found.repeats.poses]) < 4 * NOISE
    assert found.calibration.evaluation.spread_check.repeat_sigma < 1.5 * NOISE


def test_directions_and_repeats_stand_in_tables(visited: Any, once: Any) -> None:
    found, report = visited[1], visited[1].report()
    assert re.search(r"^along the task \(-y\) +before calibration", report, re.MULTILINE)
    across = next(d for d in found.nominal.deviations if d.name == "across")
    row = re.search(r"^across the task +before calibration +(\S+) +(\S+)", report, re.MULTILINE)
    assert row
    assert float(row[2]) == pytest.approx(1e3 * across.rms, abs=6e-4)
    worst = max(pose.nominal.repeatability for pose in found.repeats.poses)
    assert re.search(rf"^RP .* {1e3 * worst:.3f} ", report, re.MULTILINE)
    assert said(found)["repeats-below-standard"].values == {"standard": 30, "least": 8}
    assert "repeatability-unknown" in said(once[1])
