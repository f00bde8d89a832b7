"""Instruments that scatter more than the arm errs, at arms of a simulator of its own: nothing delivered is worse."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.instruments import JOINTS, TrueArm, misplaced, plane_table, postures
from tests.helpers.pairs import ur10_problem

LEAST_PROBABILITY = 0.9  # below it, the nominal arm is delivered
SMALL, COARSE, FINE = 1.5e-4, 3e-4, 2e-5  # errors of an arm; scatter of plates [m]


def calibrated(seed: int, size: float, sigma: float, each: int = 60, **how: int) -> tuple[po.Calibration, TrueArm]:
    rng = np.random.default_rng(seed)
    arm = TrueArm.drawn(rng, size)
    given = ur10_problem({"plane": f"{sigma * 1e3:g} mm"})
    data = po.read_measurements(plane_table(arm, rng, each, sigma, 0.0), given)
    return po.calibrate(given, data, plan=False, **how), arm


def named(found: po.Calibration, x: np.ndarray) -> dict[str, float]:
    """Values of the parameters [rad, m] by name."""
    return {p.name: p.nominal + v for p, v in zip(found.parameters, x, strict=True)}


def arm_with(found: po.Calibration, x: np.ndarray) -> TrueArm:
    """The simulated arm whose errors are the deviations ``x`` (k,)."""
    off = {p.name: float(v) for p, v in zip(found.parameters, x, strict=True)}
    errors = [[off.get(f"{joint}.{kind}", 0.0) for kind in ("theta", "d", "a", "alpha")] for joint in JOINTS]
    tool = np.array([named(found, x)[f"tool.{axis}"] for axis in "xyz"])
    return TrueArm(tool, np.array(errors), beta=np.array([off.get(f"{joint}.beta", 0.0) for joint in JOINTS]))


def rms_error(found: po.Calibration, arm: TrueArm, x: np.ndarray) -> float:
    """RMS error of the tool at 60 other postures, the base aligned: geometry and tool as found, by the simulator."""
    q = postures(np.random.default_rng(99), 60)
    return misplaced(named(found, x), q, arm.point(q))


def test_plates_worse_than_the_arm_do_not_make_it_worse() -> None:
    found, arm = calibrated(300, SMALL, COARSE, folds=2)
    assert rms_error(found, arm, found.x) < 1.2 * rms_error(found, arm, found.x_nominal)  # 1.12; others gain a third
    assert found.instrument_scatter.exceeds
    assert found.instrument_scatter.scatter == pytest.approx(COARSE, rel=0.2)
    assert found.estimates_json()["instrument_scatter"]["exceeds_arm"] is True
    z = (found.x - arm_errors(found, arm))[found.assumed] / found.std[found.assumed]
    assert np.mean(np.abs(z) < 1.96) > 0.85


def test_the_nominal_arm_is_kept_where_it_is_not_sure_that_another_is_better() -> None:
    """The probability is counted over arms that the estimate leaves possible, walked and aligned by the simulator."""
    found, _ = calibrated(200, SMALL, COARSE, 40, folds=2)
    q, likely = found.request.data.q, np.random.default_rng(5).multivariate_normal(found.x, found.covariance, 100)
    truths = [arm_with(found, x).point(q) for x in likely]
    better = [misplaced(named(found, found.x), q, t) < misplaced(named(found, found.x_nominal), q, t) for t in truths]
    assert found.better_than_nominal == pytest.approx(np.mean(better), abs=0.08)
    assert found.keeps_nominal
    assert found.better_than_nominal < LEAST_PROBABILITY
    assert found.estimates_json()["nominal_kept"] is True
    delivered = po.calibrated_problem(found.request.problem, found)  # type: ignore[arg-type]
    assert not delivered.corrections
    i, place = next((i, delivered.sources.names.index(p.name)) for i, p in enumerate(found.parameters) if p.made)
    square = found.covariance[i, i] + found.x[i] ** 2
    assert delivered.sources.constant[place, place] == pytest.approx(square, rel=0.02)


def test_the_nominal_arm_is_kept_where_rows_left_out_are_predicted_no_better() -> None:
    """By the tolerances that arms have a gain is likely; this one is 1.2 times as far off when calibrated."""
    found, arm = calibrated(208, SMALL, COARSE, 40)
    assert found.better_than_nominal is not None
    assert found.better_than_nominal > LEAST_PROBABILITY
    assert rms_error(found, arm, found.x) > 1.1 * rms_error(found, arm, found.x_nominal)
    assert found.keeps_nominal


def test_plates_better_than_the_arm_improve_it_and_move_only_what_they_show() -> None:
    found, arm = calibrated(309, 5e-4, FINE, folds=2)
    assert rms_error(found, arm, found.x) < 0.6 * rms_error(found, arm, found.x_nominal)
    assert not found.instrument_scatter.exceeds
    still = found.assumed & ~found.fixed
    assert still.any()  # a common scale of all links, say
    assert np.all(np.abs(found.x[still]) < 3 * found.prior[still])


def arm_errors(found: po.Calibration, arm: TrueArm) -> np.ndarray:
    """(k,) the true deviations of the geometry; NaN elsewhere."""
    return np.array([arm.error_of(p.name) if p.group == "geometry" else np.nan for p in found.parameters])


@pytest.mark.campaign
def test_intervals_cover_the_truth_whatever_the_plates() -> None:
    inside, better, kept = [], [], []
    for seed in range(200, 220):
        found, arm = calibrated(seed, SMALL, COARSE, 40)
        z = (found.x - arm_errors(found, arm))[found.assumed] / found.std[found.assumed]
        inside.append(np.abs(z) < 1.96)
        better.append(rms_error(found, arm, found.x) / rms_error(found, arm, found.x_nominal))
        kept.append(found.keeps_nominal)
    assert np.mean(inside) > 0.92
    assert np.median(better) < 0.9  # 0.80
    assert max(better) < 1.6
    assert sum(r > 1 and not k for r, k in zip(better, kept, strict=True)) <= 4  # 3; of 144 other draws, 8
    assert sum(kept) < 10  # 5
