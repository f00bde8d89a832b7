"""Scatter and what is not known of errors that stay, of a planar arm whose derivatives are taken by differences."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.uncertainty.spread_parts import spread_parts
from tests.helpers.planar_2r import position

Q = (0.4, 1.1)
KNOWN, EACH = 1e-3, 3e-4  # rad: of the second joint, stays; of the first, anew at every repeat


def problem(**uncertainty: object) -> po.Problem:
    joint = {"type": "revolute", "a": "1 m"}
    return po.problem_from_dict(
        {
            "robot": {"kind": "dh", "joints": [{"name": name, **joint} for name in ("joint1", "joint2")]},
            "uncertainty": uncertainty,
        }
    )


def radius(sigma: np.ndarray) -> float:
    """95 % of draws of independent coordinates stay within."""
    drawn = np.random.default_rng(0).normal(size=(400_000, len(sigma))) * sigma
    return float(np.quantile(np.linalg.norm(drawn, axis=1), 0.95))


def moved(joint: int) -> np.ndarray:
    """(2,) shift of the tool point per radian of a joint."""
    step = np.zeros(2)
    step[joint] = 1e-6
    q = np.array(Q)
    links = (1.0, 1.0)
    return (position((q + step)[None], links) - position((q - step)[None], links))[0] / 2e-6


def test_each_part_has_its_own_size() -> None:
    stated = problem(sigma={"joint2.theta": "1 mrad"}, scatter={"joint1.theta": "0.3 mrad"})
    parts = spread_parts(po.propagate(stated, Q), np.eye(3)[:, :2])
    scatter, systematic = EACH * np.linalg.norm(moved(0)), KNOWN * np.linalg.norm(moved(1))
    assert parts.scatter_sigma == pytest.approx(scatter, rel=1e-4)
    assert parts.systematic_sigma == pytest.approx(systematic, rel=1e-4)
    assert parts.scatter_radius == pytest.approx(radius(np.array([scatter])), rel=0.01)
    assert parts.systematic_radius == pytest.approx(radius(np.array([systematic])), rel=0.01)
    assert parts.parameters == ("joint2.theta",)
    assert parts.mostly_systematic
    document = parts.to_json()
    assert document["systematic"]["parameters"] == ["joint2.theta"]
    assert document["scatter"]["sigma_max"] == parts.scatter_sigma


def test_only_what_the_task_cares_about_counts() -> None:
    stated = problem(sigma={"joint2.theta": "1 mrad"}, scatter={"joint1.theta": "0.3 mrad"})
    across = np.array([[1.0], [0.0], [0.0]])
    parts = spread_parts(po.propagate(stated, Q), across)
    assert parts.systematic_sigma == pytest.approx(KNOWN * abs(moved(1)[0]), rel=1e-4)
    assert parts.scatter_sigma == pytest.approx(EACH * abs(moved(0)[0]), rel=1e-4)
