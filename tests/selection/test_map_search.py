"""Every target of a map has the best posture that a direct search finds, and targets that joint 1 turns agree."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.selection.maps.map_exchange import BaseMotion
from tests.helpers.variants import conformance

AGREES = 1.005  # times σ: what nobody sees in a map


def random_arm(seed: int, joints: int) -> dict[str, Any]:
    """A DH arm with limits, joint noise alone, that inserts downwards."""
    rng = np.random.default_rng(seed)
    rows = []
    for k in range(joints):
        low, high = rng.uniform(100, 175, 2)
        rows.append({
            "name": f"joint{k + 1}", "d": f"{rng.uniform(0, 0.35)} m", "a": f"{rng.uniform(0, 0.4)} m",
            "alpha": f"{rng.choice([-90, 0, 90, 45, -60])} deg", "limits": [f"{-low} deg", f"{high} deg"],
        })  # fmt: skip
    sigma = {f"joint{k + 1}.theta": f"{rng.uniform(0.005, 0.03)} deg" for k in range(joints)}
    return {
        "name": "random arm", "robot": {"kind": "dh", "joints": rows}, "uncertainty": {"sigma": sigma},
        "task": {"kind": "insert", "direction": [0, 0, -1]},
    }  # fmt: skip


MAPS: dict[str, tuple[Any, dict[str, Any]]] = {
    "panda": (lambda: po.load_problem("insert_panda"), {"low": (0.3, -0.5, 0.2), "high": (0.75, 0.25, 0.2)}),
    "panda, upright": (
        lambda: po.load_problem("insert_panda"),
        {"low": (0.35, 0.1, 0.1), "high": (0.75, 0.1, 0.6), "plane": "xz"},
    ),
    "ur10": (lambda: po.load_problem("insert_ur10"), {"low": (-0.9, 0.3, 0.1), "high": (0.9, 0.9, 0.1)}),
    "kuka": (
        lambda: po.load_problem("insert_iiwa14_tilt"),
        {"low": (0.4, -0.2, 0.15), "high": (0.7, 0.3, 0.15), "counts": (4, 3)},
    ),
    "scara": (lambda: po.load_problem("insert_scara"), {"low": (0.15, -0.3, -0.08), "high": (0.4, 0.3, -0.08)}),
    "tilted probe": (lambda: po.load_problem("probe_irb120"), {"low": (0.2, -0.2, 0.2), "high": (0.5, 0.2, 0.2)}),
    "random": (lambda: po.problem_from_dict(random_arm(4, 5)), {}),
}


@pytest.mark.parametrize("arm", conformance(MAPS, ["scara"]))
def test_targets_are_as_good_as_direct_searches(arm: str) -> None:
    build, where = MAPS[arm]
    problem = build()
    found = po.map_targets(problem, **{"counts": (7, 6), **where})
    selector = po.PostureSelector(problem)
    criterion = selector.task.criterion
    feasible = np.flatnonzero(found.feasible)
    assert len(feasible) > 4
    for k in np.random.default_rng(1).choice(feasible, 4, replace=False):
        direct = selector.solve(position=found.grid.points[k], starts=160, seed=5)
        assert found.map_points[k].optimal
        if criterion == "miss":
            missed = 1 - found.map_points[k].success_probability
            assert missed <= (1 - direct.success_probability) * 1.03 + 1e-9
        else:
            assert found.sigma[k] <= AGREES * direct.critical.sigma_max, found.grid.points[k]


@pytest.mark.large
def test_the_worst_place_of_the_panda_is_no_false_optimum() -> None:
    """Beyond a radius of 786 mm a branch is best that few random starts arrive at."""
    line = {"counts": (10, 1, 1), "low": (0.76, 0, 0.2), "high": (0.805, 0, 0.2)}
    problem = po.load_problem("insert_panda")
    found = po.map_targets(problem, **line)
    assert found.feasible.tolist() == [True] * 9 + [False]
    # Direct search with 1000 starts and 60 local solves.
    direct = 1e-3 * np.array([0.03801, 0.03812, 0.03822, 0.03829, 0.03833, 0.03832, 0.0366, 0.03653, 0.03644])
    np.testing.assert_allclose(found.sigma[:9], direct, rtol=2e-3)
    assert found.solves.again >= 1


def test_targets_that_joint_1_turns_onto_each_other_agree() -> None:
    problem = po.load_problem("insert_panda")
    found = po.map_targets(problem, counts=(9, 9), low=(-0.8, -0.8, 0.2), high=(0.8, 0.8, 0.2))
    motion = BaseMotion.of(problem.arm)
    kept, azimuth = motion.split(found.grid.points)
    radius = kept[:, 0]
    here, there = np.nonzero(np.abs(radius[:, None] - radius) < 1e-9)
    here, there = (side[found.feasible[there]] for side in (here, there))
    shift, Q = azimuth[here] - azimuth[there], found.postures[there]
    turned = motion.moved(Q, shift)[:, 0] - Q[:, 0]
    # A posture that joint 1 can turn from there serves here as well.
    serves = np.abs(np.sin((turned - shift) / 2)) < 1e-9
    assert np.all(found.sigma[here[serves]] <= AGREES * found.sigma[there[serves]])
    assert np.count_nonzero(serves) > 100


@pytest.mark.parametrize("base", [{}, {"xyz": ["0.3 m", "-0.2 m", "0.1 m"], "rpy": ["20 deg", "-35 deg", "50 deg"]}])
@pytest.mark.parametrize("slide", [False, True])
def test_joint_1_moves_the_arm_as_it_says(base: dict[str, Any], slide: bool) -> None:
    data = random_arm(3, 5)
    data["robot"]["base"] = base
    if slide:
        data["robot"]["joints"][0] |= {"type": "prismatic", "limits": ["-0.5 m", "0.5 m"], "theta": "20 deg"}
        data["uncertainty"]["sigma"] = {"joint2.theta": "0.01 deg"}
    arm = po.problem_from_dict(data).arm
    motion = BaseMotion.of(arm)
    rng = np.random.default_rng(2)
    q = rng.uniform(-0.4, 0.4, (20, 5))
    moved = motion.moved(q, np.linspace(-0.09, 0.09, 20))
    before, after = (motion.split(np.asarray(arm.position(Q), dtype=float)) for Q in (q, moved))
    np.testing.assert_allclose(after[0], before[0], atol=1e-12)
    np.testing.assert_allclose(after[1] - before[1], moved[:, 0] - q[:, 0], atol=1e-9)
    assert motion.keeps(motion.axis)
    assert motion.keeps(np.cross(motion.axis, [1.0, 2.0, 3.0])) == slide
