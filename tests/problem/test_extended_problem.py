"""Arms with effects: their moments against an independent simulator, and whether the true arm hits its target.

The true arm is the simulator's, which knows nothing of the package; what the package knows of it comes through files.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.uncertainty.tool_point import ToolPoint
from posture_opt.uncertainty.uncertainty_section import covariance_text
from tests.hidden.arms import ARMS
from tests.hidden.designs import Plan, Session, draw_session
from tests.hidden.draw import geometry
from tests.hidden.effects import Effect, Site, measured
from tests.hidden.families import Setting
from tests.hidden.files import document, write_csv
from tests.hidden.mechanics import Arm

Array = np.ndarray
NOISE = 5e-5  # m, of each measured coordinate
TARGET = (0.6, 0.3, 0.2)
LOAD, SIDE, WARM = 8.0, 1, 28.0  # kg, joint1, degC: what the task states
TRUTH = (
    Effect("joint_compliance", "joint2", {"c": 8e-6}),
    Effect("backlash", "joint1", {"b": 4e-4}),
    Effect("thermal_growth", "all", {"alpha": 2.2e-5}),
)
TASK = {
    "kind": "insert", "direction": [0, 0, -1], "position": [f"{v} m" for v in TARGET], "clearance": "0.5 mm",
    "payload": f"{LOAD} kg", "approach": {"joint1": SIDE}, "temperature": f"{WARM} degC",
}  # fmt: skip


def file_of(arm: Arm) -> dict[str, Any]:
    case = SimpleNamespace(nominal=arm, free=False, word=False, truth={"sigma": NOISE}, priors={})
    return document(case)


def alike(q: Array, n: int, *, payload: float, side: Array, warm: float) -> Session:
    """The posture (j,) visited n times."""
    j = len(q)
    return Session(
        np.tile(q, (n, 1)), np.zeros(n, int), np.broadcast_to(side, (n, j)), np.full((n, j), 1e6),
        np.full(n, payload), np.full(n, warm), np.zeros(n), True, True, True,
    )  # fmt: skip


# --- moments


KNOWN = {
    # name: standard deviation [SI], of geometry and effects
    "joint1.theta": 1.0e-4,
    "joint2.theta": 1.2e-4,
    "joint3.a": 1.5e-4,
    "joint_compliance(joint2).compliance": 1.5e-6,
    "backlash(joint1).width": 3.0e-5,  # where the side is not known it is of second order: 1 % of that variance
    "gear_eccentricity(joint3).sin": 1.0e-4,
    "gear_eccentricity(joint3).cos": 0.8e-4,
    "thermal_growth(all).expansion": 2.0e-5,
}
UNITS = ["mrad", "mrad", "mm", "rad/(N m)", "rad", "rad", "rad", "1/K"]
ESTIMATES = {"c": 9e-6, "b": 3e-4, "sin": 2e-4, "cos": -1e-4, "alpha": 1.5e-5}
POSTURE = np.array([0.4, -1.1, 1.3, -0.6, 0.9, 0.2])


def correlated(seed: int = 4) -> Array:
    """A covariance in which geometry and effects hang together."""
    sigma = np.array(list(KNOWN.values()))
    draws = np.random.default_rng(seed).normal(size=(len(sigma), len(sigma) + 3))
    S = draws @ draws.T
    d = np.sqrt(np.diag(S))
    return np.asarray(S / np.outer(d, d) * np.outer(sigma, sigma))


def file_with_effects(arm: str, folder: Path, covariance: Array | None = None) -> dict[str, Any]:
    """The problem file of an arm with four effects, all of them uncertain."""
    names = list(KNOWN)
    (folder / "known.csv").write_text(covariance_text(names, correlated() if covariance is None else covariance, UNITS))
    data = file_of(ARMS[arm]())
    data["uncertainty"] = {"covariance": "known.csv"}
    data["effects"] = [
        {"kind": "joint_compliance", "joint": "joint2", "estimate": {"compliance": f"{ESTIMATES['c']!r} rad/(N m)"}},
        {"kind": "backlash", "joint": "joint1", "estimate": {"width": f"{ESTIMATES['b']!r} rad"}},
        {"kind": "gear_eccentricity", "joint": "joint3",
         "estimate": {"sin": f"{ESTIMATES['sin']!r} rad", "cos": f"{ESTIMATES['cos']!r} rad"}},
        {"kind": "thermal_growth", "estimate": {"expansion": f"{ESTIMATES['alpha']!r} /K"}},
    ]  # fmt: skip
    data["effects"] = [{**entry, "covariance": "known.csv"} for entry in data["effects"]]
    data["task"] = {"kind": "insert", "payload": "8 kg", "temperature": "30 degC"}
    return data


def trials(arm: str, q: Array, covariance: Array, side: Array | float, n: int, rng: np.random.Generator) -> Array:
    """(n, 3) tool points of the independent simulator with parameters at random."""
    draws = dict(zip(KNOWN, rng.multivariate_normal(np.zeros(len(KNOWN)), covariance, n, method="eigh").T, strict=True))
    theta = dict(zip(list(KNOWN)[3:], ESTIMATES.values(), strict=True))
    c, b, sine, cosine, alpha = (theta[name] + draws[name] for name in theta)
    effects: Any = (
        Effect("joint_compliance", "joint2", {"c": c}),
        Effect("backlash", "joint1", {"b": b}),
        Effect("gear_eccentricity", "joint3", {"a": sine, "b": cosine}),
        Effect("thermal_growth", "all", {"alpha": alpha}),
    )
    sides = np.zeros((n, len(q)))
    sides[:, 0] = side
    session = replace(alike(q, n, payload=8.0, side=np.zeros(len(q)), warm=30.0), side=sides)
    # The torque and the increments of the simulator's arm are those without its deviations, as the effects are defined.
    bare = Site(ARMS[arm](), session, {})
    deviations = {name: draws[name] for name in list(KNOWN)[:3]}
    site = Site(bare.arm, session, deviations)
    return measured(site, effects)


def test_moments_are_those_of_an_independent_simulator(tmp_path: Path) -> None:
    """Geometry and effects uncertain together; the covariance between them is a third of the variance and more."""
    data, n = file_with_effects("ur10", tmp_path), 50_000
    problem = po.problem_from_dict({**data, "task": {**data["task"], "approach": {"joint1": 1}}}, tmp_path)
    rng = np.random.default_rng(1)
    points = trials("ur10", POSTURE, correlated(), 1.0, n, rng)
    spread = po.propagate(problem, POSTURE)
    C, sigma = np.cov(points.T), np.sqrt(np.diag(spread.covariance))
    # Variances of 50 000 trials scatter by 0.6 %; five times that. Second order of errors of 3e-4 rad is far below.
    np.testing.assert_allclose(C / np.outer(sigma, sigma), spread.covariance / np.outer(sigma, sigma), atol=0.03)
    # The mean: five standard errors of it.
    assert np.all(np.abs(points.mean(axis=0) - spread.position - spread.bias) < 5 * sigma / np.sqrt(n) + 1e-7)
    without = ToolPoint.of(problem.arm, SimpleNamespace(names=tuple(KNOWN), covariance=np.diag(np.diag(correlated()))))
    alone = np.asarray(without.moments(POSTURE).covariance)
    assert np.abs(alone - spread.covariance).max() > 0.1 * sigma.max() ** 2  # what leaving out the rest would do
    cloud = po.simulate(problem, POSTURE, n=30_000, seed=2)
    np.testing.assert_allclose(cloud.covariance / np.outer(sigma, sigma), C / np.outer(sigma, sigma), atol=0.05)


def test_an_unknown_side_counts_with_the_square_of_half_the_width(tmp_path: Path) -> None:
    data = file_with_effects("ur10", tmp_path, np.diag(np.square(list(KNOWN.values()))))
    spread = {}
    for side in (-1, 0, 1):
        approach = {"approach": {"joint1": side}} if side else {}
        spread[side] = po.propagate(
            po.problem_from_dict({**data, "task": {**data["task"], **approach}}, tmp_path), POSTURE
        )
    J = spread[0].tool_point
    walk = J.walk(POSTURE)[0]
    z, o = (
        np.array(v, dtype=float) for v in (walk.screws[J.robot.driven[0]].axis, walk.screws[J.robot.driven[0]].origin)
    )
    column = np.cross(z, spread[0].position - o)
    width, sigma = ESTIMATES["b"], KNOWN["backlash(joint1).width"]
    # Where the side is stated the width's own uncertainty counts, s² = 1; where it is not, it is of second order.
    expected = (width**2 - sigma**2) / 4 * np.outer(column, column)
    for side in (-1, 1):
        # The posture differs by half the width: 1.5e-4 of everything.
        np.testing.assert_allclose(spread[0].covariance - spread[side].covariance, expected, atol=1e-3 * 1e-8)
    # What lies between arriving with decreasing and with increasing values is the width.
    apart = spread[-1].position - spread[1].position
    np.testing.assert_allclose(apart, width * column, atol=1e-7)


def test_effects_of_one_joint_share_its_side(tmp_path: Path) -> None:
    data = file_with_effects("ur10", tmp_path, np.diag(np.square(list(KNOWN.values()))))
    data["effects"] += [
        {"kind": "hysteresis", "joint": "joint1", "travel": "0.1 rad", "estimate": {"height": "0.15 mrad"}}
    ]
    problem = po.problem_from_dict(data, tmp_path)
    assert problem.arm.unknown_sides == ("joint1.side",)
    cloud = po.simulate(problem, POSTURE, n=50_000, seed=3)
    # 0.15 mrad of backlash and as much of hysteresis are 0.3 mrad to one side, not 0.21 in the mean of squares.
    np.testing.assert_allclose(cloud.ratio, 1.0, atol=0.02)
    with_one = po.simulate(
        po.problem_from_dict({**data, "effects": data["effects"][:-1]}, tmp_path), POSTURE, n=9, seed=3
    )
    more = cloud.spread.covariance - with_one.spread.covariance
    radius = np.hypot(*cloud.spread.position[:2])
    assert np.trace(more) == pytest.approx((3e-4**2 - 1.5e-4**2) * radius**2, rel=1e-3)


# --- the true arm


@dataclass(frozen=True, eq=False)
class World:
    """The true arm, and what files say of it."""

    arm: Arm
    deviations: dict[str, Any]
    folder: Path
    problem: po.Problem
    found: po.Diagnosis
    extended: po.Problem

    def lands(self, q: Array, *, payload: float = LOAD, side: float = SIDE, warm: float = WARM) -> Array:
        """(3,) where the tool point of the true arm comes to lie."""
        session = alike(q, 1, payload=payload, side=np.full(6, side), warm=warm)
        return np.asarray(measured(Site(self.arm, session, self.deviations), TRUTH)[0])


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    folder, rng = tmp_path_factory.mktemp("world"), np.random.default_rng(4)
    arm = ARMS["ur10"]()
    deviations = geometry(rng, arm, Setting("ur10"))
    plan = Plan(rows=110, repeated=5, visits=2, payloads=(0.0, 5.0, 10.0), sides=True, logged=True)
    session = draw_session(rng, arm, plan)
    points = measured(Site(arm, session, deviations), TRUTH) + rng.normal(0, NOISE, (len(session), 3))
    (folder / "problem.yaml").write_text(yaml.safe_dump({**file_of(arm), "task": TASK}, sort_keys=False))
    write_csv(folder / "data.csv", arm, session, points)
    problem = po.load_problem(folder / "problem.yaml")
    found = po.diagnose(problem, po.read_measurements(folder / "data.csv", problem), flips=99)
    for name, content in po.extended_problem(problem, found).files("extended").items():
        (folder / name).write_bytes(content)
    return World(arm, deviations, folder, problem, found, po.load_problem(folder / "extended.yaml"))


@cache
def solved(problem: po.Problem) -> po.Solution:
    return po.PostureSelector(problem, compiled=False).solve()


@pytest.mark.long
def test_what_was_hidden_stands_in_the_file_of_the_extended_arm(world: World) -> None:
    found = {(effect.kind, effect.target): effect for effect in world.extended.effects}
    assert set(found) == {truth.name for truth in TRUTH}
    sigma = dict(zip(world.extended.sources.names, world.extended.sources.sigma, strict=True))
    for truth in TRUTH:
        effect = found[truth.name]
        (size,), (estimate,) = truth.size.values(), effect.values
        # Within four standard errors of the estimate, which are a tenth of it at most.
        assert abs(estimate - size) < 4 * sigma[effect.parameter_names[0]] < 0.5 * size


@pytest.mark.long
def test_the_true_arm_hits_the_target_that_the_extended_one_was_sent_to(world: World) -> None:
    """The nominal arm misses by a millimetre."""
    miss, predicted = {}, {}
    nominal = replace(world.problem, sources=world.extended.sources)
    for name, problem in (("nominal", nominal), ("extended", world.extended)):
        solution = solved(problem)
        off = world.lands(solution.q) - np.array(TARGET)
        miss[name] = float(np.hypot(*off[:2]))  # across the direction of insertion
        predicted[name] = float(solution.critical.radius95)
        if name == "extended":
            C = solution.spread.covariance
            assert off @ np.linalg.solve(C, off) < 16.3  # χ² of three, one in a thousand
    assert miss["extended"] < predicted["extended"] < 0.06e-3
    assert miss["nominal"] > 0.5e-3


@pytest.mark.long
def test_predictions_hold_all_over_the_workspace(world: World) -> None:
    """Where the arm of the file says it comes to lie, the true one does, at other loads, sides and temperatures too."""
    rng = np.random.default_rng(8)
    distances = []
    for payload, side, warm in ((0.0, 1, 20.0), (10.0, -1, 20.0), (5.0, 1, 30.0), (8.0, -1, 12.0)):
        task = {"payload": f"{payload} kg", "approach": {"joint1": side}, "temperature": f"{warm} degC"}
        problem = world.extended.with_task(**task)
        for q in rng.uniform(-2.2, 2.2, (8, 6)):
            spread = po.propagate(problem, q)
            off = world.lands(q, payload=payload, side=side, warm=warm) - spread.position - spread.bias
            distances.append(float(off @ np.linalg.solve(spread.covariance, off)))
    # One estimate, so the 32 places hang together; still nearly all lie in the 99.9 % region, and the mean is about 3.
    assert np.mean(np.array(distances) < 16.3) > 0.9
    assert np.mean(distances) < 6.0


@pytest.mark.long
def test_the_same_data_find_nothing_in_the_extended_arm(world: World) -> None:
    data = po.read_measurements(world.folder / "data.csv", world.extended)
    again = po.diagnose(world.extended, data, flips=99)
    assert not [f for f in again.effects if f.effect is not None]
    assert again.errors["nominal"].rms < 1.2 * np.sqrt(3) * NOISE
    twice = po.extended_problem(world.extended, again)
    for name, content in twice.files("twice").items():
        (world.folder / name).write_bytes(content)
    twice = po.load_problem(world.folder / "twice.yaml")
    assert [e.values for e in twice.effects] == [e.values for e in world.extended.effects]
    # The covariance moves along, once: the file of the first round is not read again.
    assert {e.covariance for e in twice.effects} == {"twice_covariance.csv"}
    q = solved(world.extended).q
    ratio = po.propagate(twice, q).covariance.trace() / po.propagate(world.extended, q).covariance.trace()
    assert 0.3 < ratio < 2.5  # directions that move what was measured hardly at all may be told anew


def test_effects_may_have_covariances_of_their_own(tmp_path: Path) -> None:
    """Beside sigma, in a file of their own, with names of the geometry in it or without; a wrong one is told of."""
    known = np.array([4e-14, 2e-13])  # (0.2 urad/(N m))², and a geometry's 1e-7 rad with it
    names = ["joint_compliance(joint2).compliance", "joint2.theta"]
    (tmp_path / "own.csv").write_text(covariance_text(names, np.diag(known), ["rad/(N m)", "mrad"]))
    data = file_of(ARMS["ur10"]())
    data["uncertainty"] = {"sigma": {"joint1.theta": "0.1 mrad", "backlash(joint1).width": "30 urad"}}
    compliance = {"kind": "joint_compliance", "joint": "joint2", "estimate": {"compliance": "9 urad/(N m)"}}
    backlash = {"kind": "backlash", "joint": "joint1", "estimate": {"width": "0.3 mrad"}}
    data["effects"] = [{**compliance, "covariance": "own.csv"}, backlash]
    problem = po.problem_from_dict(data, tmp_path)
    sigma = dict(zip(problem.sources.names, problem.sources.sigma, strict=True))
    assert sigma == pytest.approx(
        {"joint1.theta": 1e-4, "backlash(joint1).width": 3e-5, names[0]: 2e-7, names[1]: np.sqrt(2e-13)}, rel=1e-9
    )
    written = problem.files("moved")
    assert set(written) == {"moved.yaml", "moved_effects_covariance.csv"}
    (tmp_path / "elsewhere").mkdir()
    for name, content in written.items():
        (tmp_path / "elsewhere" / name).write_bytes(content)
    again = po.load_problem(tmp_path / "elsewhere" / "moved.yaml")
    np.testing.assert_array_equal(again.sources.covariance, problem.sources.covariance)
    data["effects"][1]["covariance"] = "nowhere.csv"
    with pytest.raises(po.errors.InputError, match="no such file") as caught:
        po.problem_from_dict(data, tmp_path)
    assert caught.value.issues[0].key == ("effects", 1, "covariance")
