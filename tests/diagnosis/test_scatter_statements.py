"""What a diagnosis says of joints that scatter, of noise, and of postures to repeat."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.report.parts.diagnosis_tables import split_csv
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PLANAR, write

NOISE = 2e-5  # m, of each measured coordinate
SCATTER = 2e-4  # rad, of joint2 from repeat to repeat
PROBLEM = PLANAR + "uncertainty: {measurement: {position: 0.02 mm}}\n"


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> po.Diagnosis:
    """The diagnosis of an arm with two wrong links and a joint that scatters."""
    return diagnosed(tmp_path_factory.mktemp("noisy"), visits=4)


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> tuple[po.Diagnosis, Path]:
    """Of an arm whose postures were measured once, and the folder of its data."""
    folder = tmp_path_factory.mktemp("once")
    return diagnosed(folder, visits=1), folder


def diagnosed(folder: Path, visits: int) -> po.Diagnosis:
    """Of 120 rows, each posture measured so often."""
    rng = np.random.default_rng(3)
    q = rng.permutation(np.tile(rng.uniform(-2.5, 2.5, (120 // visits, 2)), (visits, 1)))
    moved = q + np.outer(rng.normal(0, SCATTER, len(q)), [0, 1])
    write(folder / "data.csv", q, position(moved, (1.0007, 0.9991)) + rng.normal(0, NOISE, (120, 2)))
    (folder / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    problem = po.load_problem(folder / "problem.yaml")
    data = po.read_measurements(folder / "data.csv", problem)
    return po.diagnose(problem, data)


def said(found: po.Diagnosis) -> dict[str, Any]:
    return {one.id.removeprefix("diagnosis."): one for one in found.statements}


def test_the_scatter_of_a_named_joint_is_that_of_repeats(noisy: po.Diagnosis) -> None:
    floor = noisy.noise_floor
    assert {f.kind for f in noisy.effects} == {"link_length", "joint_noise"}
    # The second joint stands 1 m from the tool point in every posture; 90 differences between repeats tell it to 7 %.
    assert floor.repeated
    assert floor.rms == pytest.approx(np.hypot(np.sqrt(2) * NOISE, SCATTER), rel=0.2)
    ids = said(noisy)
    assert ids["error-noise"].to_json()["values"]["noise"]["value"] == floor.rms
    assert "joint2 scatters from repeat to repeat by 0." in ids["causes-explain"].text
    assert "noise-reached" in ids
    assert "measurement noise" in noisy.report()


def test_without_repeats_nothing_is_called_noise_and_repeats_are_asked_for(once: tuple[po.Diagnosis, Path]) -> None:
    found, _ = once
    assert found.verdict == "unexplained"
    assert not [f for f in found.effects if f.noise is not None]
    answer = found.to_json()["unexplained"]
    assert answer["place"] == ["joint2"]
    assert answer["p_value"] < 0.001
    (asked,) = answer["repeat"]
    assert (asked["target"], asked["times"], len(asked["lines"])) == ("joint2", 5, 5)
    assert asked["lines"] == [int(line) for line in found.repeat_plans[0].rows.line]
    ids = said(found)
    assert ids["repeat-postures"].values == {"joints": ["joint2"], "postures": 5, "times": 5}
    assert ids["repeat-plan"].about == "joint2"
    assert ids["uneven"].about == "joint2"
    assert "error-instrument" in ids
    assert "measurement noise" not in found.report()


def test_what_is_to_be_repeated_is_filled_in_and_tells(once: tuple[po.Diagnosis, Path]) -> None:
    """The table of planned repeats, measured by the same arm and put below the data, has the joint named."""
    found, folder = once
    planned = split_csv(found).splitlines()
    assert len(planned) == 1 + 25
    rng = np.random.default_rng(5)
    q = np.radians([[float(cell) for cell in line.split(",")[:2]] for line in planned[1:]])
    moved = q + np.outer(rng.normal(0, SCATTER, len(q)), [0, 1])
    points = 1e3 * (position(moved, (1.0007, 0.9991)) + rng.normal(0, NOISE, (25, 2)))
    filled = [f"{line.rstrip(' ,')}, {x:.4f}, {y:.4f}" for line, (x, y) in zip(planned[1:], points, strict=True)]
    problem, (head, *rows) = found.problem, (folder / "data.csv").read_text(encoding="utf-8").splitlines()
    assert [cell.strip() for cell in head.split(",")] == [cell.strip() for cell in planned[0].split(",")]
    (folder / "more.csv").write_text("\n".join([head, *rows, *filled]) + "\n", encoding="utf-8")
    again = po.diagnose(problem, po.read_measurements(folder / "more.csv", problem))
    assert again.verdict == "effects_found"
    assert [f.target for f in again.effects if f.kind == "joint_noise"] == ["joint2"]
