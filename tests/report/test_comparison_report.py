"""The report on a comparison of models: a column a model, none twice, and the reasons where there is no posture."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from posture_opt.report.parts.comparison_parts import (
    comparison_blocks,
    comparison_lead,
    comparison_table,
    distinct_columns,
)
from posture_opt.selection.comparison.comparison import ComparedAnswer, Comparison
from posture_opt.selection.comparison.predicted_error import JudgedAnswer, PostureDistance, PredictedError
from posture_opt.uncertainty.spread.spread_parts import SpreadParts

ONE_JOINT: Any = SimpleNamespace(
    name="one joint",
    robot=SimpleNamespace(n=1, joints=(SimpleNamespace(name="joint1", type="revolute"),)),
    arm=SimpleNamespace(effects=()),
    narrowed=False,
    within_measured=True,
    scene=SimpleNamespace(stands_anywhere=False, active=False, switched_off=False),
)


def planned(degrees: float, sigma: float, error: float, p_success: float | None = None) -> ComparedAnswer:
    """The posture of an arm of one joint."""
    solution: Any = SimpleNamespace(q=np.radians([degrees]), critical=SimpleNamespace(sigma_max=sigma, within="across"))
    solution.mounting_note, solution.engine = "", None
    solution.problem = ONE_JOINT
    solution.stations = (solution,)
    miss = np.array([error / 2, 0.0, 0.0])
    predicted = PredictedError(miss, miss[:1], sigma, error, p_success, np.eye(3) * sigma**2)
    judges = ("calibrated", "extended")
    return ComparedAnswer(ONE_JOINT, solution, dict.fromkeys(judges, JudgedAnswer((predicted,))))


def compared(plans: dict[str, ComparedAnswer]) -> Comparison:
    return Comparison(plans, reference=list(plans)[-1])


BEFORE, CALIBRATED = planned(1.0, 1e-3, 2e-3, 0.25), planned(12.0, 1e-4, 2e-4, 0.99999)


def test_every_model_has_a_column() -> None:
    table = comparison_table(compared({"nominal": BEFORE, "calibrated": CALIBRATED}).answered, "calibrated")
    assert table.headers == ("planned with the model", "before calibration", "calibrated")
    assert table.rows == (
        ("joint1", "1.00 deg", "12.00 deg"),
        ("largest σ, as planned", "1.00 mm", "0.100 mm"),
        ("largest σ, as judged", "1.00 mm", "0.100 mm"),
        ("mean error", "1.00 mm", "0.100 mm"),
        ("95 % error radius", "2.00 mm", "0.200 mm"),
        ("success probability", "25 %", "99.99900 %"),
    )


def test_a_model_that_repeats_another_has_no_column() -> None:
    again = compared({"nominal": BEFORE, "calibrated": CALIBRATED, "extended": CALIBRATED})
    assert list(distinct_columns(again)) == ["nominal", "calibrated"]
    other = compared({"nominal": BEFORE, "calibrated": CALIBRATED, "extended": planned(12.01, 1e-4, 2e-4)})
    assert list(distinct_columns(other)) == ["nominal", "calibrated", "extended"]
    (block,) = comparison_blocks(other, {"nominal": "a", "calibrated": "b", "extended": "c"})
    table: Any = block.items[-1]
    assert table.headers[1:] == ("a", "b", "c")


def test_the_lead_tells_both_errors_and_whether_the_gain_is_small() -> None:
    (lead,) = comparison_lead(compared({"nominal": BEFORE, "calibrated": CALIBRATED}))
    assert lead.startswith(
        "Task, as the calibrated model predicts: 95 % error radius 2.00 mm in the posture planned be"
    )
    assert "0.200 mm in the one planned with the calibrated model." in lead


def test_a_gain_in_the_same_posture_is_that_of_the_commands() -> None:
    turned = planned(361.0, 1e-4, 2e-4)
    (lead,) = comparison_lead(compared({"nominal": BEFORE, "calibrated": turned}))
    assert "The posture is the same, and the gain that of the corrected commands" in lead
    biased = planned(1.0, 1e-3, 2e-3)
    (predicted,) = biased.judged["calibrated"].predicted_errors
    missed = replace(predicted, miss=np.array([1.5e-3, 0, 0]), across=np.array([1.5e-3]))
    biased = replace(biased, judged={"calibrated": JudgedAnswer((missed,))})
    (lead,) = comparison_lead(compared({"nominal": biased, "calibrated": CALIBRATED}))
    assert "2.00 mm in the posture planned before calibration (1.50 mm mean error, gone with corrected" in lead


def with_parts(scatter: float, systematic: float, distance: PostureDistance | None = None) -> ComparedAnswer:
    """The calibrated arm's posture with what is known of its spread [m]."""
    parts = SpreadParts(scatter / 2, scatter, systematic / 2, systematic, ("joint1.a",))
    plan = planned(12.0, 1e-3, 1.9e-3)
    predicted = replace(plan.judged["calibrated"].worst, parts=parts, from_measured=distance)
    return replace(plan, judged={"calibrated": JudgedAnswer((predicted,))})


def test_the_lead_tells_scatter_from_what_the_data_leave_open() -> None:
    _, left = comparison_lead(compared({"nominal": BEFORE, "calibrated": with_parts(1.5e-3, 1e-3)}))
    assert left == "The remaining error is 1.50 mm of scatter and 1.00 mm of parameter uncertainty."
    far = PostureDistance(0.7, "joint1", 0.5)
    first, open_, last = comparison_lead(compared({"nominal": BEFORE, "calibrated": with_parts(0.1e-3, 1.8e-3, far)}))
    assert "joint1 12.00 deg" not in first
    assert last.startswith("Planned posture: joint1 12.00 deg.")  # behind what speaks against driving there
    assert open_ == (
        "Extrapolated: the planned posture lies outside the measured range, joint1 by 29 deg. 1.80 mm of the error is "
        "parameter uncertainty, mainly from joint1.a; scatter contributes 0.100 mm. "
        "'plan-measurements --problem calibrated.yaml --for task' proposes what to measure."
    )
    near = PostureDistance(0.2, "", 0.0)
    first, few = comparison_lead(compared({"nominal": BEFORE, "calibrated": with_parts(0.1e-3, 1.8e-3, near)}))
    assert few.startswith(
        "Most of the remaining error is systematic: 1.80 mm, mainly from joint1.a; scatter contributes"
    )
    assert first.endswith(
        "; that posture is within the joint ranges measured, up to 11 deg in a joint from the nearest one. "
        "Planned posture: joint1 12.00 deg."
    )


def test_a_task_that_no_measured_range_reaches_is_said_to_be_one() -> None:
    far = with_parts(0.1e-3, 1.8e-3, PostureDistance(0.7, "joint1", 0.5))
    solution: Any = far.answer
    solution.problem = SimpleNamespace(**(vars(ONE_JOINT) | {"within_measured": False}))
    narrowed: Any = SimpleNamespace(**(vars(ONE_JOINT) | {"narrowed": True}))
    _, open_, _ = comparison_lead(compared({"nominal": BEFORE, "calibrated": replace(far, problem=narrowed)}))
    assert open_.startswith(
        "Extrapolated: no posture for this task was found within the ranges in which effects were measured, and the "
        "planned one leaves them, joint1 by 29 deg. Measure there, or place the task where the arm was measured, before"
    )


def test_scatter_that_no_file_states_is_not_said_to_be_small() -> None:
    _, open_ = comparison_lead(compared({"nominal": BEFORE, "calibrated": with_parts(0.0, 1.8e-3)}))
    assert "mainly from joint1.a; the file states no scatter between repeats." in open_
    _, none = comparison_lead(compared({"nominal": BEFORE, "calibrated": without_scatter(1.0e-3)}))
    assert none.startswith("Scatter between repeats comes on top")
    _, tiny = comparison_lead(compared({"nominal": BEFORE, "calibrated": with_parts(1e-7, 1.8e-3)}))
    assert "scatter contributes less than 1 µm." in tiny


def without_scatter(systematic: float) -> ComparedAnswer:
    """A plan that misses by little of what it missed before."""
    plan = with_parts(0.0, systematic)
    predicted = replace(plan.judged["calibrated"].worst, critical_error=systematic)
    return replace(plan, judged={"calibrated": JudgedAnswer((predicted,))})


def test_the_block_says_how_far_the_posture_is_from_those_measured() -> None:
    found = compared({"nominal": BEFORE, "calibrated": with_parts(1.5e-3, 1e-3, PostureDistance(0.2, "", 0.0))})
    (block,) = comparison_blocks(found)
    words = " ".join(item for item in block.items if isinstance(item, str))
    assert (
        "The posture is within the measured range of every joint; the nearest measured one differs by up to 11" in words
    )
    assert "(parameter uncertainty and model error) is 1.00 mm, mainly from joint1.a." in words
    table: Any = block.items[-1]
    assert ("scatter alone", "", "1.50 mm") in table.rows
    assert ("systematic (constant) part", "", "1.00 mm") in table.rows


def test_a_model_without_a_posture_says_why() -> None:
    reason = ComparedAnswer(ONE_JOINT, reasons=("the target is out of reach",))
    (block,) = comparison_blocks(compared({"nominal": ComparedAnswer(ONE_JOINT), "calibrated": reason}))
    assert block.items == ("The calibrated model has no posture for this task.", "The target is out of reach.")
    lead = comparison_lead(compared({"nominal": ComparedAnswer(ONE_JOINT), "calibrated": reason}))
    assert lead == ("Task: the calibrated model has no posture for it. The target is out of reach.",)
    assert not block.figure
    (half,) = comparison_blocks(compared({"nominal": reason, "calibrated": CALIBRATED}))
    assert half.items[:2] == (
        "The model before calibration has no posture for this task.",
        "The target is out of reach.",
    )
    assert comparison_blocks(None) == comparison_lead(None) == ()
