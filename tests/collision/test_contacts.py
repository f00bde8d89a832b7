"""How far postures are from contact, in one call of C: against coal."""

from __future__ import annotations

import numpy as np
import pytest

from posture_opt.collision.contacts import ContactSlack
from posture_opt.robot.posture import drawn_between
from tests.helpers import brute_force
from tests.helpers.cells import GROUND, LAMP, POST, TABLE, problem_in_cell
from tests.helpers.variants import conformance, needs_compiler

pytestmark = needs_compiler

TILTED = {**TABLE, "name": "flap", "rpy": ["20 deg", "-35 deg", "70 deg"], "xyz": ["0.2 m", "-0.6 m", "0.4 m"]}
LYING = {**POST, "name": "pipe", "rpy": ["90 deg", "30 deg", "0 deg"], "xyz": ["0.1 m", "0.5 m", "0.9 m"]}
COUNT = 60
ALLOWED_M = 2.1e-6  # what rows ask for beyond the clearance, and what coal leaves at its tolerance


@pytest.mark.parametrize("preset", conformance(["ur10", "panda"], ["ur10"]))
def test_the_least_distance_is_that_of_coal(preset: str) -> None:
    scene = problem_in_cell(preset, TABLE, POST, LAMP, GROUND, TILTED, LYING, clearance="0 mm").scene
    Q = np.random.default_rng(11).uniform(*drawn_between(scene.robot), (COUNT, scene.robot.n))
    slack = ContactSlack(scene.contacts, None)
    ours, theirs = slack.slack(Q), np.array([brute_force.clearance(scene, q) for q in Q])
    apart, near = theirs > 1e-6, theirs < scene.contacts.reach
    assert np.count_nonzero(apart & near) > COUNT / 10
    assert np.count_nonzero(~apart) > COUNT / 10
    np.testing.assert_allclose(ours[apart & near], theirs[apart & near], rtol=0, atol=ALLOWED_M)
    assert np.all(ours[~apart] < 0)  # and by the depth, which coal is not asked for
    assert np.all(ours[~near] == scene.contacts.reach)
