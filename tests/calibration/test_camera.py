"""Arms with known errors, seen by cameras of a simulator of its own, and calibrated."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.cameras import TOOL_SCENE, Scene, camera_problem, camera_table, grid
from tests.helpers.hand_eye import errors_of
from tests.helpers.instruments import JOINTS, UR10, TrueArm, deviations

SMALL = grid(3, 4, 0.05)
BOARD = {"rows": 3, "columns": 4, "square": "50 mm"}
SCENES = {"cell": replace(Scene(), corners=SMALL), "tool": replace(TOOL_SCENE, corners=SMALL)}


@cache
def simulated(where: str, backlash: float = 0.0, n: int = 30) -> tuple[TrueArm, Mapping[str, object]]:
    """An arm and pictures of it with a noise of 0.2 px, always the same ones."""
    rng = np.random.default_rng(5)
    arm = TrueArm.drawn(rng, backlash=(2, backlash))
    return arm, camera_table(arm, rng, n, 0.2, SCENES[where])


def problem(where: str, folder: Path, known: bool = True, **camera: object) -> po.Problem:
    text = camera_problem(folder, SCENES[where], known=known, **camera)
    if known:
        text["data"]["markers"]["board"]["chessboard"] = BOARD  # type: ignore[index]
    return po.problem_from_dict(text, folder)


def calibrated(where: str, folder: Path, known: bool = True, **camera: object) -> po.Calibration:
    given = problem(where, folder, known, **camera)
    return po.calibrate(given, po.read_measurements(dict(simulated(where)[1]), given), plan=False)


@pytest.mark.parametrize("where", ["cell", pytest.param("tool", marks=pytest.mark.long)])
def test_pictures_find_the_arm_the_camera_and_the_board(where: str, tmp_path: Path) -> None:
    found, scene = calibrated(where, tmp_path), SCENES[where]
    z = deviations(found, simulated(where)[0])
    assert len(z) > 8
    assert 0.15 < np.sqrt(np.mean(z**2)) < 1.6
    document = json.loads(json.dumps(found.to_json()["instruments"]))["camera"]
    assert (document["kind"], document["rows"], document["unit"], document["sigma"]) == ("camera", 360, "px", 0.2)
    assert document["rms"] == pytest.approx(0.2 * np.sqrt(2), rel=0.15)  # of both coordinates together
    at = [document["unknowns"]["left"][axis] for axis in "xyz"]
    assert np.allclose(at, scene.camera.pose[:3, 3], atol=3e-3)
    assert found.calibrated.rms < 0.25 * found.nominal.rms
    text = found.report()
    assert "RMS image error at the marker" in text
    assert "0.20 px, 0.1" in text


@pytest.mark.long
def test_markers_at_unknown_places_leave_the_size_of_the_arm_open(tmp_path: Path) -> None:
    found = calibrated("cell", tmp_path, known=False)
    assert not found.fixed[[p.name for p in found.parameters].index("shoulder_lift.a")]
    report = " ".join(found.report().split())
    assert "Pictures of markers alone do not determine the size of the arm" in report
    assert "add one known length: markers on a board of known size" in report


@pytest.mark.long
def test_a_wrong_focal_length_is_found_where_it_is_free(tmp_path: Path) -> None:
    scene = SCENES["cell"]
    wrong = replace(scene, camera=replace(scene.camera, focal=(1275.0, 1270.0)))  # 2 % too long
    results = {}
    cases: dict[str, dict[str, object]] = {
        "held": {}, "free": {"free": ["focal_length"]}, "rough": {"sigma": {"focal_length": "30 px"}}
    }  # fmt: skip
    for name, camera in cases.items():
        text = camera_problem(tmp_path, wrong, **camera)
        text["data"]["markers"]["board"]["chessboard"] = BOARD  # type: ignore[index]
        given = po.problem_from_dict(text, tmp_path)
        found = po.calibrate(given, po.read_measurements(dict(simulated("cell")[1]), given), plan=False)
        results[name] = found.to_json()["instruments"]["camera"]
    for name in ("free", "rough"):
        assert results[name]["unknowns"]["left"]["focal_length"] == pytest.approx(scene.camera.focal, abs=3.0)
        assert results[name]["rms"] < 0.32 < 1.2 * results[name]["rms"] < results["held"]["rms"]


@pytest.mark.long
def test_pictures_from_one_distance_trade_the_focal_length(tmp_path: Path) -> None:
    words = "pictures from one distance trade it for the distance"
    for depths, tilt, said in (((1.0, 1.0), 0.02, True), ((0.75, 1.25), 0.7, False)):
        scene = replace(SCENES["cell"], depths=depths, tilt=tilt)
        arm = simulated("cell")[0]
        given = problem("cell", tmp_path, free=["focal_length"])
        data = po.read_measurements(camera_table(arm, np.random.default_rng(1), 30, 0.2, scene), given)
        report = " ".join(po.calibrate(given, data, plan=False).report().split())
        assert (words in report) is said
        assert ("add one known length" in report) is said


@pytest.mark.long
def test_wrong_detections_and_a_board_seen_from_its_other_end_are_left_out(tmp_path: Path) -> None:
    given, table = problem("tool", tmp_path), dict(simulated("tool")[1])
    u, v = (np.array(table[f"{axis} [px]"]) for axis in "uv")
    u[5] += 30.0
    u[100] -= 12.0
    u[240:252], v[240:252] = u[240:252][::-1].copy(), v[240:252][::-1].copy()
    data = po.read_measurements({**table, "u [px]": u, "v [px]": v}, given)
    other = camera_table(simulated("tool")[0], np.random.default_rng(8), 8, 0.2, SCENES["tool"])
    found = po.calibrate(given, data, test=po.read_measurements(other, given), plan=False)
    assert np.array_equal(np.flatnonzero(~found.fit.kept), [5, 100, *range(240, 252)])
    assert np.sqrt(np.mean(deviations(found, simulated("tool")[0]) ** 2)) < 1.6
    assert found.test.models["calibrated"].rms < 0.2 * found.test.models["nominal"].rms
    assert "residual_joints" in found.figures()


@pytest.mark.long
def test_the_minimum_is_that_of_scipy(tmp_path: Path) -> None:
    """``least_squares`` on a residual of its own: matrices of the simulator, the same σ, from the truth."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    scene, (arm, table) = SCENES["cell"], simulated("cell")
    found = calibrated("cell", tmp_path)
    q = np.stack([table[f"{name} [rad]"] for name in JOINTS], axis=1)  # type: ignore[arg-type, call-overload]
    seen = np.stack([table["u [px]"], table["v [px]"]], axis=1)
    each = len(SMALL)

    def moved(T: np.ndarray, x: np.ndarray) -> np.ndarray:
        M = T.copy()
        M[:3, :3], M[:3, 3] = Rotation.from_rotvec(x[:3]).as_matrix() @ T[:3, :3], T[:3, 3] + x[3:]
        return M

    def residual(x: np.ndarray) -> np.ndarray:
        errors, beta = x[:24].reshape(6, 4), x[36:]
        pose = np.broadcast_to(np.eye(4), (len(q) // each, 4, 4))
        for i, (d, a, alpha) in enumerate(UR10):
            et, ed, ea, el = errors[i]
            theta, n = q[::each, i] + et, len(q) // each
            A = np.zeros((n, 4, 4))
            c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha + el), np.sin(alpha + el)
            A[:, 0, :3] = np.stack([c, -s * ca, s * sa], axis=1)
            A[:, 1, :3] = np.stack([s, c * ca, -c * sa], axis=1)
            A[:, 0, 3], A[:, 1, 3], A[:, 2, 3] = (a + ea) * c, (a + ea) * s, d + ed
            A[:, 2, 1], A[:, 2, 2], A[:, 3, 3] = sa, ca, 1.0
            pose = pose @ A
            if i in (1, 2):  # Hayati's second tilt of parallel axes
                B = np.eye(4)
                B[:3, :3] = Rotation.from_rotvec([0.0, beta[i - 1], 0.0]).as_matrix()
                pose = pose @ B
        board, camera = moved(scene.board, x[24:30]), replace(scene.camera, pose=moved(scene.camera.pose, x[30:36]))
        inside = SMALL @ board[:3, :3].T + board[:3, 3] + arm.tool
        points = np.einsum("nij,kj->nki", pose[:, :3, :3], inside) + pose[:, None, :3, 3]
        return ((camera.pixels(points.reshape(-1, 3)) - seen) / 0.2).ravel()

    theirs = least_squares(residual, np.zeros(38), method="trf", x_scale=1e-3, xtol=1e-12, ftol=1e-12).cost * 2
    ours = float(np.sum(found.residuals.whitened(found.x) ** 2))
    levers = found.residuals.data.lever
    assert levers is not None
    assert ours == pytest.approx(theirs, rel=2e-3)


@pytest.mark.long
@pytest.mark.parametrize("where", ["cell", "tool"])
def test_opencv_has_the_larger_error(where: str, tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    if not hasattr(cv2, "calibrateRobotWorldHandEye"):
        pytest.skip("this OpenCV has no hand-eye calibration")
    ours, held, theirs = errors_of(cv2, where, tmp_path, 4)
    assert held < 1.25 * min(theirs)  # frames alone are worth as much, whoever fits them
    assert ours < 0.5 * min(theirs)
