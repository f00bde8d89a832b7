"""Joint names with dots, as URDF files of cells have them: every document is that of the same arm without dots."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.uncertainty.spread_function import covariance_c
from tests.helpers.shipped import PROBLEMS
from tests.helpers.variants import conformance

DOTTED = {"joint1": "arm.joint_1", "joint2": "base.j.2"}  # the second one begins like a parameter of the base
PROBLEM = PROBLEMS / "insert_planar_2r_measured.yaml"


def renamed(text: str, names: dict[str, str]) -> str:
    return re.sub("|".join(map(re.escape, names)), lambda found: names[found[0]], text)


def loaded(folder: Path, names: dict[str, str], more: str = "") -> Any:
    (folder / "problem.yaml").write_text(renamed(PROBLEM.read_text() + more, names))
    return po.load_problem(folder / "problem.yaml")


def measured(folder: Path, problem: Any, names: dict[str, str], file: str = "planar_2r_measured.csv") -> Any:
    (folder / "data.csv").write_text(renamed((PROBLEMS / file).read_text(), names))
    return po.read_measurements(folder / "data.csv", problem)


def extended(folder: Path, problem: Any, names: dict[str, str]) -> dict[str, Any]:
    found = po.diagnose(problem, measured(folder, problem, names))
    found.save(folder / "out", figures=False)
    return {**found.to_json(), "again": po.select_posture(po.load_problem(folder / "out" / "extended.yaml")).to_json()}


COMPUTED: dict[str, Callable[[Path, Any, dict[str, str]], Any]] = {
    "solve": lambda folder, problem, names: po.select_posture(problem).to_json(),
    "uncertainty": lambda folder, problem, names: po.propagate(problem, [0.3, 0.5]).to_json(),
    "simulate": lambda folder, problem, names: po.simulate(
        problem, dict.fromkeys(names.values(), 0.4), n=100
    ).to_json(),
    "calibrate": lambda f, problem, names: po.calibrate(problem, measured(f, problem, names), plan=False).to_json(),
    "batch": lambda f, p, names: po.calibrate_batch(p, measured(f, p, names, "planar_2r_batch.csv")).to_json(),
    "diagnose": extended,
    "plan": lambda folder, problem, names: po.plan_measurements(problem, 6, candidates=60).to_json(),
    "c": lambda folder, problem, names: list(covariance_c(problem)),
}


@pytest.mark.parametrize("call", conformance(COMPUTED, ["solve", "uncertainty", "plan", "c"]))
def test_dots_change_names_and_nothing_else(tmp_path: Path, call: str) -> None:
    documents = []
    for names in ({name: name for name in DOTTED}, DOTTED):
        folder = tmp_path / names["joint1"]
        folder.mkdir()
        text = json.dumps(COMPUTED[call](folder, loaded(folder, names), names))
        documents.append(
            re.sub(r'"seconds": [^,}]*', "", renamed(text, {dotted: name for name, dotted in names.items()}))
        )
    assert documents[0] == documents[1]


@pytest.mark.parametrize("text", [
    "  correlation: [[joint1.theta, joint2.theta, 0.5]]",
    "  covariance: cov.csv",
])  # fmt: skip
def test_covariances_name_parameters_of_dotted_joints(tmp_path: Path, text: str) -> None:
    head = (
        "robot: {kind: dh, joints: [{name: joint1, type: revolute, a: 1 m}, {name: joint2, type: revolute, a: 1 m}]}\n"
    )
    sigma = "  sigma: {joint1.theta: 1 deg, joint2.theta: 1 deg}\n" if "correlation" in text else ""
    csv = "name, joint1.theta [deg], joint2.theta [deg]\njoint1.theta, 1, 0.5\njoint2.theta, 0.5, 1\n"
    (tmp_path / "cov.csv").write_text(renamed(csv, DOTTED))
    (tmp_path / "p.yaml").write_text(renamed(f"{head}uncertainty:\n{sigma}{text}\n", DOTTED))
    sources = po.load_problem(tmp_path / "p.yaml").sources
    assert sources.names == ("arm.joint_1.theta", "base.j.2.theta")
    np.testing.assert_allclose(sources.covariance, np.radians(1) ** 2 * np.array([[1, 0.5], [0.5, 1]]), rtol=1e-12)
