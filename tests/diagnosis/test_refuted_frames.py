"""Frames and σ's that the file takes for known and the data refute: named, set aside, and the search goes on.

Seeds below 200, 1000 to 1160, 1500 to 1580 and 2000 to 2290 were used while the method was chosen; those here were not.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.free_arms import SIX, TOOL, problem_of, rows, simulated_points
from tests.helpers.real_arms import DATA, long_on_real_arms
from tests.helpers.variants import conformance
from tests.hidden.draw import Draw, draw
from tests.hidden.files import write


def stated_draw(seed: int, family: str, kind: str = "", weakest: float = 400.0) -> Draw:
    """The first case of a family whose frames are stated, and right."""
    return next(case for i in range(20) if not (case := draw(seed, family, i, kind=kind, weakest=weakest)).free)


def moved(case: Draw, base: Any = (0, 0, 0), tool: Any = (0, 0, 0), turn: Any = (0, 0, 0)) -> Draw:
    """The case with frames stated that far off, in mm and mrad."""
    values = [np.array([f.value for f in part]) for part in (case.nominal.base, case.nominal.tool)]
    values[0][:3] += np.array(base) * 1e-3
    values[0][3:] += np.array(turn) * 1e-3
    values[1][:3] += np.array(tool) * 1e-3
    return replace(case, nominal=case.nominal.with_frames(*values))


def loaded(case: Draw, folder: Path) -> tuple[Any, Any]:
    problem = po.load_problem(write(case, folder))
    return problem, po.read_measurements(folder / "data.csv", problem)


@pytest.mark.parametrize(
    ("seed", "family", "kind", "off"),
    conformance(
        CASES := [
            (402, "kr16", "gear_eccentricity", {"base": (-4, 2, 3), "turn": (1, 1, -1)}),
            (404, "planar", "joint_compliance", {"base": (-6, 7, 0), "turn": (2, 0, 0)}),
            (405, "scara", "gear_eccentricity", {"base": (3, -5, 1)}),
        ],
        always=CASES[2:],
    ),
)
def test_a_base_that_is_off_is_named_and_what_is_hidden_beside_it_is_found(
    seed: int, family: str, kind: str, off: Any, tmp_path: Path
) -> None:
    case = moved(stated_draw(seed, family, kind), **off)
    found = po.diagnose(*loaded(case, tmp_path), plan=False)
    effect = case.truth["effects"][0]
    named = [(f.kind, f.target) for f in found.effects]
    rivals = [(r.kind, r.target) for f in found.effects for r in f.confounded_with]
    assert (effect["kind"], effect["target"]) in named + rivals
    assert "base_frame" in [kind for kind, _ in named]
    assert not any(kind in ("slip", "drift", "tool_frame") for kind, _ in named)
    # With the geometric causes, behind all others.
    assert named.index(("base_frame", "base")) > named.index((effect["kind"], effect["target"])) or rivals
    assert "calibration.frame-contradicted" in {s["id"] for s in found.to_json()["statements"]}
    (told,) = found.calibration.contradictions
    for name, wanted in zip("xy", off["base"], strict=False):
        value, std, _ = told.estimate[name]
        assert abs(value + wanted * 1e-3) < 6 * std + 0.3e-3  # geometry of 0.4 mm beside it
    assert found.errors["extended"].rms < 1.25 * case.truth["noise_rms"]
    # The file that is written has the base where it is.
    assert not found.extended.robot.base_free
    assert (
        abs(found.extended.robot.parameters["base.x"].nominal - case.nominal.base[0].value + off["base"][0] * 1e-3)
        < 1e-3
    )


FAMILIES = ("full", "kr16", "planar", "scara", "seven", "clean", "outside", "geometry", "two")


@pytest.mark.parametrize(
    ("family", "seed"),
    conformance(product(FAMILIES, (422,)), [("scara", 422)]),
)
def test_right_frames_are_not_named_whatever_is_hidden(family: str, seed: int, tmp_path: Path) -> None:
    case = stated_draw(seed, family, weakest=100.0)
    assert not po.calibrate(*loaded(case, tmp_path)).contradictions


def test_a_sigma_that_the_data_refute_is_set_aside() -> None:
    """A zero stated to 5 µrad and 8 mrad off; the others are right."""
    rng = np.random.default_rng(431)
    base, tool, off, name = np.eye(4), TOOL, 8e-3, "j2.theta"
    sigma = {f"{joint}.theta": "5 urad" for joint, *_ in SIX}
    frames = {"base": None, "tool": {"xyz": [f"{v} m" for v in tool[:3, 3]]}}
    problem = problem_of(SIX, robot=frames, uncertainty={"measurement": {"position": "0.02 mm"}, "sigma": sigma})
    q = rng.uniform(-2.5, 2.5, (80, 6))
    points = simulated_points(SIX, q, base, tool, {name: off}) + rng.normal(0, 2e-5, (80, 3))
    found = po.calibrate(problem, rows(problem, q, points))
    ((told),) = found.contradictions
    assert (told.cause.kind, told.cause.target) == ("joint_offset", name.partition(".")[0])
    value, std, _ = told.estimate["theta"]
    assert abs(value - off) < 5 * std
    assert told.sigma == pytest.approx(5e-6)
    assert "calibration.sigma-contradicted" in {s["id"] for s in found.to_json()["statements"]}
    assert found.calibrated.rms < 2e-5 * np.sqrt(3) * 1.2
    # Without the error nothing is set aside.
    right = simulated_points(SIX, q, base, tool, {}) + rng.normal(0, 2e-5, (80, 3))
    assert not po.calibrate(problem, rows(problem, q, right)).contradictions


@long_on_real_arms
@pytest.mark.parametrize("off", [0.0, 2.0])
def test_the_base_of_a_measured_arm_is_named_where_it_is_off(off: float) -> None:
    """The frames of a UR5 as its calibration found them, and the base stated some millimetres beside that."""
    free = po.load_problem(DATA / "jacobi_ur5" / "problem.yaml")
    data = po.read_measurements(DATA / "jacobi_ur5" / "grid.csv", free)
    found = po.calibrate(free, data, plan=False)
    value = {p.name: p.nominal + x for p, x in zip(found.parameters, found.x, strict=True)}
    shift = {"x": off * 1e-3, "y": -off * 1e-3}
    base = {
        "xyz": [f"{value[f'base.{a}'] + shift.get(a, 0.0)} m" for a in "xyz"],
        "rpy": [f"{value[f'base.{a}']} rad" for a in ("roll", "pitch", "yaw")],
    }
    robot = free.to_dict()["robot"] | {"base": base, "tool": {"xyz": [f"{value[f'tool.{a}']} m" for a in "xyz"]}}
    stated = po.calibrate(free.with_robot(robot), data, plan=False)
    assert [c.cause.kind for c in stated.contradictions] == ["base_frame"] * bool(off)
    assert stated.calibrated.rms == pytest.approx(found.calibrated.rms, rel=0.01)
