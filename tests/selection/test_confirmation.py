"""IPOPT at the answer of the search: both end at one standard deviation; where they do not, the better one counts."""

from __future__ import annotations

from typing import Any

import pytest

import posture_opt as po
from posture_opt.selection.answer import selector
from posture_opt.selection.answer.solution_statements import confirmed as statements_of
from posture_opt.selection.search.engine import Confirmation
from posture_opt.selection.search.search_outcome import confirmed
from tests.helpers.said import said
from tests.helpers.shipped import preset_robot
from tests.helpers.variants import conformance

TARGETS = {
    "planar_2r": ["0.9 m", "0.7 m", "0 m"], "scara": ["0.3 m", "0.15 m", "0.0 m"],
    "irb120": ["0.35 m", "0.1 m", "0.2 m"], "ur5e": ["0.4 m", "-0.25 m", "0.2 m"],
    "panda": ["0.5 m", "0.1 m", "0.2 m"],
}  # fmt: skip
TASKS: dict[str, dict[str, Any]] = {
    "insert": {"kind": "insert"},
    "tilt": {"kind": "insert", "tilt": "8 deg", "subject_to": [{"kind": "limit_margin", "at_least": "5 deg"}]},
    "miss": {"kind": "insert", "clearance": "0.5 mm", "criterion": "miss", "tilt": "3 deg"},
    "hold": {"kind": "hold", "criterion": "trace"},
    "probe": {"kind": "probe"},
}
ALWAYS = [("scara", "hold"), ("irb120", "tilt")]
EVERY = [*ALWAYS, ("planar_2r", "insert"), ("panda", "miss"), ("ur5e", "probe"), ("panda", "hold"), ("ur5e", "miss")]


def problem_of(arm: str, task: str, **more: Any) -> po.Problem:
    planar = arm == "planar_2r"
    stated = {"direction": [0, -1, 0] if planar else [0, 0, -1], "position": TARGETS[arm], **TASKS[task], **more}
    sigma = {f"{joint}.theta": f"{0.1 + 0.05 * k} mrad" for k, joint in enumerate(preset_robot(arm).joint_names)}
    return po.problem_from_dict(
        {
            "robot": {"kind": "preset", "name": arm},
            "uncertainty": {"sigma": sigma},
            "task": {key: value for key, value in stated.items() if value is not None},
        }
    )


def test_where_both_differ_the_better_posture_is_taken() -> None:
    """IPOPT is given a posture that is no optimum, as a search that stalled would: it goes on from there."""
    solution = po.PostureSelector(problem_of("irb120", "tilt"), compiled=False).solve(starts=16)
    engine, target, scene = solution.engine, solution.target, solution.problem.scene
    assert engine is not None
    given = max(engine.candidates(solution.feasible, target), key=lambda one: one.sigma)
    assert given.sigma > solution.sigma_max * (1 + 1e-3)
    (best, *others), result = confirmed(engine, [given], target, scene)
    assert result is not None
    assert (result.taken, result.differs, best.optimal) == (True, True, True)
    assert result.agrees == pytest.approx(1 - best.sigma / given.sigma, rel=1e-6)
    assert given.sigma > best.sigma >= solution.sigma_max * (1 - 1e-6)
    assert [one.q for one in others] == [given.q]
    (told,) = statements_of(result)
    assert (told.id, told.values["difference"].value) == ("selection.confirmation-better", result.agrees)  # type: ignore[union-attr]


@pytest.mark.parametrize(("arm", "task"), conformance(EVERY, ALWAYS))
def test_ipopt_ends_at_the_standard_deviation_of_the_search(arm: str, task: str) -> None:
    found = po.select_posture(problem_of(arm, task))
    told = found.to_json()["solver"]
    assert told["name"] == "ipopt"
    assert told["agrees"] <= 1e-6
    assert told["kkt"] <= 1e-7
    assert found.status == "optimal"


def test_ipopt_finds_the_motion_along_a_path() -> None:
    """Three joints of a plane leave one way free at each point."""
    joints = [
        {"name": f"joint{k}", "type": "revolute", "a": f"{a} m", "alpha": "0 deg", "d": "0 m", "theta": "0 deg",
         "limits": ["-170 deg", "170 deg"]}
        for k, a in enumerate((0.6, 0.5, 0.3), start=1)
    ]  # fmt: skip
    points = [["0.7 m", f"{0.1 * k} m", "0 m"] for k in range(4)]
    found = po.select_posture(
        po.problem_from_dict(
            {
                "robot": {"kind": "dh", "joints": joints},
                "uncertainty": {"sigma": {f"joint{k}.theta": f"{k} mrad" for k in (1, 2, 3)}},
                "task": {"kind": "trace", "points": points},
            }
        )
    )
    told = found.to_json()["solver"]
    assert told["name"] == "ipopt"
    assert told["iterations"] > 0
    assert told["agrees"] <= 1e-6
    assert told["kkt"] <= 1e-6
    assert "selection.confirmed" in said(found)


def test_a_solver_that_goes_elsewhere_leaves_no_optimum(monkeypatch: pytest.MonkeyPatch) -> None:
    """IPOPT is made to end at a worse posture: what the search found is the answer, and not called an optimum."""

    def elsewhere(engine: Any, best_first: Any, target: Any, scene: Any) -> Any:
        return list(best_first), Confirmation("ipopt", 1, 1e-9, 0.01)

    monkeypatch.setattr(selector, "confirmed", elsewhere)
    assert po.select_posture(problem_of("planar_2r", "insert")).status == "feasible"
    monkeypatch.undo()
    assert po.select_posture(problem_of("planar_2r", "insert")).status == "optimal"
