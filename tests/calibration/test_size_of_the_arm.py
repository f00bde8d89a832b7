"""Touches show no length: what only moves the places or the tool must not pass for growth of the arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import posture_opt as po
from tests.helpers.real_arms import DATA, long_on_real_arms

PROBLEMS = Path(__file__).parents[2] / "problems"


@long_on_real_arms
def test_no_length_of_a_real_arm_is_off_by_more_than_a_decimetre() -> None:
    folder = DATA / "mukca_sockets"
    problem = po.load_problem(folder / "problem_panda.yaml")
    found = po.diagnose(problem, po.read_measurements(folder / "panda_3.csv", problem))
    geometry = [finding for finding in found.effects if finding.effect is None and finding.noise is None]
    sizes = [value for finding in geometry for value, _, unit in finding.estimate.values() if unit == "m"]
    assert geometry
    assert all(abs(size) < 0.1 for size in sizes)


def planar_touches(rng: np.random.Generator, stated: float) -> po.Calibration:
    """An arm of two links of 1 m touches three points twelve times each; one of their distances is stated wrongly."""
    places = {"a": (1.2, 0.3), "b": (0.4, 1.1), "c": (-0.9, 0.7)}
    rows: dict[str, list[float | str]] = {"point": [], "joint1 [rad]": [], "joint2 [rad]": []}
    for name, place in places.items():
        for k in range(12):
            x, y = np.array(place) + rng.normal(0, 5e-5, 2)
            bend = (-1) ** k * np.arccos((x * x + y * y - 2) / 2)
            rows["point"].append(name)
            rows["joint1 [rad]"].append(np.arctan2(y, x) - bend / 2)
            rows["joint2 [rad]"].append(bend)
    ab, bc = (float(np.linalg.norm(np.subtract(places[i], places[j]))) for i, j in (("a", "b"), ("b", "c")))
    problem = po.problem_from_dict({
        "robot": {"kind": "dh", "joints": [{"name": f"joint{i}", "a": "1 m"} for i in (1, 2)]},
        "uncertainty": {"measurement": {"position": "0.05 mm"}},
        "data": {"distances": [["a", "b", f"{ab + stated} m"], ["b", "c", f"{bc} m"]]},
    })  # fmt: skip
    return po.calibrate(problem, po.read_measurements(rows, problem))


def test_a_distance_that_is_stated_wrongly_is_doubted() -> None:
    wrong = planar_touches(np.random.default_rng(4), 2e-3)
    assert "The distance of a and b, stated as 1133.37 mm, comes out" in wrong.report()
    assert "The distance of" not in planar_touches(np.random.default_rng(4), 0.0).report()


def test_what_a_tolerance_holds_is_not_determined_by_the_rows() -> None:
    held = planar_touches(np.random.default_rng(4), 0.0).fit.held_by_prior
    assert np.all(held >= 1 - 1e-9)
    problem = po.load_problem(PROBLEMS / "kuka_iiwa14_sockets.yaml")
    fit = po.calibrate(problem, po.read_measurements(PROBLEMS / "kuka_iiwa14_sockets.csv", problem)).fit
    ratio = dict(zip([p.name for p in fit.residuals.parameters], fit.held_by_prior, strict=True))
    assert ratio["joint_a1.d"] == np.inf  # the height of the column
    assert ratio["joint_a4.alpha"] < 3
