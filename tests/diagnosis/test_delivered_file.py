"""``extended.yaml`` does to its own data what is said of it, whatever was found in them: against ``calibrate``."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM
from tests.helpers.real_arms import DATA, long_on_real_arms
from tests.helpers.variants import conformance
from tests.hidden.draw import draw
from tests.hidden.files import write

SEED = 61122  # never used to tune anything
NOISE = 2e-5  # m


def delivered(folder: Path, problem: Path, data: Path) -> tuple[po.Diagnosis, dict[str, float]]:
    """A diagnosis and its RMS values; what it says of its problem is what `calibrate` makes of the files of it."""
    stated = po.load_problem(problem)
    found = po.diagnose(stated, po.read_measurements(data, stated), plan=False)
    rms = found.to_json()["residual_rms"]
    for name, content in found.extended.files("extended").items():
        (folder / name).write_bytes(content)
    written = po.load_problem(folder / "extended.yaml")
    calibrated = po.calibrate(written, po.read_measurements(data, written), plan=False)
    assert rms["delivered"] == pytest.approx(calibrated.to_json()["residual_rms"]["nominal"], rel=1e-9)
    assert found.to_json()["delivered"]["outliers"] == len(calibrated.outliers)
    return found, rms


@pytest.mark.parametrize(
    ("family", "kind"),
    conformance(
        [
            ("full", "instrument_field"),
            ("scara", "slip"),
            ("seven", "slip"),
            ("outliers", ""),
        ],
        always=[("scara", "slip")],
    ),
)
def test_the_file_does_to_its_data_what_is_said(family: str, kind: str, tmp_path: Path) -> None:
    case = draw(SEED, family, 0, kind=kind, weakest=60.0)
    problem = write(case, tmp_path)
    found, rms = delivered(tmp_path, problem, tmp_path / "data.csv")
    assert rms["delivered_heldout"] <= rms["calibrated"]
    assert rms["delivered"] < 1.02 * rms["delivered_heldout"]  # learned from these rows
    left = [effect for effect in found.model.effects if not effect.for_planning]
    document = found.to_json()["delivered"]
    assert [entry["kind"] for entry in document["left_out"] if entry["reason"] == "session"] == [e.kind for e in left]
    if not document["left_out"]:
        assert rms["delivered_heldout"] == rms["extended"]
    for effect in found.extended.effects:
        assert effect.kind not in ("slip", "drift", "instrument_field")


def test_of_few_rows_the_figure_is_told_too(tmp_path: Path) -> None:
    """The file states as many parameters as there are numbers: too few to calibrate it again, enough to evaluate it."""
    problem = po.load_problem(write(draw(SEED, "scara", 0, kind="", weakest=60.0), tmp_path))
    data = po.read_measurements(tmp_path / "data.csv", problem).take(np.arange(5))
    found = po.diagnose(problem, data, plan=False)
    with pytest.raises(po.errors.InsufficientDataError):
        po.calibrate(found.extended, data, plan=False)
    assert 0 < found.to_json()["residual_rms"]["delivered"] < found.errors["calibrated"].rms


@pytest.mark.long
def test_of_several_targets_and_a_slip_between(tmp_path: Path) -> None:
    """Three targets on a planar arm whose gear is eccentric; the second joint slips half-way."""
    rng = np.random.default_rng([SEED, True])
    q, names = rng.uniform(-2.5, 2.5, (150, 2)), np.array(["t1", "t2", "t3"])[rng.integers(3, size=150)]
    offsets = {"t1": (0.0, 0.0), "t2": (0.05, 0.02), "t3": (-0.03, 0.06)}
    slipped = np.where(np.arange(150) >= 80, 4e-4, 0.0)
    turned = q + np.stack([3e-4 * np.sin(q[:, 0] + 0.4), slipped], axis=1)
    turn = turned.sum(axis=1)
    x, y = np.array([offsets[name] for name in names]).T
    points = position(turned) + np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y], 1)
    points += rng.normal(0, NOISE, points.shape)
    lines = ["target, joint1 [deg], joint2 [deg], x [mm], y [mm]"]
    for name, joints, point in zip(names, np.degrees(q), 1e3 * points, strict=True):
        lines.append(f"{name}, " + ", ".join(f"{v:.9f}" for v in (*joints, *point)))
    (tmp_path / "data.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    document = copy.deepcopy(PROBLEM)
    document["robot"] |= {"base": "free"}
    problem = po.problem_from_dict(document)
    (tmp_path / "problem.yaml").write_text(problem.to_yaml(), encoding="utf-8")
    found, rms = delivered(tmp_path, tmp_path / "problem.yaml", tmp_path / "data.csv")
    kinds = {effect.kind for effect in found.model.effects}
    assert "slip" in kinds
    assert found.delivery.model == "without_session"
    assert rms["delivered"] > 2 * rms["extended"]  # half of a slip of 0.4 mrad at some 1 m, on average over the rows
    said = {one.id: one for one in found.statements}
    assert said["diagnosis.delivered-without"].values["reason"] == "which belongs to this session"
    assert "diagnosis.delivered-average" in said


@long_on_real_arms
@pytest.mark.parametrize(
    ("folder", "data", "problem"),
    [("jacobi_wam", "grid", "problem"), ("mukca_sockets", "panda_4", "problem_panda_4")],
)
def test_of_real_arms(folder: str, data: str, problem: str, tmp_path: Path) -> None:
    """An arm that was 9.6 mm off where 1.8 mm had been said, and touched points with known distances."""
    files = DATA / folder / f"{problem}.yaml", DATA / folder / f"{data}.csv"
    _, rms = delivered(tmp_path, *files)
    assert rms["delivered"] < rms["delivered_heldout"] < rms["calibrated"]
