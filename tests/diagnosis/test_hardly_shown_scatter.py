"""Repeats that hardly show the scatter of a joint are no lack of fit."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

import posture_opt as po
from tests.helpers.planar_files import SHORT


@pytest.mark.parametrize(("wrong", "verdict"), [(0.0, "effects_found"), (2e-4, "unexplained")])
def test_a_noisy_joint_is_no_lack_of_fit_where_the_repeats_hardly_show_it(wrong: float, verdict: str) -> None:
    """Repeats of a folded arm, which its first joint moves a fourth as far as most rows, and a model that is wrong."""
    rng = np.random.default_rng(1)
    q = np.concatenate([rng.uniform(-2.8, 2.8, (70, 2)), np.tile([[0.4, 2.75]], (15, 1))])
    shift = np.concatenate([rng.normal(0, wrong, (70, 2)), np.tile(rng.normal(0, wrong, (1, 2)), (15, 1))])
    order = rng.permutation(len(q))
    q, shift = q[order], shift[order]
    first = q[:, 0] + rng.normal(0, 5e-4, len(q))
    both = first + q[:, 1]
    p = 0.5 * np.stack([np.cos(first), np.sin(first)], 1) + 0.4 * np.stack([np.cos(both), np.sin(both)], 1)
    p += shift + rng.normal(0, 2e-5, p.shape)
    table = {"joint1 [rad]": q[:, 0], "joint2 [rad]": q[:, 1], "x [m]": p[:, 0], "y [m]": p[:, 1]}
    problem = po.problem_from_dict(yaml.safe_load(SHORT) | {"uncertainty": {"measurement": {"position": "0.02 mm"}}})
    found = po.diagnose(problem, po.read_measurements(table, problem), plan=False)
    assert found.verdict == verdict
    if not wrong:
        assert ("joint_noise", "joint1") in [(effect.kind, effect.target) for effect in found.effects]
        assert 0.01 < found.adequacy.lack_of_fit < 0.99
