"""Maps of targets against closed-form inverse kinematics, direct searches, and an arm of another library."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

import posture_opt as po
from posture_opt.selection.maps.map_exchange import BaseMotion
from posture_opt.uncertainty.clearance import radius_in_space
from tests.helpers.command_line import invoke
from tests.helpers.folders import names as names_in
from tests.helpers.variants import conformance

A1, A2 = 1.0, 0.7
SIGMA = {"joint1.theta": 1e-4, "joint2.theta": 3e-4, "joint1.a": 1e-4, "joint2.a": 2e-4}
UNITS = {"theta": "rad", "a": "m"}


def planar(**task: Any) -> dict[str, Any]:
    joints = [{"name": f"joint{k}", "a": f"{a} m", "limits": ["-180 deg", "180 deg"]} for k, a in ((1, A1), (2, A2))]
    return {
        "name": "two links",
        "robot": {"kind": "dh", "joints": joints},
        "uncertainty": {"sigma": {name: f"{s} {UNITS[name.split('.')[1]]}" for name, s in SIGMA.items()}},
        "task": {"kind": "insert", "direction": [0, -1, 0], "position": ["0.9 m", "0.4 m", "0 m"], **task},
    }


def elbows(x: float, y: float) -> list[tuple[float, float]]:
    """Both postures that reach (x, y), by the law of cosines."""
    c = (x * x + y * y - A1 * A1 - A2 * A2) / (2 * A1 * A2)
    if abs(c) > 1:
        return []
    return [
        ((np.arctan2(y, x) - np.arctan2(A2 * np.sin(b), A1 + A2 * np.cos(b)) + np.pi) % (2 * np.pi) - np.pi, b)
        for b in (np.arccos(c), -np.arccos(c))
    ]


def sigma_x(q1: float, q2: float) -> float:
    """Standard deviation across a vertical direction, to first order."""
    s1, s12, c1, c12 = np.sin(q1), np.sin(q1 + q2), np.cos(q1), np.cos(q1 + q2)
    row = np.array([-A1 * s1 - A2 * s12, -A2 * s12, c1, c12])
    return float(np.linalg.norm(row * list(SIGMA.values())))


def run(*words: object) -> Result:
    return invoke("map", *words)


def written_problem(folder: Path, data: dict[str, Any]) -> Path:
    file = folder / "problem.yaml"
    file.write_text(po.problem_from_dict(data).to_yaml(), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def two_links() -> po.TargetMap:
    problem = po.problem_from_dict(planar())
    return po.map_targets(problem, counts=(11, 9), low=(-1.8, -1.2, 0), high=(1.8, 1.5, 0))


def test_every_target_has_the_better_of_both_elbows(two_links: po.TargetMap) -> None:
    points = two_links.grid.points
    assert points.shape == (99, 3)
    np.testing.assert_allclose(np.unique(points[:, 0]), np.linspace(-1.8, 1.8, 11))
    for point, map_point in zip(points, two_links.map_points, strict=True):
        postures = elbows(*point[:2])
        assert map_point.feasible == bool(postures), point
        if postures:
            # Second order of errors of 3e-4 rad: 1e-7 of σ; where the two elbows meet, the solver's own 1e-6.
            assert map_point.sigma_max == pytest.approx(min(sigma_x(*q) for q in postures), rel=1e-4)
            q1, q2 = map_point.q
            x, y = A1 * np.cos(q1) + A2 * np.cos(q1 + q2), A1 * np.sin(q1) + A2 * np.sin(q1 + q2)
            assert np.hypot(x - point[0], y - point[1]) < 2e-6
    beyond = np.hypot(points[:, 0], points[:, 1]) > A1 + A2
    within = np.hypot(points[:, 0], points[:, 1]) < A1 - A2
    assert beyond.any()
    assert within.any()
    assert not two_links.feasible[beyond | within].any()


def test_what_is_reached_but_not_allowed_is_told_apart() -> None:
    limit = np.radians(120)
    problem = po.problem_from_dict(planar(subject_to=[{"kind": "limit_margin", "at_least": "60 deg"}]))
    found = po.map_targets(problem, counts=(8, 8), low=(-1.55, -1.5, 0), high=(1.6, 1.45, 0))
    statuses = []
    for point, map_point in zip(found.grid.points, found.map_points, strict=True):
        postures = elbows(*point[:2])
        allowed = [q for q in postures if max(map(abs, q)) <= limit]
        statuses.append("feasible" if allowed else "requirement not met" if postures else "not reached")
        if allowed:
            assert map_point.sigma_max == pytest.approx(min(sigma_x(*q) for q in allowed), rel=1e-4)
    assert [map_point.status for map_point in found.map_points] == statuses
    assert len(set(statuses)) == 3


@pytest.mark.long
def test_a_grid_lies_across_the_direction_or_where_it_is_asked_to() -> None:
    problem = po.load_problem("insert_scara")
    across = po.map_targets(problem, counts=(3, 3))
    assert across.grid.aligned
    np.testing.assert_allclose(across.grid.points[:, 2], -0.08)
    np.testing.assert_allclose(across.grid.points.mean(axis=0), [0.2, 0.15, -0.08])
    upright = po.map_targets(problem, counts=(2, 1, 3), low=(0.2, 0.15, -0.12), high=(0.24, 0.15, -0.04))
    np.testing.assert_allclose(np.unique(upright.grid.points[:, 2]), [-0.12, -0.08, -0.04])
    np.testing.assert_array_equal(upright.grid.axes, np.eye(3)[[0, 2, 1]])
    layers = po.map_targets(problem, counts=(2, 3, 2), low=(0.2, 0.1, -0.12), high=(0.24, 0.16, -0.04))
    assert layers.grid.shape == (2, 3, 2)
    line = po.map_targets(problem, counts=(1, 1, 4), low=(0.2, 0.15, -0.12), high=(0.2, 0.15, -0.04))
    assert line.grid.shape == (1, 1, 4)
    for found in (across, upright, layers, line):
        assert found.plot().axes


def test_nothing_in_reach_has_no_map() -> None:
    with pytest.raises(po.errors.NoSolutionError, match="none of the 4 targets"):
        po.map_targets(po.problem_from_dict(planar()), counts=(2, 2), low=(2, 2, 0), high=(3, 3, 0))


@pytest.mark.parametrize(
    ("task", "box"),
    [
        ({"position": ["0.9 m", "0.4 m", "0.1 m"]}, {}),
        ({}, {"low": (0.2, 0.0, 0.1), "high": (1.0, 1.0, 0.1)}),
        ({"position": None, "region": {"min": ["0 m", "0 m", "0.1 m"], "max": ["1 m", "1 m", "0.2 m"]}}, {}),
    ],
)
def test_another_plane_than_that_of_the_arm_is_refused(task: dict[str, Any], box: dict[str, Any]) -> None:
    with pytest.raises(po.errors.NoSolutionError, match="100 mm outside the plane that this arm moves in"):
        po.map_targets(po.problem_from_dict(planar(**task)), counts=(3, 3), compiled=False, **box)


def test_the_command_writes_table_document_and_figure(tmp_path: Path) -> None:
    file, out = written_problem(tmp_path, planar(clearance="1 mm")), tmp_path / "out"
    words = ["--problem", file, "--grid", "7x5", "--min", "-1.8 m, -1 m, 0 m", "--max", "1.8 m, 1 m, 0 m"]
    result = run(*words, "--out", out)
    assert result.exit_code == 0, result.stderr
    names = {"map.csv", "map.json", "map.png", "map.svg", "report.txt", "report.html"}
    assert set(names_in(out)) == names
    with (out / "map.csv").open(encoding="utf-8") as table:
        rows = list(csv.DictReader(table, skipinitialspace=True))
    document = json.loads((out / "map.json").read_text(encoding="utf-8"))
    assert len(rows) == len(document["targets"]) == 35
    for row, entry in zip(rows, document["targets"], strict=True):
        x, y = float(row["x [mm]"]), float(row["y [mm]"])
        np.testing.assert_allclose([x, y], 1e3 * np.array(entry["position"][:2]), atol=1e-4)
        assert (row["feasible"] == "1") == entry["feasible"] == bool(elbows(x / 1e3, y / 1e3))
        if entry["feasible"]:
            q = np.radians([float(row["joint1 [deg]"]), float(row["joint2 [deg]"])])
            sigma = sigma_x(*q)
            assert float(row["sigma across the direction [mm]"]) == pytest.approx(1e3 * sigma, rel=1e-4)
            assert entry["sigma_max"] == pytest.approx(sigma, rel=1e-4)
            # One direction: 95 % of a normal distribution lie within 1.96 σ.
            assert entry["radius95"] == pytest.approx(1.959964 * sigma, rel=1e-3)
            assert 0 <= float(row["success"]) <= 1
        else:
            assert row["joint1 [deg]"] == row["sigma across the direction [mm]"] == ""
            assert entry["posture"] is None
    sigmas = [entry["sigma_max"] for entry in document["targets"]]
    assert document["best"]["sigma_max"] == pytest.approx(min(filter(None, sigmas)))
    text = result.stdout
    assert "of 35 targets" in text
    assert "position in the problem" in text
    assert max(map(len, text.splitlines())) <= 100
    alone = run(*words, "--json")
    assert json.loads(alone.stdout)["targets"] == document["targets"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--grid", "many"], "is no grid"), (["--grid", "0x5"], "is no grid"),
        (["--grid", "1x1"], "one target is no map"), (["--grid", "999x999"], "more than"),
        (["--grid", "3x3x3"], "no width in z"), (["--min", "0 m, 0 m, 0 m"], "two corners"),
        (["--min", "0 m, 0 m, 0 m", "--max", "0 m, 0 m, 0 m"], "one point"),
        (["--min", "1 m, 0 m, 0 m", "--max", "0 m, 1 m, 0 m"], "empty in x"),
        (["--min", "0 m, 0 m", "--max", "1 m, 1 m, 0 m"], "three coordinates"),
        (["--min", "1, 0 m, 0 m", "--max", "1 m, 1 m, 0 m"], "no unit"), (["--plane", "xz"], "moves in another plane"),
    ],
)  # fmt: skip
def test_a_grid_that_is_none_is_refused(tmp_path: Path, words: list[str], told: str) -> None:
    result = run("--problem", written_problem(tmp_path, planar()), *words)
    assert result.exit_code == 2, result.stdout
    assert told in result.stderr


def transform(theta: float, d: float, a: float, alpha: float, beta: float = 0.0) -> np.ndarray:
    """Denavit and Hartenberg's matrix, with Hayati's turn about the new y axis behind it."""
    ct, st, ca, sa, cb, sb = (f(v) for v in (theta, alpha, beta) for f in (np.cos, np.sin))
    T = np.array([
        [ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1.0],
    ])  # fmt: skip
    return T @ np.array([[cb, 0, sb, 0], [0, 1, 0, 0], [-sb, 0, cb, 0], [0, 0, 0, 1.0]])


def tool_point(table: list[tuple[float, float, float]], q: Any, errors: dict[str, float]) -> np.ndarray:
    """(3,) of a DH arm (d, a, alpha of each joint) with errors, by the textbook."""
    T = np.eye(4)
    for k, ((d, a, alpha), angle) in enumerate(zip(table, q, strict=True), start=1):
        e = {key: errors.get(f"joint{k}.{key}", 0.0) for key in ("theta", "d", "a", "alpha", "beta")}
        T = T @ transform(angle + e["theta"], d + e["d"], a + e["a"], alpha + e["alpha"], e["beta"])
    return np.asarray(T[:3, 3])


SIX = [(0.2, 0.0, np.pi / 2), (0, -0.4, 0), (0, -0.4, 0), (0.1, 0, np.pi / 2), (0.1, 0, -np.pi / 2), (0.1, 0, 0)]
WRONG = {"joint1.theta": 2e-3, "joint2.a": 1e-3, "joint3.beta": -1e-3, "joint4.d": 5e-4, "joint5.alpha": 3e-3}


def corrected(
    table: list[tuple[float, float, float]], errors: dict[str, float], sigma: float, **task: Any
) -> dict[str, Any]:
    joints = [{"name": f"joint{k + 1}", "d": f"{d} m", "a": f"{a} m", "alpha": f"{al} rad"}
              for k, (d, a, al) in enumerate(table)]  # fmt: skip
    unit = {name: "m" if name.endswith((".a", ".d")) else "rad" for name in errors}
    return {
        "name": "corrected",
        "robot": {"kind": "dh", "joints": joints, "corrections": {n: f"{v} {unit[n]}" for n, v in errors.items()}},
        "uncertainty": {
            "sigma": {f"{joint['name']}.theta": f"{sigma} rad" for joint in joints},
            "measurement": {"position": "0.02 mm"},
        },
        "task": {"kind": "insert", **task},
    }


def test_the_bias_is_that_of_the_arm_with_the_wrong_parameters() -> None:
    position = ["0.5 m", "0.1 m", "0.2 m"]
    problem = po.problem_from_dict(corrected(SIX, WRONG, 1e-4, direction=[0, 0, -1], position=position))
    found = po.map_accuracy(problem, counts=(3, 3))
    assert found.targets.feasible.any()
    for map_point, bias, C in zip(found.targets.map_points, found.bias, found.covariance, strict=True):
        if not map_point.feasible:
            assert np.isnan(bias).all()
            continue
        # To the solver's 1e-6 m; the second order of 1e-4 rad moves the mean by 1e-8 m.
        np.testing.assert_allclose(tool_point(SIX, map_point.q, {}), map_point.position, atol=2e-6)
        landed = tool_point(SIX, map_point.q, WRONG)
        np.testing.assert_allclose(bias, landed - map_point.position, atol=3e-6)
        steps = 1e-6 * np.eye(6)
        q = map_point.q
        J = np.array([(tool_point(SIX, q + s, WRONG) - tool_point(SIX, q - s, WRONG)) / 2e-6 for s in steps])
        np.testing.assert_allclose(C, 1e-8 * J.T @ J, rtol=1e-5, atol=1e-14)
    known = found.targets.feasible
    assert 1e-4 < np.nanmax(found.settled) < np.nanmax(found.distance)
    assert found.radius95[known][0] == pytest.approx(
        radius_in_space(0.95, found.covariance[known][0], np.zeros(3)), rel=1e-6
    )
    assert found.own is not None
    middle = found.grid.points.shape[0] // 2
    np.testing.assert_allclose(found.own[0], found.bias[middle], atol=1e-5)


def measured_rows(folder: Path, errors: dict[str, float], sigma: float) -> Path:
    """Measurements of a planar arm with wrong parameters and scattering joints, as a file."""
    rng = np.random.default_rng(4)
    table, q = [(0, A1, 0), (0, A2, 0)], rng.uniform(-2, 2, (400, 2))
    moved = q + rng.normal(0, sigma, q.shape)
    points = np.array([tool_point(table, row, errors)[:2] for row in moved]) + rng.normal(0, 2e-5, (400, 2))
    file = folder / "data.csv"
    head = "joint1 [deg], joint2 [deg], x [mm], y [mm]"
    rows = np.column_stack([np.degrees(q), 1e3 * points])
    np.savetxt(file, rows, fmt="%.9f", delimiter=",", header=head, comments="")
    return file


@pytest.mark.long
def test_measured_rows_stand_beside_what_is_predicted_for_them(tmp_path: Path) -> None:
    errors = {"joint2.a": 3e-3, "joint1.theta": 2e-3}
    table = [(0, A1, 0), (0, A2, 0)]
    data = corrected(table, errors, 2e-4, direction=[0, -1, 0], position=["0.9 m", "0.4 m", "0 m"])
    file, out = written_problem(tmp_path, data), tmp_path / "out"
    words = ["--problem", file, "--quantity", "accuracy", "--data", measured_rows(tmp_path, errors, 2e-4)]
    result = run(*words, "--grid", "8x7", "--out", out)
    assert result.exit_code == 0, result.stderr
    document = json.loads((out / "map.json").read_text(encoding="utf-8"))
    measured = document["measured"]
    assert measured["rows"] == 400
    # Four standard errors of a share of 0.95 in 400.
    assert abs(measured["share_within_95_of_own_posture"] - 0.95) < 4 * np.sqrt(0.95 * 0.05 / 400)
    assert measured["rms_uncorrected"] > 10 * measured["rms"]
    for entry in (e for e in document["targets"] if e["feasible"]):
        q = list(entry["posture"].values())
        bias = tool_point(table, q, errors) - entry["position"]
        np.testing.assert_allclose(entry["bias"], bias, atol=3e-6)
    figures = {f"{name}.{kind}" for name in ("map_bias", "map_spread") for kind in ("png", "svg")}
    assert set(names_in(out)) == {"map.csv", "map.json", "report.txt", "report.html", *figures}
    with (out / "map.csv").open(encoding="utf-8") as rows:
        first = next(row for row in csv.DictReader(rows, skipinitialspace=True) if row["feasible"] == "1")
    parts = [float(first[f"bias {c} [mm]"]) for c in "xyz"]
    assert float(first["bias [mm]"]) == pytest.approx(np.linalg.norm(parts), rel=1e-4)
    stated = {one["id"] for one in json.loads((out / "map.json").read_text(encoding="utf-8"))["statements"]}
    assert any(id.startswith("validation.rows-in-region") for id in stated)
    assert max(map(len, result.stdout.splitlines())) <= 100


def test_rows_that_do_not_tell_the_whole_error_give_no_share(tmp_path: Path) -> None:
    table, errors = [(0, A1, 0), (0, A2, 0)], {"joint2.a": 3e-3}
    data = corrected(table, errors, 2e-4, direction=[0, -1, 0])
    rows = measured_rows(tmp_path, errors, 2e-4)
    where: dict[str, Any] = {"counts": (2, 2), "low": (-0.9, -0.9, 0), "high": (0.9, 0.9, 0)}
    free = po.problem_from_dict({**data, "robot": {**data["robot"], "base": "free"}})
    found = po.map_accuracy(free, po.read_measurements(rows, free), **where)
    assert found.measured is not None
    assert np.isnan([found.measured.share, found.measured.share_near]).all()
    assert "base is free" in found.measured.remarks[0].text
    # A base that stands 0.2 m aside: the rows were measured elsewhere, and no spread is to blame.
    moved = po.problem_from_dict({**data, "robot": {**data["robot"], "base": {"xyz": ["0.2 m", "0 m", "0 m"]}}})
    found = po.map_accuracy(moved, po.read_measurements(rows, moved), **where)
    assert found.measured is not None
    assert np.isnan(found.measured.share)
    assert found.measured.remarks[-1].id == "validation.measured-elsewhere"


def test_effects_count_as_corrections_do() -> None:
    data = corrected([(0, A1, 0), (0, A2, 0)], {}, 1e-5, direction=[0, -1, 0], position=["0.9 m", "0.4 m", "0 m"])
    effect = {"kind": "cyclic_error", "joint": "joint2", "cycles": 3, "estimate": {"sin": "2 mrad", "cos": "0 rad"}}
    problem = po.problem_from_dict({**data, "effects": [effect]})
    found = po.map_accuracy(problem, counts=(3, 3))
    assert found.corrected
    for map_point, bias in zip(found.targets.map_points, found.bias, strict=True):
        if map_point.feasible:
            q = [map_point.q[0], map_point.q[1] + 2e-3 * np.sin(3 * map_point.q[1])]
            landed = tool_point([(0, A1, 0), (0, A2, 0)], q, {})
            np.testing.assert_allclose(bias, landed - map_point.position, atol=3e-6)


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
