"""Poses of a board that a camera on the tool reports, beside other instruments, of a simulator of its own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posture_opt as po
from tests.helpers.cameras import TOOL_SCENE, board_table
from tests.helpers.instruments import (
    TrueArm,
    level_table,
    misplaced,
    mixed_table,
    plane_table,
    postures,
)
from tests.helpers.pairs import ur10_problem

SIGMAS = 5e-5, 1e-4  # of a coordinate [m] and of a turn [rad], in the camera


def problem(*, orientation: bool = True) -> po.Problem:
    stated = {"plane": "0.02 mm", "position": "0.05 mm", **({"orientation": "0.1 mrad"} if orientation else {})}
    return ur10_problem(stated, data={"frame": "camera"})


def table(arm: TrueArm, rng: np.random.Generator, n: int) -> dict[str, list[object]]:
    """n poses of the board, and as many touches of each of three plates."""
    own = {"probe": plane_table(arm, rng, n, 2e-5, 0.0), "eye": board_table(arm, rng, n, SIGMAS)}
    sided = arm.backlash[1] > 0
    return mixed_table({k: {c: v for c, v in t.items() if sided or "approach" not in c} for k, t in own.items()})


def calibrated(seed: int, n: int) -> tuple[po.Calibration, TrueArm]:
    rng = np.random.default_rng(seed)
    arm = TrueArm.drawn(rng)
    given = problem()
    data = po.read_measurements(table(arm, rng, n), given)
    return po.calibrate(given, data, plan=False), arm


@pytest.mark.long
def test_a_camera_and_another_instrument_teach_one_arm() -> None:
    found, arm = calibrated(81, 16)
    assert 0.7 < found.variance < 1.4
    values = {p.name: p.nominal + v for p, v in zip(found.parameters, found.x, strict=True)}
    q = postures(np.random.default_rng(99), 60)
    assert misplaced(values, q, arm.point(q)) < 8e-5
    document = found.to_json()["instruments"]["eye"]
    assert (document["kind"], document["rows"], document["sigma"]) == ("pose", 16, 5e-5)
    assert document["scatter"] == pytest.approx(SIGMAS[0], rel=0.4)
    assert document["orientation"]["scatter"] == pytest.approx(SIGMAS[1], rel=0.4)
    frames = document["unknowns"]["eye"]
    # The camera is where it is on the tool, less what the ends of the arm and the tool hide.
    assert np.allclose([frames["camera"][a] for a in "xyz"], TOOL_SCENE.camera.pose[:3, 3], atol=3e-3)
    turns = [frames["camera"][a] for a in ("roll", "pitch", "yaw")]
    assert np.allclose(Rotation.from_euler("xyz", turns).as_matrix(), TOOL_SCENE.camera.pose[:3, :3], atol=3e-3)
    assert np.allclose([frames["board"][a] for a in "xyz"], TOOL_SCENE.board[:3, 3], atol=3e-3)
    # What nothing tells from where camera and board are is named.
    report = " ".join(found.report().split())
    assert "eye.board.z" in report.split("What the data do not determine")[1]
    assert "eye: camera" in report


@pytest.mark.long
def test_a_slip_of_a_zero_is_named_and_nothing_else_is_left() -> None:
    """The places hide most of it: only where they are found again do the errors go."""
    rng = np.random.default_rng(86)
    slipped = TrueArm()
    slipped.errors[2, 0] = 1e-3
    found = po.recheck(problem(), po.read_measurements(table(slipped, rng, 5), problem()))
    assert (found.verdict, found.changes[0].kind, found.changes[0].target) == ("changed", "joint_offset", "elbow")
    assert found.changes[0].values["theta"][0] == pytest.approx(1e-3, abs=1e-4)
    left, before = (np.sqrt(np.mean(errors**2)) for errors in (found.errors_after, found.errors_before))
    assert left < 0.4 * before


def test_rows_come_back_and_what_is_missing_is_said() -> None:
    rng = np.random.default_rng(87)
    tables = {"tilt": level_table(TrueArm(), rng, 4, 1e-5), "eye": board_table(TrueArm(), rng, 4, SIGMAS)}
    rows = mixed_table(tables)
    data = po.read_measurements(rows, problem())
    assert len(data) == 2 * 4 + 6 * 4
    assert data.kind.place_noun == "boards"
    again = po.read_measurements(data.to_dataframe(), problem())
    assert np.allclose(again.reading, data.reading, atol=1e-12)
    assert np.array_equal(again.part, data.part)
    with pytest.raises(po.errors.InputError, match="no σ of the orientation of a board is stated"):
        po.read_measurements(rows, problem(orientation=False))
    bare = {name: column for name, column in rows.items() if not name.startswith("r")}
    with pytest.raises(po.errors.InputError, match="poses of a board have x, y, z and an orientation"):
        po.read_measurements(bare, problem())
    flat = {name: column for name, column in rows.items() if name != "z [m]"}
    with pytest.raises(po.errors.InputError, match="beside the columns of positions"):
        po.read_measurements(flat, problem())
    few = {name: column[:6] for name, column in rows.items()}
    with pytest.raises(po.errors.InputError, match="2 poses of a board do not say where camera and board are"):
        po.read_measurements(few, problem())
