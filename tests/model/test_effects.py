"""Every listed effect: its forward model against an independent simulator, its derivatives, its file and its needs."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import cache
from types import SimpleNamespace
from typing import Any, get_args

import casadi as ca
import numpy as np
import pinocchio
import pytest
import yaml

from posture_opt.errors import BadValueError, InputError
from posture_opt.model.arm import Arm
from posture_opt.model.arm_state import ArmState
from posture_opt.model.effects import EFFECTS, Effect, Excitation
from posture_opt.model.inputs import Inputs
from posture_opt.problem.load import problem_from_dict
from posture_opt.problem.schema import ProblemSpec
from tests.hidden import effects as hidden
from tests.hidden.arms import ARMS
from tests.hidden.designs import REFERENCE, Plan, draw_session
from tests.hidden.draw import place
from tests.hidden.files import document
from tests.hidden.sizes import draw_effect

ALL_INPUTS = frozenset({"approach", "payload", "temperature", "time", "masses", "gear_ratio"})
SHAPES = ("ur10", "scara", "seven")
SCANNED = {"cyclic_error": {"cycles": 7.3}, "gear_ripple": {"ratio": 101.0, "harmonic": 2}}
"""Kinds without candidates, scanned by the diagnosis or in want of a gear ratio: the shape of one instance."""

every_effect = pytest.mark.parametrize("cls", EFFECTS, ids=lambda cls: kind_of(cls))
every_arm = pytest.mark.parametrize("arm", SHAPES)


def kind_of(cls: type[Effect]) -> str:
    return str(get_args(cls.model_fields["kind"].annotation)[0])


@cache
def robots(tmp: Any) -> dict[str, Any]:
    """Simulated site, and the robot of its file with the inputs of its rows, of each arm."""
    found = {}
    for name in (*SHAPES, "planar"):
        rng = np.random.default_rng(11)
        arm = place(rng, ARMS[name]())
        session = draw_session(rng, arm, Plan(rows=40, repeated=0, logged=True, sides=name != "seven"))
        case = SimpleNamespace(nominal=arm, free=False, word=False, truth={"sigma": 5e-5}, priors={})
        if arm.urdf:
            (tmp / "arm.urdf").write_text(arm.urdf)
        robot = problem_from_dict(document(case), folder=tmp).robot
        inputs = Inputs(
            payload=session.payload,
            approach=list(session.side.T),
            approach_length=list(session.travel.T),
            temperature=session.temperature - REFERENCE,
            time=session.time,
            stated=robot.joint_names,
        )
        found[name] = (hidden.Site(arm, session, {}), robot, inputs)
    return found


@pytest.fixture(scope="module")
def sites(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return robots(tmp_path_factory.mktemp("arms"))


def instances(cls: type[Effect], site: hidden.Site, robot: Any) -> list[Effect]:
    """What the data could show of a kind, a handful."""
    span = tuple(np.ptp(site.session.q, axis=0).tolist())
    case = Excitation(robot, ALL_INPUTS, span, float(site.session.time[-1]))
    found = list(cls.candidates(case))
    if kind_of(cls) == "instrument_scale":
        return [cls()]
    if not found and kind_of(cls) in SCANNED:
        return [cls(joint=name, **SCANNED[kind_of(cls)]) for name in case.moving("revolute")]
    return found[:: max(1, len(found) // 6)]


def sized(effect: Effect, rng: np.random.Generator) -> Effect:
    """With an estimate at random, of the size that effects have."""
    size = {"ratio": 3e-4, "angle": 3e-4, "length": 3e-4, "angle per torque": 3e-6, "angle mass per torque": 3e-5,
            "per temperature": 1e-5, "angle per temperature": 1e-5, "per length": 3e-4,
            "length per length": 1e-5}  # fmt: skip
    values = [size[dimension] * rng.uniform(0.3, 1.0) * rng.choice([-1, 1]) for _, dimension in effect.dimensions]
    return effect.with_estimate(values)


def with_effects(robot: Any, effects: tuple[Effect, ...], inputs: Inputs) -> Arm:
    return Arm(robot, effects, inputs)


def one_row(inputs: Inputs, row: int) -> Inputs:
    return Inputs(
        payload=float(inputs.payload[row]),
        approach=[float(side[row]) for side in inputs.approach],
        approach_length=[float(length[row]) for length in inputs.approach_length],
        temperature=float(inputs.temperature[row]),
        time=float(inputs.time[row]),
        stated=inputs.stated,
    )


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
            "joint": target,
            "travel": f"{v.get('d0')!r} rad",
            "estimate": {"height": f"{v.get('h')!r} rad"},
        },
        "load_backlash": {"joint": target, "estimate": {"height": per_torque["h"]}},
        "joint_coupling": {
            "joint": target.split("->")[-1],
            "follows": target.split("->")[0],
            "estimate": {"ratio": v.get("c")},
        },
        "payload_error": {"estimate": {"sag": per_torque["e"]}},
        "thermal_growth": {"length": target, "estimate": {"expansion": f"{v.get('alpha')!r} /K"}},
        "thermal_offset": {"joint": target, "estimate": {"rate": f"{v.get('c')!r} rad/K"}},
        "drift": {
            "course": target,
            "constant": f"{v.get('tau', v.get('span'))!r} s",
            "estimate": {a: f"{v.get(a)!r} m" for a in "xyz"},
        },
        "slip": {
            "of": target,
            "moment": f"{v.get('t0')!r} s",
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
        "quantisation": {"joint": target, "lsb": f"{v.get('lsb')!r} rad", "estimate": {"share": v.get("share")}},
    }
    return {"kind": kind, **of[kind]}


def read(entry: dict[str, Any]) -> Effect:
    """An entry of ``effects:`` as a problem file has it."""
    spec = ProblemSpec.model_validate({"robot": {"kind": "preset", "name": "ur10"}, "effects": [entry]})
    return spec.effects[0]


@every_arm
@every_effect
def test_the_tool_point_is_where_an_independent_simulator_has_it(cls: type[Effect], arm: str, sites: Any) -> None:
    site, robot, inputs = sites[arm]
    kind = kind_of(cls)
    if kind == "payload_error" and not site.session.payload_logged:
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


@every_arm
@every_effect
def test_numbers_arrays_and_symbols_agree(cls: type[Effect], arm: str, sites: Any) -> None:
    site, robot, inputs = sites[arm]
    rng = np.random.default_rng(1)
    for effect in instances(cls, site, robot)[:2]:
        effect = sized(effect, rng)
        many = with_effects(robot, (effect,), inputs).pose(site.session.q)
        for row in (0, 17):
            one = with_effects(robot, (effect,), one_row(inputs, row))
            q = site.session.q[row]
            np.testing.assert_allclose(one.pose(q), many[row], atol=1e-14)
            if row:
                continue
            symbolic = ca.Function("f", [one.q], [one.pose(one.q)])
            np.testing.assert_allclose(np.array(symbolic(q)), many[row], atol=1e-13)
            p = ca.SX.sym("p", len(one.parameters))
            both = ca.Function("f", [one.q, p], [one.pose(one.q, p)])
            np.testing.assert_allclose(np.array(both(q, 0)), many[row], atol=1e-13)


@every_arm
@every_effect
def test_columns_are_the_derivatives_by_the_parameters(cls: type[Effect], arm: str, sites: Any) -> None:
    """Shift and small rotation per unit of each parameter, by central differences about the plain chain."""
    site, robot, inputs = sites[arm]
    effects = instances(cls, site, robot)
    assert effects or (arm == "scara" and kind_of(cls) == "link_bending")
    for effect in effects:
        model = with_effects(robot, (effect,), one_row(inputs, 3))
        q, k = site.session.q[3], len(model.parameters)
        own = range(k - len(effect.parameter_names), k)
        assert model.parameters[own[0] :] == effect.parameter_names
        columns = model.parameter_jacobian(q)
        for i in own:
            # About 1e-4 m of motion; the third derivative leaves its square.
            step = 1e-4 / max(np.abs(columns[:, i]).max(), 1e-3)
            up, down = (model.pose(q, sign * step * np.eye(k)[i]) for sign in (1, -1))
            shift = (up - down)[:3, 3] / (2 * step)
            turn = (up - down)[:3, :3] / (2 * step) @ model.pose(q)[:3, :3].T
            moved = np.array([*shift, turn[2, 1], turn[0, 2], turn[1, 0]])
            np.testing.assert_allclose(columns[:, i], moved, atol=1e-7 * max(1.0, np.abs(moved).max()))


@every_effect
def test_an_effect_without_estimate_is_the_plain_chain(cls: type[Effect], sites: Any) -> None:
    for arm in SHAPES:
        site, robot, inputs = sites[arm]
        for effect in instances(cls, site, robot):
            assert set(effect.values) == {0.0}
            pose = with_effects(robot, (effect,), inputs).pose(site.session.q)
            np.testing.assert_array_equal(pose, Arm(robot).pose(site.session.q))


@every_effect
def test_an_effect_survives_its_file(cls: type[Effect], sites: Any) -> None:
    rng = np.random.default_rng(2)
    for arm in SHAPES:
        site, robot, _ = sites[arm]
        for effect in instances(cls, site, robot):
            effect = sized(effect, rng)
            entry = yaml.safe_load(yaml.safe_dump(effect.to_dict()))
            again = read(entry)
            assert type(again) is cls
            assert again.name == effect.name
            assert again.parameter_names == effect.parameter_names
            np.testing.assert_allclose(again.values, effect.values, rtol=1e-11)  # twelve digits in the file
            for name in effect.shape:
                assert getattr(again, name) == pytest.approx(getattr(effect, name), rel=1e-11)
            assert again.to_dict() == entry


@every_effect
def test_the_schema_knows_the_effect(cls: type[Effect]) -> None:
    schema = ProblemSpec.model_json_schema()
    found = schema["properties"]["effects"]["items"]["discriminator"]["mapping"]
    assert kind_of(cls) in found
    entry = schema["$defs"][found[kind_of(cls)].rpartition("/")[2]]
    assert set(entry["properties"]) == set(cls.model_fields)
    assert entry["description"]
    estimate = entry["properties"]["estimate"]
    for name, _ in getattr(cls, "parameters", ()):
        assert estimate["properties"][name]["description"]
    json.dumps(entry)
    assert cls.summary


def test_kinds_are_listed_once() -> None:
    kinds = [kind_of(cls) for cls in EFFECTS]
    assert len(set(kinds)) == len(kinds)
    assert set(hidden.FORMS) - set(outside()) <= set(kinds)


def outside() -> tuple[str, ...]:
    from tests.hidden.outside import OUTSIDE

    return tuple(OUTSIDE)


@every_effect
def test_a_robot_without_the_target_is_refused(cls: type[Effect], sites: Any) -> None:
    site, robot, _ = sites["seven"]
    effect = instances(cls, site, robot)[0]
    if effect.target in ("all", "base", "payload", "instrument", "linear", "exponential"):
        effect = instances(cls, site, robot)[-1]
    other = sites["ur10"][1]
    if effect.target in ("base", "payload", "instrument", "linear", "exponential"):
        effect.check_robot(other)
    else:
        with pytest.raises(BadValueError, match=r"joint1|one of its joints"):
            effect.check_robot(other)


def test_a_fault_stands_at_its_place_in_the_file(sites: Any) -> None:
    data = yaml.safe_load(RR)
    data["effects"] = [{"kind": "backlash", "joint": "elbow", "estimate": {"width": "0.1 mrad"}}]
    with pytest.raises(InputError) as caught:
        problem_from_dict(data)
    (issue,) = caught.value.issues
    assert issue.key[:2] == ("effects", 0)
    assert "joint1, joint2" in issue.message + issue.mend


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
        ({"kind": "backlash", "joint": "joint1", "estimate": {"width": 1e-4}}, "no unit"),
        ({"kind": "joint_scale", "joint": "joint1", "estimate": {"scale": "1 mrad"}}, "write a number"),
        ({"kind": "backlsh", "joint": "joint1"}, "backlash"),
        ({"kind": "thermal_growth", "length": "joint2.d"}, "joint1.a, joint2.a"),
        ({"kind": "joint_coupling", "joint": "joint2", "follows": "joint9"}, "joint1, joint2"),
        ({"kind": "slip", "of": "joint9", "moment": "1 s"}, "base or one of its joints"),
        ({"kind": "hysteresis", "joint": "joint1", "travel": "0 deg"}, "greater than 0"),
    ],
)
def test_a_wrong_entry_is_told_with_its_mend(entry: dict[str, Any], said: str) -> None:
    data = yaml.safe_load(RR)
    data["effects"] = [entry]
    with pytest.raises(InputError) as caught:
        problem_from_dict(data)
    assert said in str(caught.value)
    assert all(issue.key[0] == "effects" for issue in caught.value.issues)


def test_the_same_effect_twice_is_refused() -> None:
    data = yaml.safe_load(RR)
    data["effects"] = [{"kind": "backlash", "joint": "joint1"}] * 2
    with pytest.raises(InputError, match="given twice"):
        problem_from_dict(data)


def test_masses_that_are_missing_are_asked_for() -> None:
    data = yaml.safe_load(RR)
    del data["robot"]["joints"][1]["mass"]
    data["effects"] = [{"kind": "joint_compliance", "joint": "joint1", "estimate": {"compliance": "8 urad/(N m)"}}]
    with pytest.raises(InputError) as caught:
        problem_from_dict(data)
    (issue,) = caught.value.issues
    assert "masses" in issue.message
    assert "mass and com" in issue.mend


def test_masses_of_a_table_reach_the_torque() -> None:
    robot = problem_from_dict(yaml.safe_load(RR)).robot
    q = (0.3, 0.5)
    site = ArmState(robot, q, Inputs(payload=1.5))
    # By hand: levers along x of the middle of link 1, of the centre of link 2, and of the tool point.
    c1, c12 = np.cos(0.3), np.cos(0.8)
    second = -9.81 * (2 * 0.25 * c12 + 1.5 * 0.4 * c12)
    first = -9.81 * (3 * 0.25 * c1 + 3.5 * 0.5 * c1) + second
    assert site.torque(0) == pytest.approx(first, abs=1e-12)
    assert site.torque(1) == pytest.approx(second, abs=1e-12)
    assert site.payload_torque(1) == pytest.approx(-9.81 * 1.5 * 0.4 * c12, abs=1e-12)


def test_inertials_of_a_urdf_give_pinocchios_torques(sites: Any) -> None:
    simulated, robot, inputs = sites["seven"]
    model = pinocchio.buildModelFromXML(simulated.arm.urdf)
    yaw, pitch, roll = (f.value for f in simulated.arm.base[3:])
    R_world_base = pinocchio.rpy.rpyToMatrix(roll, pitch, yaw)
    tool = np.array([f.value for f in simulated.arm.tool[:3]])
    site = ArmState(robot, list(simulated.session.q.T), inputs)
    found = np.stack([site.torque(j) for j in range(7)], axis=1)
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
    np.testing.assert_allclose(moved, Arm(robot).position(q), atol=1e-12)


def test_several_effects_act_together(sites: Any) -> None:
    site, robot, inputs = sites["ur10"]
    rng = np.random.default_rng(3)
    kinds = ("joint_compliance", "backlash", "thermal_growth", "gear_eccentricity", "base_compliance")
    truths = tuple(draw_effect(rng, site, kind) for kind in kinds)
    arm = with_effects(robot, tuple(read(stated_sizes(truth)) for truth in truths), inputs)
    there = hidden.measured(site, truths)
    assert np.abs(there - site.walk.p).max() > 2e-4
    # The turn of the base is one of the first order here, and acts on the arm without the others.
    np.testing.assert_allclose(arm.position(site.session.q), there, atol=2e-6)


def test_a_problem_without_effects_loads_none_of_them() -> None:
    """They take some 40 ms to be imported, which no one should wait for who has none."""
    code = (
        "import sys; from posture_opt.problem.load import load_builtin; load_builtin('insert_planar_2r');"
        "import posture_opt.selection.selector; print([m for m in sys.modules if 'model.effects' in m])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert found.stdout.strip() == "[]"
