"""Which reading of the columns fits: misread files of six arms are named, files as they should be are not doubted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posture_opt as po
from tests.helpers.real_arms import DATA, long_on_real_arms
from tests.helpers.simulated_arm import SimulatedArm, shift, turn
from tests.helpers.variants import conformance

P = np.pi / 2
# theta, d, a, alpha: makers' data sheets, rounded
TABLES: dict[str, list[tuple[float, float, float, float]]] = {
    "ur5e": [
        (0, 0.1625, 0, P), (0, 0, -0.425, 0), (0, 0, -0.392, 0),
        (0, 0.1333, 0, P), (0, 0.0997, 0, -P), (0, 0.0996, 0, 0),
    ],
    "kr16": [
        (0, 0.675, 0.26, -P), (0, 0, 0.68, 0), (-P, 0, -0.035, P), (0, 0.67, 0, -P), (0, 0, 0, P), (0, 0.158, 0, 0),
    ],
    "puma": [(0, 0.66, 0, P), (0, 0, 0.432, 0), (0, 0.15, 0.02, -P), (0, 0.432, 0, P), (0, 0, 0, -P), (0, 0.056, 0, 0)],
    "irb120": [(0, 0.29, 0, -P), (-P, 0, 0.27, 0), (0, 0, 0.07, -P), (0, 0.302, 0, P), (0, 0, 0, -P), (0, 0.072, 0, 0)],
    "gen3lite": [
        (0, 0.243, 0, P), (P, 0.03, 0.28, 0), (P, 0.02, 0, P), (P, 0.245, 0, P), (0, 0.057, 0, P), (0, 0.235, 0, 0),
    ],
    "seven": [
        (0, 0.36, 0, -P), (0, 0, 0, P), (0, 0.42, 0, P), (0, 0, 0, -P), (0, 0.4, 0, -P), (0, 0, 0, P), (0, 0.126, 0, 0),
    ],
}  # fmt: skip
ANGLES = {
    "rpy": ("roll [deg], pitch [deg], yaw [deg]", lambda R: R.as_euler("xyz", degrees=True)),
    "intrinsic_xyz": ("roll [deg], pitch [deg], yaw [deg]", lambda R: R.as_euler("XYZ", degrees=True)),
    "abc": ("a [deg], b [deg], c [deg]", lambda R: R.as_euler("ZYX", degrees=True)),
    "wpr": ("w [deg], p [deg], r [deg]", lambda R: R.as_euler("xyz", degrees=True)),
    "zyz": ("roll [deg], pitch [deg], yaw [deg]", lambda R: R.as_euler("ZYZ", degrees=True)),
    "rotation_vector": ("rx [rad], ry [rad], rz [rad]", lambda R: R.as_rotvec()),
    "matrix": (", ".join(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)), lambda R: R.as_matrix().reshape(-1, 9)),
}  # fmt: skip


class Session:
    """An arm with errors of its own, measured by a tracker: joint values [rad], points [m], rotations."""

    def __init__(self, arm: str, seed: int, rows: int = 40) -> None:
        rng = np.random.default_rng(seed)
        table = tuple((f"j{k + 1}", "revolute", *row) for k, row in enumerate(TABLES[arm]))
        errors = {f"{name}.theta": rng.normal(0, 1e-3) for name, *_ in table}
        errors |= {f"{name}.{key}": rng.normal(0, 3e-4) for name, *_ in table for key in ("a", "d", "alpha")}
        base = shift(*rng.uniform(-2, 2, 3)) @ turn(2, rng.uniform(-3, 3)) @ turn(0, rng.normal(0, 0.2))
        tool = shift(*rng.normal(0, 0.04, 2), rng.uniform(0.05, 0.2)) @ turn(1, rng.normal(0, 0.4))
        simulated = SimulatedArm(table, errors, base=base, tool=tool)
        self.q = rng.uniform(-2.0, 2.0, (rows, len(table)))
        T = simulated.poses(self.q)
        self.x = T[:, :3, 3] + rng.normal(0, 1e-4, (rows, 3))
        self.R = Rotation.from_matrix(T[:, :3, :3]) * Rotation.from_rotvec(rng.normal(0, 2e-4, (rows, 3)))
        self.names = [row[0] for row in table]
        self.robot = simulated.section(("-360 deg", "360 deg"), base="free", tool="free")

    def table(self, q: np.ndarray, x: np.ndarray, turned: Any = None) -> dict[str, np.ndarray]:
        found = {f"{name} [deg]": np.degrees(values) for name, values in zip(self.names, q.T, strict=True)}
        found |= {f"{axis} [mm]": 1e3 * x[:, k] for k, axis in enumerate("xyz")}
        head, numbers = turned if turned is not None else ("", np.zeros((len(q), 0)))
        return found | dict(zip(head.split(", "), np.asarray(numbers).T, strict=False))

    def problem(self, **data: Any) -> po.Problem:
        noise = {"position": "0.1 mm", "orientation": "0.2 mrad"}
        return po.problem_from_dict({"robot": self.robot, "data": data, "uncertainty": {"measurement": noise}})


def named(table: dict[str, np.ndarray], problem: po.Problem) -> list[tuple[str, str]]:
    """Id and hint of every reading that an error or a caution names."""
    try:
        better = po.read_measurements(table, problem).better_reading
    except po.errors.InputError as error:
        return [(issue.id, issue.hint) for issue in error.issues]
    return [] if better is None else [(one.id, one.hint) for one in (better.reading, *better.alike)]


def misread(session: Session, kind: str, rng: np.random.Generator) -> tuple[dict[str, np.ndarray], str]:
    """A table that is misread in one way, and the id that names it."""
    q, x, R, n = session.q.copy(), session.x, session.R, session.q.shape[1]
    zeros = np.radians([90, -90, 180])
    i, j = rng.permutation(np.arange(1, n - 1))[:2]
    if kind == "zero":
        q[:, i] += rng.choice(zeros)
        return session.table(q, x), "reading.joint-zero"
    if kind == "two zeros":
        q[:, [i, j]] += rng.choice(zeros, 2)
        return session.table(q, x), "reading.joint-zero"
    if kind == "sign":
        q[:, i] *= -1
        return session.table(q, x, (ANGLES["rpy"][0], ANGLES["rpy"][1](R))), "reading.joint-sign"
    if kind == "coupled sign":
        q[:, 2] = q[:, 1] - q[:, 2]
        return session.table(q, x), "reading.joint-sign"
    if kind == "order":
        q[:, [i, j]] = q[:, [j, i]]
        return session.table(q, x), "reading.joint-order"
    if kind == "scale":
        return session.table(q, x * rng.choice([0.97, 1.02, 1.05])), "reading.scale"
    if kind == "inverted":
        S = R.inv()
        return session.table(q, -S.apply(x), (ANGLES["abc"][0], ANGLES["abc"][1](S))), "reading.direction"
    if kind == "quaternion":
        return session.table(q, x, ("qw, qx, qy, qz", R.as_quat())), "reading.orientation"
    if kind == "radians":
        return session.table(q, x, (ANGLES["rpy"][0], np.radians(ANGLES["rpy"][1](R)))), "reading.orientation"
    meant, written = {"abc as rpy": ("abc", "rpy"), "rpy as vector": ("rpy", "rotation_vector")}.get(
        kind, (kind, "rpy")
    )
    numbers = ANGLES[meant][1](R)
    numbers = np.radians(numbers) if written == "rotation_vector" else numbers
    return session.table(q, x, (ANGLES[written][0], numbers)), "reading.orientation"


KINDS = [
    "zero", "two zeros", "sign", "coupled sign", "order", "scale", "inverted", "quaternion", "radians",
    "abc as rpy", "rpy as vector", "intrinsic_xyz", "zyz",
]  # fmt: skip


ALWAYS = ("zero", "sign", "coupled sign", "order", "scale", "inverted", "abc as rpy")


@pytest.mark.parametrize("kind", conformance(KINDS, ALWAYS))
def test_misread_files_are_named(kind: str) -> None:
    arm = list(TABLES)[KINDS.index(kind) % len(TABLES)]
    rng = np.random.default_rng([7, *map(ord, arm)])
    session = Session(arm, int(rng.integers(1 << 30)))
    table, id = misread(session, kind, rng)
    assert id in [found for found, _ in named(table, session.problem())], (arm, kind)


@pytest.mark.parametrize("key", ANGLES)
def test_files_that_fit_are_not_doubted(key: str) -> None:
    head, write = ANGLES[key]
    seed = list(ANGLES).index(key)
    session = Session(list(TABLES)[seed % len(TABLES)], seed)
    stated = {"orientation": key} if key in ("intrinsic_xyz", "zyz") else {}
    table = session.table(session.q, session.x, (head, write(session.R)))
    assert named(table, session.problem(**stated)) == []
    assert named(session.table(session.q, session.x), session.problem()) == []


def test_the_line_in_the_hint_makes_the_file_fit() -> None:
    session = Session("ur5e", 3)
    q = session.q * [1, 1, -1, 1, 1, 1] + np.radians([0, 90, 0, 0, 180, 0])
    S = session.R.inv()
    table = session.table(q, -S.apply(session.x), (ANGLES["rpy"][0], ANGLES["abc"][1](S)))
    stated = {
        "orientation": "abc", "direction": "inverted", "joint_zeros": {"j2": "90 deg", "j5": "180 deg"},
        "joint_signs": {"j3": -1},
    }  # fmt: skip
    assert named(table, session.problem(**stated)) == []
    for key, value, id in (
        ("orientation", None, "orientation"), ("direction", "as_named", "direction"), ("joint_signs", {}, "joint-sign"),
        ("joint_zeros", {}, "joint-zero"),
    ):  # fmt: skip
        (found, hint), *_ = named(table, session.problem(**stated | {key: value}))
        assert found == f"reading.{id}"
        assert hint.startswith("data: {")


def test_values_beyond_limits_are_read_a_turn_nearer() -> None:
    session = Session("irb120", 5)
    for joint in session.robot["joints"][1:3]:
        joint["limits"] = ["-128 deg", "128 deg"]
    table = session.table(session.q % (2 * np.pi), session.x)
    data = po.read_measurements(table, session.problem())
    assert np.allclose(data.q[:, 1:3], session.q[:, 1:3])
    assert data.turned_joints == ("j2", "j3")
    assert [one.id for one in data.reading_statements] == ["reading.modulo"]


@long_on_real_arms
def test_real_files_are_not_doubted() -> None:
    for file in ("ipa_ur10/series_a", "ipa_ur10/series_d", "jacobi_ur5/random", "jacobi_wam/test"):
        problem = po.load_problem(DATA / file.split("/")[0] / "problem.yaml")
        assert po.read_measurements(DATA / f"{file}.csv", problem).better_reading is None
