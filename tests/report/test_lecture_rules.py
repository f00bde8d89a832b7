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
from tests.helpers.planar_2r import exact, first_order

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


COMMANDS = [line.strip() for line in DOCUMENT.splitlines() if line.startswith("    optimize-posture ")]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_of_the_document_runs(command, tmp_path, monkeypatch):
    words = [str(ROOT / w) if w.startswith("problems/") else w for w in shlex.split(command)[1:]]
    monkeypatch.chdir(tmp_path)
    result = invoke(*words)
    assert result.exit_code == 0, result.stderr
