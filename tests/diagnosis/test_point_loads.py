"""What yields to gravity is found without the masses of the links too: joints, links and base, as products of load.

The simulator of ``tests/hidden`` has masses and shares no code with the package; the file that is handed over has none.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.model.arm_state import ArmState, Inputs
from posture_opt.model.effects.base_compliance import BaseCompliance
from posture_opt.model.effects.joint_compliance import JointCompliance
from posture_opt.model.effects.link_bending import LinkBending
from tests.helpers.variants import conformance
from tests.hidden.draw import draw
from tests.hidden.files import write
from tests.hidden.hunt import ask

SEED, STRONG = 12, 100.0


def without_masses(folder: Path, family: str, kind: str, index: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """What was hidden, and the answer where the file states no masses."""
    case = draw(SEED, family, index, kind=kind, weakest=STRONG)
    file = write(case, folder)
    problem = yaml.safe_load(file.read_text())
    for joint in problem["robot"]["joints"]:
        joint.pop("mass", None)
        joint.pop("com", None)
    file.write_text(yaml.safe_dump(problem, sort_keys=False))
    return case.truth["effects"][0], ask(folder)


CASES = [(kind, index) for kind in ("base_compliance", "link_bending", "joint_compliance") for index in range(4)]


@pytest.mark.parametrize(
    ("kind", "index"),
    conformance(CASES, [("base_compliance", 0)]),
)
def test_two_payloads_give_the_compliance_itself(kind: str, index: int, tmp_path: Path) -> None:
    truth, answer = without_masses(tmp_path, "full", kind, index)
    moving = [e for e in answer["effects"] if "compliance" in e["kind"] or e["kind"] == "link_bending"]
    assert moving
    first = moving[0]
    inside = [(first["kind"], first["target"]), *((r["kind"], r["target"]) for r in first["confounded_with"])]
    assert (kind, truth["target"]) in inside
    if inside[0] == (kind, truth["target"]):
        found = first["estimate"]["compliance"]
        assert abs(found["value"] - next(iter(truth["size"].values()))) < 4 * found["std"]


@pytest.mark.parametrize(
    "effect", [BaseCompliance(), LinkBending(joint="j2"), JointCompliance(joint="j2")], ids=lambda e: e.kind
)
def test_point_masses_that_are_true_do_what_stated_ones_do(effect: Any) -> None:
    """Masses at the ends of the links, stated or as products: one compliance times the load of all of them."""
    masses = {"j1": 7.0, "j2": 5.0, "j3": 3.0}
    table = [("j1", "0.1 m", "90 deg", "0.4 m"), ("j2", "0.5 m", "0 deg", "0 m"), ("j3", "0.4 m", "30 deg", "0.1 m")]
    joints = [
        {"name": n, "a": a, "alpha": alpha, "d": d, "mass": f"{masses[n]} kg", "com": ["0 m", "0 m", "0 m"]}
        for n, a, alpha, d in table
    ]
    robot = po.problem_from_dict(
        {"robot": {"kind": "dh", "joints": joints, "tool": {"xyz": ["0.1 m", "0 m", "0 m"]}}}
    ).robot
    payload = 2.0
    state = ArmState(robot, [0.3, -0.7, 1.1], Inputs(payload=payload))
    (whole,) = effect.sensitivities(state)
    points = effect.model_copy(update={"loads": "points", "points": ("payload", "j1", "j2", "j3")})
    parts = points.sensitivities(state)
    weights = [1.0, *(masses[p] for p in points.points[1:])]
    if effect.moved_joint:  # what is before the joint does not load it
        weights[1] = 0.0
    if effect.kind == "link_bending":
        weights[2] = 0.0
    for part in (0, 1):
        summed = sum(w * np.array(one.twist[part]) for w, one in zip(weights, parts, strict=True))
        np.testing.assert_allclose(summed, np.array(whole.twist[part]), atol=1e-12)
    for joint, turn in whole.joints.items():
        assert sum(w * one.joints[joint] for w, one in zip(weights, parts, strict=True)) == pytest.approx(turn)
