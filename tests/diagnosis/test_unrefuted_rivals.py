"""Which causes are told apart where a model leaves structure: half of equal causes must not be refuted by chance."""

from __future__ import annotations

import posture_opt as po
from tests.helpers.real_arms import DATA, long_on_real_arms


@long_on_real_arms
def test_two_series_of_one_arm_agree_on_what_its_sag_could_be() -> None:
    """Series B names the shoulder's compliance with that of the column as a rival; by the criterion D refuted it."""
    problem = po.load_problem(DATA / "ipa_ur10" / "problem.yaml")
    data = po.read_measurements(DATA / "ipa_ur10" / "series_d.csv", problem)
    found = po.diagnose(problem, data, plan=False)
    (sag,) = [f for f in found.effects if f.kind == "joint_compliance"]
    assert ("link_bending", "shoulder_pan") in {(c.kind, c.target) for c in sag.confounded_with}
