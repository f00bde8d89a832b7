"""The lecture page beyond its examples: each rule of thumb against a formula or a simulation written by hand here."""

from __future__ import annotations

import importlib
import math
import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.command_line import invoke
from tests.helpers.planar_2r import exact, first_order, position

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = (ROOT / "docs" / "lecture" / "lecture.md").read_text(encoding="utf-8")
DEG = math.pi / 180
BENT = np.radians((90, -135))
SIGMAS = np.array([DEG, 3 * DEG, 0.01, 0.01])
WEAK = np.diag(SIGMAS**2)
NUMBER = re.compile(r"−?\d+(?:\.\d+)?")


@pytest.fixture(scope="module")
def rules():
    sys.path.insert(0, str(ROOT / "docs" / "lecture"))
    try:
        return importlib.import_module("lecture_rules"), importlib.import_module("lecture_formulas")
    finally:
        sys.path.remove(str(ROOT / "docs" / "lecture"))


def numbers(text):
    return [float(x.replace("−", "-")) for x in NUMBER.findall(text)]


def row(start):
    """The numbers of the table row that begins so, without those of its first cell."""
    line = next(line for line in DOCUMENT.splitlines() if line.startswith(f"| {start} |"))
    return numbers(line.split("|", 2)[2])


def section(title):
    return DOCUMENT[DOCUMENT.index(f"## {title}") :].split("\n## ")[0]


@pytest.mark.parametrize(
    ("label", "q", "variances"),
    [
        ("folded, 1° 1°", (90, -180), (DEG**2, DEG**2, 1e-4, 1e-4)),
        ("bent, 1° 1°", (90, -135), (DEG**2, DEG**2, 1e-4, 1e-4)),
        ("bent, 1° 3°", (90, -135), (DEG**2, 9 * DEG**2, 1e-4, 1e-4)),
    ],
)
def test_a_and_alpha_rebuild_the_covariance(label, q, variances):
    lines = section("What A and α1, α2 are").splitlines()
    cells = numbers(next(line for line in lines if line.startswith(f"| {label} |")).split("|", 2)[2])
    small, large, root1, root2, angle = cells[2:]
    t = math.radians(angle)
    A = np.array([[-math.sin(t), math.cos(t)], [math.cos(t), math.sin(t)]])
    C = 1e4 * exact(np.radians(q), np.diag(variances))
    # Four decimals of α, and 0.005° of the angle turn 25e-4 m² of difference by 2e-7 m² = 0.002 in 1e-4 m².
    np.testing.assert_allclose(A @ np.diag([small, large]) @ A.T, C, atol=3e-3)
    np.testing.assert_allclose([root1, root2], 10 * np.sqrt([small, large]), atol=0.006)


def test_whitened_cloud_has_unit_covariance(rules):
    found = rules[0].Axes(rules[0].EXAMPLES["weak"]).whitened
    # Five standard errors of 10⁶ points: √(2/n) of a variance, √(1/n) of a covariance.
    np.testing.assert_allclose(found, np.eye(2), atol=5 * math.sqrt(2e-6))


def test_what_k_sigma_hold_against_simulated_normals():
    z = np.random.default_rng(3).standard_normal((200_000, 6)) ** 2
    for k in (1, 2, 3):
        for shown, m in zip(row(f"±{k} sigma"), (1, 2, 3, 6), strict=True):
            drawn = np.mean(z[:, :m].sum(axis=1) <= k * k)
            assert shown / 100 == pytest.approx(drawn, abs=5 * math.sqrt(0.25 / 200_000))
    assert "±1σ, ±2σ and ±3σ hold 0.68, 0.95 and 0.997" in DOCUMENT
    for k, said in ((1, 0.68), (2, 0.95), (3, 0.997)):
        assert math.erf(k / math.sqrt(2)) == pytest.approx(said, abs=0.005)


def test_twice_the_eigenvalues():
    values = np.linalg.eigvalsh(exact(BENT, WEAK))
    for label, square in (
        ("√(2 α), each eigenvalue doubled", 2.0),
        ("2 √α, two standard deviations", 4.0),
        ("2.448 √α", -2 * math.log(0.05)),
    ):
        k2, major, minor, held, counted, low, high, *_ = row(label)
        assert k2 == pytest.approx(square, abs=6e-4)
        assert [minor, major] == pytest.approx(1e3 * np.sqrt(square * values), abs=0.06)
        assert held == pytest.approx(100 * (1 - math.exp(-square / 2)), abs=0.006)
        assert low <= counted <= high
        # The cloud is bent, not Gaussian: half a percent at most.
        assert counted == pytest.approx(held, abs=0.5)
    assert "1 − 1/e = 63.2 %" in DOCUMENT


def test_kline_and_mcclintock_by_finite_differences():
    text = section("Kline and McClintock's formula")
    step = 1e-6
    parts = []
    for k in range(4):
        ends = []
        for sign in (1, -1):
            p = np.array([*BENT, 1.0, 1.0])
            p[k] += sign * step
            ends.append(position(p[:2], p[2:]))
        parts.append((ends[0] - ends[1]) / (2 * step) * SIGMAS[k])
    parts = np.array(parts).T
    w = np.linalg.norm(parts, axis=1)
    for name, own, total in zip("xy", parts, w, strict=True):
        line = next(line for line in text.splitlines() if line.startswith(f"| {name} |"))
        assert numbers(line) == pytest.approx([*np.abs(1e3 * own), 1e3 * total], abs=0.006)
    C = first_order(BENT, WEAK)
    np.testing.assert_allclose(w**2, np.diag(C), rtol=1e-8)
    values, vectors = np.linalg.eigh(C)
    expected, true = (float(x) for x in re.search(r"expect\s+([\d.]+) mm along.*?are ([\d.]+) mm", text, re.S).groups())
    assert expected == pytest.approx(1e3 * np.linalg.norm(vectors[:, 0] * w), abs=0.06)
    assert true == pytest.approx(1e3 * math.sqrt(values[0]), abs=0.06)
    cloud = np.random.default_rng(1).multivariate_normal([0, 0], C, 200_000)
    boxed = np.mean(np.all(np.abs(cloud) <= 1.96 * w, axis=1))
    said = re.search(r"holds ([\d.]+) % of the cloud, and its area is ([\d.]+) times", text)
    assert float(said[1]) / 100 == pytest.approx(boxed, abs=0.003)
    area = 4 * 1.96**2 * w.prod() / (math.pi * -2 * math.log(0.05) * math.sqrt(np.linalg.det(C)))
    assert float(said[2]) == pytest.approx(area, abs=0.006)


@pytest.mark.parametrize("scale", [0.01, 1.0, 10.0])
def test_the_real_time_formulas_are_the_covariance(rules, scale):
    formulas = rules[1]
    rng = np.random.default_rng(5)
    q, sigma = rng.uniform(-3, 3, (50, 2)), scale * SIGMAS
    for by_hand, closed in ((formulas.first_order, first_order), (formulas.exact, exact)):
        found = np.array(by_hand(q[:, 0], q[:, 1], 1.2, 0.7, *sigma**2))
        C = closed(q, np.diag(sigma**2), (1.2, 0.7))
        # What the document says of rounding: 1e-15 m².
        np.testing.assert_allclose(found, [C[:, 0, 0], C[:, 0, 1], C[:, 1, 1]], rtol=1e-9, atol=1e-15)
    problem = po.load_problem(ROOT / "problems" / "lecture_bent_weak_elbow.yaml")
    batch = po.SpreadFunction(problem, compiled=False)(q)
    found = np.array(formulas.exact(q[:, 0], q[:, 1], 1.0, 1.0, *SIGMAS**2))
    np.testing.assert_allclose(found, [batch[:, 0, 0], batch[:, 0, 1], batch[:, 1, 1]], atol=1e-15)


def test_the_printed_formulas_are_the_tested_ones():
    """The block of the document, read as Python."""
    block = section("In real time").split("\n\n")[2:5]
    lines = [line.strip() for line in "\n".join(block).splitlines()]
    found = {}
    for line in reversed(lines):  # what is of the arm alone stands last
        for name, expression in re.findall(r"(\w+) = (.*?)(?=\s{3,}|\s\s\w+ = |$)", line):
            found[name] = expression
    t1, t2 = 0.4, -1.1
    v1, v2, w1, w2 = SIGMAS**2
    a1, a2 = 1.2, 0.7
    known = {"a1": a1, "a2": a2, "v1": v1, "v2": v2, "w1": w1, "w2": w2, "t1": t1, "t2": t2, "cos": math.cos,
             "sin": math.sin, "e": math.e, "c1": math.cos(t1), "s1": math.sin(t1), "c12": math.cos(t1 + t2),
             "s12": math.sin(t1 + t2)}  # fmt: skip
    known |= {"x": a1 * known["c1"] + a2 * known["c12"], "y": a1 * known["s1"] + a2 * known["s12"]}
    order = ("g1", "g2", "h1", "h2", "h", "h3", "f", "mx", "my", "p", "q", "r", "Cxx", "Cxy", "Cyy")
    values = {name: eval(as_python(found[name]), {}, known | {}) for name in order[:7]}
    known |= values
    for name in order[7:]:
        known[name] = eval(as_python(found[name]), {}, known)
    q = np.array([t1, t2])
    C = first_order(q, WEAK, (a1, a2))
    assert [known["Cxx"], known["Cxy"], known["Cyy"]] == pytest.approx([C[0, 0], C[0, 1], C[1, 1]], rel=1e-12)
    C = exact(q, WEAK, (a1, a2))
    assert [known["p"], known["q"], known["r"]] == pytest.approx(
        [C[0, 0] + C[1, 1], C[0, 0] - C[1, 1], 2 * C[0, 1]], rel=1e-10
    )


def as_python(formula):
    """``g1 c1 + h cos 2θ1`` as Python: products are blanks, powers are ², e^(…)."""
    text = formula.replace("−", "-").replace("²", "**2").replace("^", "**")
    text = text.replace("2θ1+θ2", "2*t1+t2").replace("θ1+θ2", "t1+t2").replace("2θ1", "2*t1").replace("θ", "t")
    text = re.sub(r"(cos|sin) (\d)\(([^)]*)\)", r"\1(\2*(\3))", text)
    text = re.sub(r"(cos|sin) ([\w*]+)", r"\1(\2)", text)
    return re.sub(r"(?<=[\w)]) (?=[\w(])", "*", text)


def test_the_pose_against_the_package_and_a_longer_link(rules):
    pose = rules[0].Pose()
    problem = po.load_problem(ROOT / "problems" / "lecture_bent_weak_elbow.yaml")
    whole = po.propagate(problem, BENT).pose_covariance
    # Exact or first order: they differ by 0.4 % here.
    np.testing.assert_allclose(whole[np.ix_((0, 1, 5), (0, 1, 5))], pose.covariance, rtol=5e-3)
    assert not np.delete(whole, (0, 1, 5), axis=0).any()
    gripper = np.sqrt(np.linalg.eigvalsh(first_order(BENT, WEAK, (1.0, 1.2))))
    # The longer link is the tip, and the error of its length too.
    np.testing.assert_allclose(pose.tip(together=True), gripper, rtol=1e-12)
    minor, major = 1e3 * gripper
    assert f"scatters by {major:.1f} × {minor:.1f} mm" in DOCUMENT
    assert pose.tip(together=False)[1] < 0.9 * gripper[1]
    for name, rho in zip(("x", "y", "φ"), pose.correlations, strict=True):
        lines = section("The posture as a vector of six").splitlines()
        line = next(line for line in lines if line.startswith(f"| {name} |"))
        assert numbers(line)[-3:] == pytest.approx(rho, abs=6e-5)


def test_where_the_measuring_robot_stands_best(rules):
    robot = rules[0].MeasuringRobot()
    grid = np.stack(np.meshgrid(np.linspace(0.8, 1.6, 41), np.linspace(-0.4, 0.4, 41)), axis=-1)
    x, y = grid[..., 0], grid[..., 1]
    t2 = -np.arccos((x**2 + y**2 - 2) / 2)
    q = np.stack([np.arctan2(y, x) - np.arctan2(np.sin(t2), 1 + np.cos(t2)), t2], axis=-1)
    total = np.sqrt(np.trace(exact(q, WEAK), axis1=-2, axis2=-1))
    assert robot.rms == pytest.approx(total.min(), rel=1e-5)
    first = np.trace(first_order(q, WEAK), axis1=-2, axis2=-1)
    np.testing.assert_allclose(first, (x**2 + y**2) * DEG**2 + 9 * DEG**2 + 2e-4, rtol=1e-12)
    assert (
        f"{1e3 * total.min():.2f} mm root mean square; by the formula {1e3 * math.sqrt(first.min()):.2f} mm" in DOCUMENT
    )


def test_the_length_between_two_readings(rules):
    module = rules[0]
    robot = module.MeasuringRobot()
    q = robot.postures
    for what, shared in module.LENGTHS.items():
        np.testing.assert_allclose(position(q), robot.ENDS, atol=1e-12)
        # One covariance of both readings: the same factors where the errors are the same.
        both = np.concatenate([np.diag(SIGMAS), np.diag(SIGMAS)])
        apart = np.concatenate([np.eye(8)[:4], np.eye(8)[4:]]) * np.tile(SIGMAS, 2)[:, None]
        same = np.tile(np.repeat(shared, 2), 2)
        factors = np.hstack([np.where(same[:, None], both, 0), np.where(same[:, None], 0, apart)])
        J = np.zeros(8)
        for end, sign in ((0, -1), (1, 1)):
            for k in range(4):
                ends = []
                for step in (1e-6, -1e-6):
                    p = np.array([*q[end], 1.0, 1.0])
                    p[k] += step
                    ends.append(position(p[:2], p[2:])[1])
                J[4 * end + k] = sign * (ends[0] - ends[1]) / 2e-6
        shown = row(what)
        assert shown[0] == pytest.approx(1e3 * np.linalg.norm(J @ factors), abs=0.006)
        assert shown[2] <= shown[1] <= shown[3]
        assert shown[1] == pytest.approx(shown[0], rel=0.016)  # "differ by up to 1.5 %"
        assert shown[-1] == pytest.approx(1.96 * shown[0], abs=0.06)


COMMANDS = [line.strip() for line in DOCUMENT.splitlines() if line.startswith("    optimize-posture ")]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_of_the_document_runs(command, tmp_path, monkeypatch):
    words = [str(ROOT / w) if w.startswith("problems/") else w for w in shlex.split(command)[1:]]
    monkeypatch.chdir(tmp_path)
    result = invoke(*words)
    assert result.exit_code == 0, result.stderr
