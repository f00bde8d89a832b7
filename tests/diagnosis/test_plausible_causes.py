"""A cause of a size that no arm has stays a candidate, and is worded as what the errors look like."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.diagnosis.causes.causes import Finding
from posture_opt.diagnosis.causes.plausible_causes import with_plausibility
from posture_opt.model.effects import FittedSizes
from posture_opt.model.effects.joint_compliance import JointCompliance
from posture_opt.model.effects.slip import Slip
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write


@cache
def diagnosed(expansion: float) -> po.Diagnosis:
    """An arm whose first link expands by so much a kelvin."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.5, 2.5, (80, 2))
    warm = rng.uniform(15, 30, len(q))
    points = position(q, (1 + expansion * (warm - 20), 1.0))
    with TemporaryDirectory() as folder:
        file = Path(folder) / "data.csv"
        write(file, q, points + rng.normal(0, 2e-5, points.shape), temperature=("degC", warm))
        problem = po.problem_from_dict(PROBLEM)
        return po.diagnose(problem, po.read_measurements(file, problem), flips=99, plan=False)


def entry(found: po.Diagnosis) -> dict[str, Any]:
    return next(e for e in found.to_json()["effects"] if e["kind"] == "thermal_growth")


@pytest.mark.parametrize(("expansion", "plausible"), [(23e-6, True), (-250e-6, False)])
def test_a_size_that_no_arm_has_is_worded_as_what_it_looks_like(expansion: float, plausible: bool) -> None:
    found = diagnosed(expansion)
    one = entry(found)
    assert (one["target"], one["plausible"]) == ("joint1.a", plausible)
    assert one["estimate"]["expansion"]["value"] == pytest.approx(expansion, abs=3e-6)
    assert one["plausible_range"]["low"] == 5e-6
    assert one["plausible_range"]["source"]
    text = " ".join(found.report().split())
    if plausible:
        assert one["would_need"] is None
        assert "joint1.a expands with temperature" in text
        assert "looks like" not in text
    else:
        assert "expands as no metal" in one["would_need"]
        assert "an error that looks like thermal growth of joint1.a" in text
        assert "joint1.a expands" not in text


def test_a_second_slip_in_one_session_is_rather_something_else() -> None:
    robot = po.problem_from_dict(PROBLEM).robot
    slips = [
        Finding(Slip(of=name, moment="10 s"), {}, 1e-6, 0.2, place=i) for i, name in enumerate(("joint1", "joint2"))
    ]
    fitted = SimpleNamespace(robot=robot, sizes=lambda finding: FittedSizes(finding.estimate))
    first, second = with_plausibility(slips, fitted)
    assert first.plausible
    assert not second.plausible
    assert "2 of them in one session" in second.would_need
    assert second.to_json()["plausible"] is False


@pytest.mark.parametrize(("product", "rises"), [(-2e-6, True), (2e-6, False)])
def test_a_joint_that_rises_against_an_unknown_load_is_not_compliant(product: float, rises: bool) -> None:
    """Its turn has no sign in a root mean square: gravity compensation that does too much looks alike."""
    robot = po.problem_from_dict(PROBLEM).robot
    soft = JointCompliance(joint="joint1", loads="points", points=("tool",))
    fit = SimpleNamespace(x=np.array([1e-3, product]), slices=(slice(1, 2),))
    fitted = SimpleNamespace(
        robot=robot, model=fit, sizes=lambda finding: FittedSizes(finding.estimate, turn=(0.0, 1e-4))
    )
    (found,) = with_plausibility([Finding(soft, {}, 1e-6, 0.2, place=0)], fitted)
    assert ("gravity compensation" in found.would_need) is rises
    assert found.plausible is not rises
