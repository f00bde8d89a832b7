"""The measurement that tells two causes apart: what it promises, and what it brings when it is made."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.command_line import invoke
from tests.helpers.planar_2r import position

DISCRIMINATED_LAMBDA = (3.5 + 1.2816) ** 2  # nine chances in ten to exceed 3.5 standard errors
NOISE, SCALE = 2e-5, 4e-4  # m of each coordinate; rad per rad of joint1
PROBLEM = """
name: Planar arm on part of its range
robot:
  kind: dh
  joints:
    - {name: joint1, type: revolute, a: 1 m, limits: [-180 deg, 180 deg]}
    - {name: joint2, type: revolute, a: 1 m, limits: [-180 deg, 180 deg]}
uncertainty: {measurement: {position: 0.02 mm}}
"""


def truth(q: np.ndarray) -> np.ndarray:
    """Where an arm comes to lie whose first joint turns too far in proportion."""
    return position(q * np.array([1 + SCALE, 1.0]), (1.0002, 0.9999))


def write(file: Path, rows: np.ndarray) -> None:
    np.savetxt(
        file, rows, fmt="%.6f", delimiter=",", header="joint1 [deg],joint2 [deg],x [mm],y [mm]", comments=""
    )  # fmt: skip


def diagnosed(folder: Path, rows: np.ndarray) -> tuple[dict[str, Any], str, Path]:
    """The document, the report and the folder of the output."""
    folder.mkdir(exist_ok=True)
    write(folder / "data.csv", rows)
    (folder / "problem.yaml").write_text(PROBLEM, encoding="utf-8")
    words = [folder / "data.csv", "--problem", folder / "problem.yaml", "--out", folder / "out", "--no-plots", "--full"]
    result = invoke("diagnose", *words)
    assert result.exit_code == 0, result.stderr
    return json.loads((folder / "out" / "diagnosis.json").read_text()), result.stdout, folder / "out"


def measured(q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rows of joints [deg] and points [mm], the joints as the file has them."""
    q = np.radians(np.round(np.degrees(q), 6))
    return np.column_stack([np.degrees(q), 1e3 * (truth(q) + rng.normal(0, NOISE, q.shape))])


@pytest.fixture(scope="module")
def narrow(tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, dict[str, Any], str, Path]:
    rng = np.random.default_rng(4)
    q = np.column_stack([rng.uniform(0.2, 0.8, 100), rng.uniform(-2.0, 2.0, 100)])
    rows = measured(q, rng)
    return rows, *diagnosed(tmp_path_factory.mktemp("narrow"), rows)


@pytest.mark.long
def test_the_plan_that_is_measured_leaves_one_cause(narrow: Any, tmp_path: Path) -> None:
    rows, document, _, out = narrow
    first = document["effects"][0]
    assert (first["kind"], first["target"]) == ("joint_scale", "joint1")
    assert {"kind": "gear_eccentricity", "target": "joint1"} in first["confounded_with"]
    with (out / "split_measurements.csv").open(newline="", encoding="utf-8") as file:
        table = list(csv.DictReader(file, skipinitialspace=True))
    assert len(table) == first["split"]["count"]
    assert {row["x [mm]"].strip() for row in table} == {""}
    q = np.radians([[float(row["joint1 [deg]"]), float(row["joint2 [deg]"])] for row in table])
    stated = np.array([list(one["posture"].values()) for one in first["split"]["postures"]])
    assert q == pytest.approx(stated, abs=1e-4)  # to 0.01 deg
    rng = np.random.default_rng(5)
    slip = rows[:1] + np.array([1.0, 0.0, 3.0, 0.0])  # a wrong reading, by 3 mm
    again, text, _ = diagnosed(tmp_path / "planned", np.concatenate([rows, slip, measured(q, rng)]))
    assert [(e["kind"], e["confounded_with"]) for e in again["effects"] if e["kind"] == "joint_scale"] == [
        ("joint_scale", [])
    ]
    assert "split" not in again["effects"][0]
    assert "Measurements that discriminate between causes" not in text
    assert not (tmp_path / "planned" / "out" / "split_measurements.csv").exists()
    # The far rows are all used, though a calibration that knows of no scale takes them for gross errors, as it
    # does the one that is.
    assert re.search(r"Outliers: line 102\b(?!,)", text)
    problem = po.load_problem(tmp_path / "planned" / "problem.yaml")
    alone = po.calibrate(problem, po.read_measurements(tmp_path / "planned" / "data.csv", problem))
    assert {100} < set(alone.outliers)
    assert again["effects"][0]["estimate"]["scale"]["value"] == pytest.approx(SCALE, rel=0.05)
    more = np.column_stack([rng.uniform(0.2, 0.8, len(q)), rng.uniform(-2.0, 2.0, len(q))])
    same, _, _ = diagnosed(tmp_path / "same", np.concatenate([rows, measured(more, rng)]))
    assert same["effects"][0]["confounded_with"]


def columns(q: np.ndarray, step: float = 1e-6) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Geometry (m, 4), a scale of joint1 (m, 1) and its eccentricity (m, 2), whitened, by differences."""

    def moved(dq: np.ndarray, a: tuple[float, float] = (1.0, 1.0)) -> np.ndarray:
        return ((position(q + dq, a) - position(q)) / step / NOISE).ravel()

    one, two = np.eye(2)
    turns = [moved(step * np.outer(f, one)) for f in (np.ones(len(q)), q[:, 0], np.sin(q[:, 0]), np.cos(q[:, 0]))]
    lengths = [moved(0 * q, (1.0 + step, 1.0)), moved(0 * q, (1.0, 1.0 + step))]
    geometry = np.column_stack([turns[0], moved(step * np.outer(np.ones(len(q)), two)), *lengths])
    return geometry, turns[1][:, None], np.column_stack(turns[2:])


def rest(columns: np.ndarray, x: np.ndarray) -> np.ndarray:
    return x - columns @ np.linalg.lstsq(columns, x, rcond=1e-12)[0]


def test_angle_and_strength_are_those_of_the_arm_by_hand(narrow: Any) -> None:
    rows, document, _, _ = narrow
    q = np.radians(rows[:, :2])
    G, scale, eccentricity = columns(q)
    A, B = np.linalg.qr(rest(G, scale))[0], np.linalg.qr(rest(G, eccentricity))[0]
    split = document["effects"][0]["split"]
    rival = next(r for r in split["rivals"] if r["kind"] == "gear_eccentricity")
    # At the nominal arm, and not at the fitted one, which is 0.2 mm beside it.
    assert rival["angle"] == pytest.approx(np.arccos(np.linalg.norm(A.T @ B, 2)), rel=0.01)
    size = document["effects"][0]["estimate"]["scale"]["value"]
    whole = rest(np.hstack([G, eccentricity]), scale[:, 0] * size)
    # By the residual variance of 100 rows, which errs by 7 %; the other side may be the weaker one.
    assert rival["lambda_now"] <= 1.25 * float(whole @ whole)
    assert rival["lambda_now"] < 6
    planned = np.array([list(one["posture"].values()) for one in split["postures"]])
    G, scale, eccentricity = columns(np.concatenate([q, planned]))
    whole = rest(np.hstack([G, eccentricity]), scale[:, 0] * size)
    assert DISCRIMINATED_LAMBDA < rival["lambda"] <= 1.25 * float(whole @ whole)
