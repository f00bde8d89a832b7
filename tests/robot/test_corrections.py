"""Corrections of named parameters, and scatter from repeat to repeat beside what is known of a parameter."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration.estimation.parameters import Parameter, prior_covariance
from posture_opt.experiments.candidate_postures import nominal_chain, skeleton_points
from posture_opt.robot.corrections import corrected
from tests.helpers.factors import frame, pose, random_postures
from tests.helpers.shipped import preset_robot

URDF = """\
<robot name="arm">
  <link name="base"/><link name="a"/><link name="tip"/>
  <joint name="j1" type="revolute">
    <parent link="base"/><child link="a"/><origin xyz="0 0 0.3" rpy="0 0.1 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="j2" type="prismatic">
    <parent link="a"/><child link="tip"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.2" effort="1" velocity="1"/>
  </joint>
</robot>
"""
ROWS = [
    {"name": "j1", "a": "0.3 m", "alpha": "90 deg", "limits": ["-90 deg", "90 deg"]},
    {"name": "j2", "type": "prismatic", "theta": "20 deg", "limits": ["0 mm", "300 mm"]},
]
ARMS: dict[str, dict[str, Any]] = {
    "dh": {"kind": "dh", "joints": ROWS},
    "mdh": {"kind": "mdh", "joints": ROWS},
    "urdf": {"kind": "urdf", "file": "arm.urdf"},
    "preset": {"kind": "preset", "name": "scara"},
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "arm.urdf").write_text(URDF, encoding="utf-8")
    return tmp_path


def robot(section: dict[str, Any], folder: Path, **keys: Any) -> po.Robot:
    return po.problem_from_dict({"robot": section | keys}, folder).robot


@pytest.mark.parametrize("kind", ["dh", "mdh", "urdf"])
def test_every_parameter_takes_a_correction(kind: str, folder: Path) -> None:
    frames = {"base": {"xyz": ["1 m", "0 m", "0 m"]}, "tool": {"rpy": ["0 deg", "0 deg", "30 deg"]}}
    plain = robot(ARMS[kind], folder, **frames)
    angles = {name: factor.kind == "rotate" for name, factor in plain.parameters.items()}
    assert {"j1.theta", "j2.d", "base.x", "tool.yaw", *(["j1.beta"] if kind == "dh" else [])} <= set(angles)
    texts = {name: f"{k + 1} mrad" if angles[name] else f"{k + 1} mm" for k, name in enumerate(angles)}
    found = robot(ARMS[kind], folder, **frames, corrections=texts)
    errors = {name: 1e-3 * (k + 1) for k, name in enumerate(angles)}
    for q in ([0.3, 0.1], [-0.7, 0.2]):
        # Rounding of 20 factors: the product in tests/helpers takes parameters by itself.
        np.testing.assert_allclose(pose(found, q), pose(plain, q, errors), atol=1e-14)
    assert (found.lower, found.upper) == (plain.lower, plain.upper)  # of the joints as they are commanded


@pytest.mark.parametrize(
    ("corrections", "message"),
    [
        ({"j1.alhpa": "1 mrad"}, "corrections.j1.alhpa: the robot has no such parameter – did you mean 'j1.alpha'?"),
        ({"j3.a": "1 mm"}, "robot.corrections.j3.a: the robot has no such parameter"),
        ({"j1.a": "1 mrad"}, "robot.corrections.j1.a: 'mrad' is not a unit of length"),
        ({"j1.alpha": 0.001}, "robot.corrections.j1.alpha: the angle has no unit"),
        ({"j1.a": None}, "robot.corrections.j1.a: expected a length with its unit"),
        (["j1.a"], "robot.corrections"),
    ],
)  # fmt: skip
def test_corrections_that_cannot_be_are_refused(corrections: Any, message: str, folder: Path) -> None:
    with pytest.raises(po.errors.InputError) as caught:
        robot(ARMS["dh"], folder, corrections=corrections)
    assert message in str(caught.value)


def planar(folder: Path, **uncertainty: Any) -> po.Problem:
    (folder / "known.csv").write_text(
        "name, joint1.theta [mrad], joint2.a [mm]\njoint1.theta, 4, 0.3\njoint2.a, 0.3, 0.09\n", encoding="utf-8"
    )
    rows = [{"name": name, "a": "1 m", "limits": ["-180 deg", "180 deg"]} for name in ("joint1", "joint2")]
    return po.problem_from_dict({"robot": {"kind": "dh", "joints": rows}, "uncertainty": uncertainty}, folder)


def test_scatter_adds_to_a_covariance_and_is_no_prior(folder: Path) -> None:
    scatter = {"joint1.theta": "1 mrad", "joint2.theta": "2 mrad"}
    sources = planar(folder, covariance="known.csv", scatter=scatter).sources
    assert sources.names == ("joint1.theta", "joint2.a", "joint2.theta")
    constant = np.array([[4e-6, 0.3e-6, 0], [0.3e-6, 0.09e-6, 0], [0, 0, 0]])
    np.testing.assert_allclose(sources.covariance, constant + np.diag([1e-6, 0, 4e-6]), rtol=1e-12)
    np.testing.assert_allclose(sources.constant, constant, atol=1e-20)


def test_a_repeatability_adds_to_a_covariance_file_but_not_to_sigma(folder: Path) -> None:
    alone = planar(folder, repeatability="1 mm").sources
    both = planar(folder, repeatability="1 mm", covariance="known.csv")
    variance = dict(zip(both.sources.names, np.diag(both.sources.covariance), strict=True))
    assert variance["joint1.theta"] == pytest.approx(4e-6 + alone.sigma[0] ** 2)
    assert variance["joint2.theta"] == pytest.approx(alone.sigma[1] ** 2)
    parameters = [Parameter(name, "geometry", "rad", 0.0, 0) for name in ("joint1.theta", "joint2.theta")]
    assert prior_covariance(both, parameters)[0] == [0]
    with pytest.raises(
        po.errors.InputError, match=r"uncertainty.repeatability: the error of joint1.theta is stated twice"
    ):
        planar(folder, repeatability="1 mm", sigma={"joint1.theta": "1 mrad"})


@pytest.mark.parametrize(
    ("scatter", "message"),
    [
        ({"joint1.thta": "1 mrad"}, "uncertainty.scatter.joint1.thta: the robot has no such parameter"),
        ({"joint1.a": "1 mrad"}, "uncertainty.scatter.joint1.a: 'mrad' is not a unit of length"),
        ({"joint1.theta": "-1 mrad"}, "uncertainty.scatter.joint1.theta: the standard deviation -1 mrad is negative"),
        ({"joint1.theta": 1}, "uncertainty.scatter.joint1.theta: the angle has no unit"),
    ],
)
def test_scatter_that_cannot_be_is_refused(scatter: Any, message: str, folder: Path) -> None:
    with pytest.raises(po.errors.InputError) as caught:
        planar(folder, scatter=scatter)
    assert message in str(caught.value)


def dh_of(origins, axes, tip, nominal):
    """Corrections of a DH table that make these joint axes (6, 3), (6, 3) and tip (4, 4): x is on common normals."""
    found, T = {}, np.eye(4)
    for k, link in enumerate(nominal.links):
        at = {f.parameter: f.nominal for f in link}
        name, z, o = nominal.joint_names[k], T[:3, 2], T[:3, 3]
        if k < 5:
            along, p = axes[k + 1], origins[k + 1]
            t, u = np.linalg.lstsq(np.column_stack([z, -along]), p - o, rcond=None)[0]
            end = p + u * along
            x = end - o - t * z if at[f"{name}.a"] else np.cross(z, along)
            x *= np.sign(at[f"{name}.a"] or at[f"{name}.alpha"]) / np.linalg.norm(x)
        else:
            end, along, x = tip[:3, 3], tip[:3, 2], tip[:3, 0]
        row = {
            "theta": np.arctan2(x @ T[:3, 1], x @ T[:3, 0]), "d": (end - o) @ z, "a": (end - o) @ x,
            "alpha": np.arctan2(np.cross(z, along) @ x, z @ along),
        }  # fmt: skip
        found |= {f"{name}.{key}": value - at[f"{name}.{key}"] for key, value in row.items()}
        T[:3] = np.column_stack([x, np.cross(along, x), along, end])
    return {name: f"{float(value)!r} {'m' if name[-2:] in ('.d', '.a') else 'rad'}" for name, value in found.items()}


def test_bodies_stay_where_a_calibration_puts_frames_far_off() -> None:
    """Parallel axes that lean by 0.2 mrad have common normals many metres away, and DH frames are there."""
    nominal, rng = preset_robot("ur5"), np.random.default_rng(5)
    frames = [np.eye(4), *(frame(nominal, np.zeros(6), k) for k in range(6))]
    axes = np.array([T[:3, 2] for T in frames[:6]])
    axes[2:4] += 2e-4 * rng.standard_normal((2, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    stated = dh_of(np.array([T[:3, 3] for T in frames[:6]]), axes, frames[6], nominal)
    assert max(abs(float(text.split()[0])) for text in stated.values()) > 10  # m
    off = corrected(nominal, stated)
    assert off.length == pytest.approx(nominal.length, rel=0.3)
    for q in random_postures(nominal, 20):
        np.testing.assert_allclose(pose(off, q), pose(nominal, q), atol=2e-3)
        for one, other in zip(off.shape, nominal.shape, strict=True):
            np.testing.assert_allclose(ends_of(off, one, q), ends_of(nominal, other, q), atol=2e-3)
        for k, (one, other) in enumerate(zip(off.joints, nominal.joints, strict=True)):
            places = [frame(arm, q, k) @ [*joint.com, 1.0] for arm, joint in ((off, one), (nominal, other))]
            np.testing.assert_allclose(*places, atol=2e-3)
        reached = [nominal_chain(arm, q[None]) for arm in (off, nominal)]
        skeletons = [skeleton_points(arm, there, 1) for arm, there in zip((off, nominal), reached, strict=True)]
        np.testing.assert_allclose(*skeletons, atol=2e-3)


def ends_of(robot, capsule, q):
    """Both ends (2, 3) of a capsule in the world [m]."""
    names = ["base", *robot.joint_names]
    T = pose(robot, q) if capsule.joint == "tool" else np.eye(4)
    T = frame(robot, q, names.index(capsule.joint) - 1) if capsule.joint in names[1:] else T
    return [(T @ [*end, 1.0])[:3] for end in (capsule.start, capsule.end)]
