"""A problem with a fitted arm is made from numbers; what its files say is the same problem again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.model.effects import Backlash, JointCompliance, JointNoise
from posture_opt.problem.fitted_problem import batch_uncertainty
from posture_opt.selection.problem_data import FittedArm
from tests.helpers.same_problem import assert_same_numbers, written
from tests.helpers.shipped import PROBLEMS
from tests.helpers.stated import Sources
from tests.helpers.variants import conformance

FILES = sorted(PROBLEMS.glob("*.yaml"))
ALWAYS = [
    (PROBLEMS / f"insert_{name}.yaml", name != "planar_2r") for name in ("planar_2r", "ur10_extended", "urdf_arm")
]
"""With frames that are off, or the geometry alone."""
FITTED = [(path, True) for path in FILES if path != ALWAYS[0][0]] + ALWAYS[:1]
FRAMES = ("base.", "tool.")


def random_fit(problem: po.Problem, seed: int = 1, frames: bool = True) -> FittedArm:
    """Every parameter off by half a millimetre or milliradian, known with a full covariance, and two effects."""
    rng = np.random.default_rng(seed)
    robot = problem.robot
    names = [name for name in robot.parameters if frames or not name.startswith(FRAMES)]
    turning = [joint.name for joint in robot.joints if joint.type == "revolute"]
    effects = (Backlash(joint=turning[0]).with_estimate([2e-4]),)
    if all(np.isfinite(joint.mass) for joint in robot.joints):
        effects = (*effects, JointCompliance(joint=turning[-1]).with_estimate([7.1234567891e-6]))
    of_effects = [name for effect in effects for name in effect.parameter_names]
    root = rng.normal(0, 1e-4, (len(names) + len(of_effects),) * 2)
    root[len(names) :] *= 1e-2
    return FittedArm(
        label="fitted",
        deviations=dict(zip(names, rng.normal(0, 5e-4, len(names)), strict=True)),
        known=Sources((*names, *of_effects), root @ root.T),
        scatter={f"{name}.theta": float(rng.uniform(1e-5, 1e-4)) for name in turning},
        effects=effects,
        noises=(JointNoise(joint=turning[-1], sigma="0.03 mrad"),),
        gravity=(0.0, 0.1, -9.8) if frames else None,
        header=("A fit.",),
    )


@pytest.mark.parametrize(("path", "frames"), conformance(FITTED, ALWAYS))
def test_the_files_of_a_fitted_problem_are_the_problem(path: Path, frames: bool, tmp_path: Path) -> None:
    problem = po.load_problem(path)
    fit = random_fit(problem, frames=frames)
    fitted = problem.with_fit(fit)
    for name, value in fit.deviations.items():
        off = fitted.robot.parameters[name].nominal - problem.robot.parameters[name].nominal
        assert off == pytest.approx(value, abs=1e-11), name  # the digits of the file
    np.testing.assert_allclose(np.sqrt(np.diag(fitted.sources.constant))[: len(fit.deviations)],
                               np.sqrt(np.diag(fit.known.covariance))[: len(fit.deviations)], rtol=1e-9)  # type: ignore[union-attr] # fmt: skip
    again = written(fitted, tmp_path, "fitted")
    assert_same_numbers(again, fitted)
    assert again.notes == fitted.notes
    assert again.to_dict()["robot"].keys() == fitted.to_dict()["robot"].keys()
    assert fitted.to_yaml().startswith("# A fit.\nname: ")
    q = [0.5 * (joint.lower + joint.upper) + 0.1 for joint in fitted.robot.joints]
    mine, theirs = po.propagate(fitted, q), po.propagate(again, q)
    np.testing.assert_allclose(theirs.position, mine.position, atol=1e-10)
    np.testing.assert_allclose(theirs.covariance, mine.covariance, rtol=1e-7, atol=1e-9 * np.trace(mine.covariance))


@pytest.fixture(scope="module")
def measured() -> tuple[po.Problem, po.Diagnosis]:
    problem = po.load_problem("insert_ur10_measured")
    return problem, po.diagnose(problem, po.read_measurements(PROBLEMS / "ur10_measured.csv", problem))


@pytest.mark.long
def test_calibrated_and_extended_arms_come_back(measured: tuple[po.Problem, po.Diagnosis], tmp_path: Path) -> None:
    problem, found = measured
    for model in (*found.models.values(), problem.with_fit(found.calibration), problem.with_fit(found)):
        again = written(model, tmp_path)
        assert_same_numbers(again, model)
    assert_same_numbers(problem.with_fit(found), found.extended)
    assert_same_numbers(po.calibrated_problem(problem, found.calibration), problem.with_fit(found.calibration))
    assert [effect.name for effect in found.extended.effects] == [
        "joint_compliance(elbow)",
        "backlash(shoulder_pan)",
    ]
    names = found.extended.sources.names
    assert {"joint_compliance(elbow).compliance", "backlash(shoulder_pan).width"} <= set(names)
    cross = found.extended.sources.covariance[names.index("backlash(shoulder_pan).width")]
    assert np.count_nonzero(cross) > 5  # geometry and effects were estimated together


@pytest.mark.long
def test_what_a_batch_taught_comes_back(tmp_path: Path) -> None:
    problem = po.load_problem("insert_planar_2r_measured")
    data = po.read_measurements(PROBLEMS / "planar_2r_batch.csv", problem)
    section = batch_uncertainty(problem, po.calibrate_batch(problem, data))
    taught = po.problem_from_dict({**problem.to_dict(), "uncertainty": section})
    assert_same_numbers(written(taught, tmp_path), taught)
    fitted = taught.with_fit(random_fit(taught))
    assert_same_numbers(written(fitted, tmp_path, "fitted"), fitted)
