"""The moment of a slip: to the row, also where rows are denser than the moments that are looked at first."""

from __future__ import annotations

import numpy as np

import posture_opt as po
from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.scores.score_tests import explained_squares
from posture_opt.diagnosis.search.linearised_data import linearise_calibration
from posture_opt.diagnosis.search.shape_refinement import refine_shape
from posture_opt.model.effects.slip import Slip
from tests.helpers.planar_2r import position

NOISE, SLIP = 2e-5, 1e-3  # m; rad of joint1
PROBLEM = {
    "robot": {"kind": "dh", "joints": [{"name": "joint1", "a": "1 m"}, {"name": "joint2", "a": "1 m"}]},
    "uncertainty": {"measurement": {"position": "0.02 mm"}},
}


def test_the_moment_of_a_slip_is_found_to_the_row() -> None:
    """Twenty rows to a moment of the grid; the slip is fifty times the noise of any of them."""
    rng, rows = np.random.default_rng(3), 3000
    q = rng.uniform(-2.5, 2.5, (rows, 2))
    t = 10.0 * np.arange(rows)
    first = 1307
    turned = q + np.outer(t >= t[first], [SLIP, 0.0])
    p = position(turned, (1.0002, 0.9999)) + rng.normal(0, NOISE, q.shape)
    problem = po.problem_from_dict(PROBLEM)
    heads = ["time [s]", "joint1 [rad]", "joint2 [rad]", "x [m]", "y [m]"]
    table = dict(zip(heads, np.column_stack([t, q, p]).T, strict=True))
    linearised = linearise_calibration(po.calibrate(problem, po.read_measurements(table, problem), folds=2), 0)
    baseline, sensitivities = linearised.baseline(), linearised.sensitivities
    moments = [e for e in Slip.candidates(linearised.excitation) if e.target == "joint1"]
    suspects = [Candidate(e, sensitivities.columns(e)) for e in moments]
    coarse = suspects[int(np.argmax(explained_squares(baseline, [s.Z for s in suspects])[2][:, 0]))]
    found = refine_shape(sensitivities, baseline, coarse).what
    assert isinstance(found, Slip)
    assert t[first - 1] < found.moment <= t[first]
