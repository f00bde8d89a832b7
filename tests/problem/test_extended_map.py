"""What an extended.yaml is good for beyond one posture: maps of it, and the next measurements, against the true arm."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from posture_opt.files import problems_folder
from tests.helpers import measured_ur10 as arm
from tests.helpers.command_line import invoke
from tests.helpers.variants import conformance

LOAD, SIDE = 5.0, 1.0  # kg and side of shoulder_pan, as the task states them
GRID = ["--grid", "3x2", "--min", "0.5 m, 0.1 m, 0.1 m", "--max", "0.8 m, 0.3 m, 0.1 m"]
SURE = 3.5  # σ: exceeded by one of a hundred sets of a dozen numbers


def run(*words: object) -> dict[str, Any]:
    result = invoke(*words, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def extended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("extended") / "out"
    data = problems_folder() / "ur10_measured.csv"
    run("diagnose", data, "--problem", "insert_ur10_measured", "--no-plan", "--no-plots", "--out", out)
    return out / "extended.yaml"


def landed(target: dict[str, Any]) -> np.ndarray:
    """(3,) where the true arm comes to lie in the posture of a target, off that target [m]."""
    q = np.array(list(target["posture"].values()))
    return arm.reached(q, LOAD, SIDE) - target["position"]


@pytest.mark.conformance
def test_the_true_arm_hits_every_target_of_the_map(extended: Path) -> None:
    found = run("map", "--problem", extended, *GRID)
    assert len(found["targets"]) == 6
    for target in found["targets"]:
        across = landed(target)[:2]
        assert np.linalg.norm(across) < SURE * target["sigma_max"] < 0.06e-3


@pytest.mark.conformance
def test_the_map_of_accuracy_tells_where_the_arm_lands_without_its_effects(extended: Path) -> None:
    found = run("map", "--problem", extended, "--quantity", "accuracy", *GRID)
    assert found["effects"] == 2
    for target in found["targets"]:
        off = landed(target)
        assert np.linalg.norm(off - target["bias"]) < SURE / 2 * target["radius95"]
        assert np.linalg.norm(off) > 0.3e-3  # so that there is something to tell


@pytest.mark.parametrize("purpose", conformance(["parameters", "task"], ["task"]))
@pytest.mark.conformance
def test_the_next_measurements_are_planned_with_the_extended_arm(purpose: str, extended: Path) -> None:
    found = run("plan-measurements", "--problem", extended, "--count", 12, "--for", purpose)
    assert len(found["postures"]) == 12
    std = found["task"]["std"]
    assert 0 < std["after"] < std["before"] < 0.05e-3
    assert std["after"] < std["random"]
