"""Effects against an independent simulator, and what is said of wrong entries of a file."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio
import pytest
import yaml

import posture_opt as po
from posture_opt.model.arm_state import ArmState
from posture_opt.model.effects import EFFECTS, Effect
from tests.helpers.effect_cases import SHAPES, read, with_effects
from tests.helpers.variants import conformance
from tests.hidden import effects as hidden
from tests.hidden.sizes import draw_effect

every_effect = pytest.mark.parametrize("cls", EFFECTS, ids=lambda cls: cls.kind_name())
every_arm = pytest.mark.parametrize("arm", conformance(SHAPES, ["ur10"]))


def stated_sizes(effect: hidden.Effect) -> dict[str, Any]:
    """The entry of ``effects:`` that says what the simulator was told."""
    v = {name: float(value) for name, value in {**effect.size, **effect.shape}.items()}
    target, kind = effect.target, effect.kind
    waves = {"sin": f"{v.get('a')!r} rad", "cos": f"{v.get('b')!r} rad"}
    per_torque = {n: f"{v.get(n)!r} rad/(N m)" for n in ("c", "k", "h", "e")}
    of: dict[str, dict[str, Any]] = {
        "joint_scale": {"joint": target, "estimate": {"scale": v.get("c")}},
        "gear_eccentricity": {"joint": target, "estimate": waves},
        "gear_second_harmonic": {"joint": target, "estimate": waves},
        "gear_ripple": {"joint": target, "ratio": v.get("N"), "harmonic": int(v.get("n", 1)), "estimate": waves},
        "cyclic_error": {"joint": target, "cycles": v.get("k"), "estimate": waves},
        "joint_compliance": {"joint": target, "estimate": {"compliance": per_torque["c"]}},
        "link_bending": {"joint": target, "estimate": {"compliance": per_torque["k"]}},
        "base_compliance": {"estimate": {"compliance": per_torque["k"]}},
        "backlash": {"joint": target, "estimate": {"width": f"{v.get('b')!r} rad"}},
        "hysteresis": {
            "joint": target, "travel": f"{v.get('d0')!r} rad", "estimate": {"height": f"{v.get('h')!r} rad"},
        },
        "load_backlash": {"joint": target, "estimate": {"height": per_torque["h"]}},
        "joint_coupling": {
            "joint": target.split("->")[-1], "follows": target.split("->")[0], "estimate": {"ratio": v.get("c")},
        },
        "payload_error": {"estimate": {"sag": per_torque["e"]}},
        "thermal_growth": {"length": target, "estimate": {"expansion": f"{v.get('alpha')!r} /K"}},
        "thermal_offset": {"joint": target, "estimate": {"rate": f"{v.get('c')!r} rad/K"}},
        "drift": {
            "course": target, "constant": f"{v.get('tau', v.get('span'))!r} s",
            "estimate": {a: f"{v.get(a)!r} m" for a in "xyz"},
        },
        "slip": {
            "of": target, "moment": f"{v.get('t0')!r} s",
            "way": "settle" if any(v.get(n) for n in ("roll", "pitch", "yaw")) else "shift",
            "estimate": {
                n: f"{v[n]!r} {'m' if n in ('x', 'y', 'z') else 'rad'}" for n in effect.size if effect.size[n]
            },
        },
        "instrument_scale": {"estimate": {"scale": f"{v.get('c')!r} m/m"}},
        "instrument_field": {
            "estimate": {
                f"{a}_{pair}": f"{v.get(f'{a}{m}')!r} /m"
                for a in "xyz"
                for m, pair in enumerate(("xx", "xy", "xz", "yy", "yz", "zz"))
            }
        },
        "late_reading": {"estimate": {"delay": f"{v.get('t')!r} s"}},
        "tool_shift": {"estimate": {a: f"{v.get(a)!r} m" for a in "xyz"}},
        "quantisation": {"joint": target, "lsb": f"{v.get('lsb')!r} rad", "estimate": {"share": v.get("share")}},
    }  # fmt: skip
    return {"kind": kind, **of[kind]}


@every_arm
@every_effect
def test_the_tool_point_is_where_an_independent_simulator_has_it(cls: type[Effect], arm: str, sites: Any) -> None:
    site, robot, inputs = sites[arm]
    kind = cls.kind_name()
    if kind in ("payload_error", "tool_shift") and not site.session.payload_logged:
        pytest.skip("no payload")
    rng = np.random.default_rng(5)
    found = 0
    for _ in range(4):
        try:
            truth = draw_effect(rng, site, kind)
        except (ValueError, IndexError):  # this arm has no such target, as no link long enough to bend
            continue
        effect = read(stated_sizes(truth))
        effect.check_robot(robot)
        there = hidden.measured(site, (truth,))
        without = hidden.measured(site, ())
        here = with_effects(robot, (effect,), inputs).position(site.session.q)
        size = np.abs(there - without).max()
        if size < 1e-7:  # the joint about the vertical carries nothing
            continue
        found += 1
        # Joint and length increments enter both chains alike: rounding of metres, and of twelve digits in the file.
        # What is shifted and turned at the end is so to first order here: the square of a turn of up to 3e-4 rad
        # at a metre, and what several such errors do to each other.
        tolerance = 1e-9 if kind not in ("link_bending", "base_compliance", "slip", "instrument_field") else 3e-7
        np.testing.assert_allclose(here, there, atol=max(tolerance, 1e-6 * size))
        assert np.abs(here - without).max() > 0.9 * size
    assert found or (arm == "scara" and kind in ("joint_compliance", "load_backlash", "payload_error"))


def test_a_fault_stands_at_its_place_in_the_file(sites: Any) -> None:
    data = yaml.safe_load(RR)
    data["effects"] = [{"kind": "backlash", "joint": "elbow", "estimate": {"width": "0.1 mrad"}}]
    with pytest.raises(po.errors.InputError) as caught:
        po.problem_from_dict(data)
    (issue,) = caught.value.issues
    assert issue.key[:2] == ("effects", 0)
    assert "joint1, joint2" in issue.message + issue.hint


RR = """
robot:
  kind: dh
  gravity: [0, -9.81, 0]
  joints:
    - {name: joint1, a: 500 mm, mass: 3 kg, com: [-250 mm, 0 mm, 0 mm]}
    - {name: joint2, a: 400 mm, mass: 2 kg, com: [-150 mm, 0 mm, 0 mm]}
uncertainty: {sigma: {joint1.theta: 0.1 mrad, joint2.theta: 0.1 mrad}}
task: {kind: insert, direction: [0, 1, 0], position: [0.5 m, 0.4 m, 0 m]}
"""


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"kind": "backlash", "joint": "joint1", "estimate": {"width": "0.1 mm"}}, "not a unit of angle"),
        ({"kind": "backlash", "joint": "joint1", "estimate": {"height": "0.1 mrad"}}, "its parameters: width"),
        ({"kind": "joint_scale", "joint": "joint1", "estimate": {"scale": "1 mrad"}}, "write a number"),
        ({"kind": "backlsh", "joint": "joint1"}, "backlash"),
        ({"kind": "thermal_growth", "length": "joint2.d"}, "joint1.a, joint2.a"),
        ({"kind": "joint_coupling", "joint": "joint2", "follows": "joint9"}, "joint1, joint2"),
        ({"kind": "slip", "of": "joint9", "moment": "1 s"}, "base, tool or one of its joints"),
        ({"kind": "hysteresis", "joint": "joint1", "travel": "0 deg"}, "greater than 0"),
    ],
)
def test_a_wrong_entry_is_told_with_its_hint(entry: dict[str, Any], said: str) -> None:
    data = yaml.safe_load(RR)
    data["effects"] = [entry]
    with pytest.raises(po.errors.InputError) as caught:
        po.problem_from_dict(data)
    assert said in str(caught.value)
    assert all(issue.key[0] == "effects" for issue in caught.value.issues)


def test_masses_that_are_missing_are_asked_for() -> None:
    data = yaml.safe_load(RR)
    del data["robot"]["joints"][1]["mass"]
    data["effects"] = [{"kind": "joint_compliance", "joint": "joint1", "estimate": {"compliance": "8 urad/(N m)"}}]
    with pytest.raises(po.errors.InputError) as caught:
        po.problem_from_dict(data)
    (issue,) = caught.value.issues
    assert "masses" in issue.message
    assert "mass and com" in issue.hint


def test_inertials_of_a_urdf_give_pinocchios_torques(sites: Any) -> None:
    simulated, robot, inputs = sites["seven"]
    model = pinocchio.buildModelFromXML(simulated.arm.urdf)
    yaw, pitch, roll = (f.value for f in simulated.arm.base[3:])
    R_world_base = pinocchio.rpy.rpyToMatrix(roll, pitch, yaw)
    tool = np.array([f.value for f in simulated.arm.tool[:3]])
    state = ArmState(robot, list(simulated.session.q.T), inputs)
    found = np.stack([state.torque(j) for j in range(7)], axis=1)
    for q, load, tau in zip(simulated.session.q, simulated.session.payload, found, strict=True):
        loaded = model.copy()
        loaded.gravity.linear = R_world_base.T @ np.array(robot.gravity)
        loaded.appendBodyToJoint(7, pinocchio.Inertia(load, tool, np.zeros((3, 3))), pinocchio.SE3.Identity())
        # What holds the arm is the negative of what gravity does to it. Some 100 N m, double precision.
        np.testing.assert_allclose(tau, -pinocchio.computeGeneralizedGravity(loaded, loaded.createData(), q), atol=1e-9)


def test_unknown_masses_as_points_make_the_same_sag(sites: Any) -> None:
    """Point masses behind the joints, with a compliance each: what the sum of them does, by hand."""
    site, robot, inputs = sites["ur10"]
    effect = read({
        "kind": "joint_compliance", "joint": "joint2", "loads": "points", "points": ["joint2", "joint3", "tool"],
        "estimate": {"mass at joint2": "10 urad kg/(N m)", "mass at joint3": "4 urad kg/(N m)"},
    })  # fmt: skip
    moved = with_effects(robot, (effect,), inputs).position(site.session.q)
    w = site.walk
    dq = 0.0
    for j, c in ((1, 1e-5), (2, 4e-6)):
        moment = np.cross(w.o_link[:, j] - w.o[:, 1], site.arm.gravity)
        dq = dq + c * np.einsum("na,na->n", w.z[:, 1], moment)
    q = site.session.q.copy()
    q[:, 1] += dq
    np.testing.assert_allclose(moved, po.Arm(robot).position(q), atol=1e-12)
