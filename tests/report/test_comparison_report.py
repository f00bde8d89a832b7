"""The report on a comparison of models: a column a model, none twice, and the reasons where there is no posture."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from posture_opt.report.parts.model_tables import comparison_blocks, comparison_table, distinct_columns
from posture_opt.report.text.blocks import Table
from posture_opt.selection.comparison.comparison import ComparedAnswer, Comparison, plan_statements
from posture_opt.selection.comparison.predicted_error import JudgedAnswer, PostureDistance, PredictedError
from posture_opt.statements import Quantity, Statement
from posture_opt.uncertainty.spread.spread_parts import SpreadParts

ONE_JOINT: Any = SimpleNamespace(
    name="one joint",
    robot=SimpleNamespace(n=1, shape_notes=(), joints=(SimpleNamespace(name="joint1", type="revolute"),)),
    arm=SimpleNamespace(effects=(), inputs=None),
    narrowed=False,
    within_measured=True,
    scene=SimpleNamespace(active=False, switched_off=False, statements=lambda Q: ()),
)


def planned(degrees: float, sigma: float, error: float, p_success: float | None = None) -> ComparedAnswer:
    """The posture of an arm of one joint."""
    solution: Any = SimpleNamespace(q=np.radians([degrees]), critical=SimpleNamespace(sigma_max=sigma, within="across"))
    solution.postures, solution.engine = np.radians([[degrees]]), None
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
        ("success probability", "25 %", "> 99.9 %"),
    )


def test_a_model_that_repeats_another_has_no_column() -> None:
    again = compared({"nominal": BEFORE, "calibrated": CALIBRATED, "extended": CALIBRATED})
    assert list(distinct_columns(again)) == ["nominal", "calibrated"]
    other = compared({"nominal": BEFORE, "calibrated": CALIBRATED, "extended": planned(12.01, 1e-4, 2e-4)})
    assert list(distinct_columns(other)) == ["nominal", "calibrated", "extended"]
    (block,) = comparison_blocks(other, {"nominal": "a", "calibrated": "b", "extended": "c"})
    table: Any = block.items[-1]
    assert table.headers[1:] == ("a", "b", "c")


def said(found: Comparison) -> dict[str, Statement]:
    """The statements by their ids."""
    return {one.id.partition(".")[2]: one for one in plan_statements(found)}


def millimetres(one: Statement) -> dict[str, float]:
    """The lengths of a statement."""
    return {name: 1e3 * value.value for name, value in one.values.items() if isinstance(value, Quantity)}


def test_both_errors_are_stated() -> None:
    found = said(compared({"nominal": BEFORE, "calibrated": CALIBRATED}))
    assert [*found] == ["plan-error", "plan-posture"]
    assert millimetres(found["plan-error"]) == pytest.approx({"before": 2.0, "now": 0.2})
    assert found["plan-posture"].text == "joint1 12.00 deg."


def test_a_gain_in_the_same_posture_is_that_of_the_commands() -> None:
    turned = planned(361.0, 1e-4, 2e-4)
    assert "plan-error-corrected" in said(compared({"nominal": BEFORE, "calibrated": turned}))
    biased = planned(1.0, 1e-3, 2e-3)
    (predicted,) = biased.judged["calibrated"].predicted_errors
    missed = replace(predicted, miss=np.array([1.5e-3, 0, 0]), across=np.array([1.5e-3]))
    biased = replace(biased, judged={"calibrated": JudgedAnswer((missed,))})
    found = said(compared({"nominal": biased, "calibrated": CALIBRATED}))
    assert millimetres(found["plan-mean-error"]) == pytest.approx({"mean": 1.5})


def with_parts(scatter: float, systematic: float, distance: PostureDistance | None = None) -> ComparedAnswer:
    """The calibrated arm's posture with what is known of its spread [m]."""
    parts = SpreadParts(scatter / 2, scatter, systematic / 2, systematic, ("joint1.a",))
    plan = planned(12.0, 1e-3, 1.9e-3)
    predicted = replace(plan.judged["calibrated"].worst, parts=parts, from_measured=distance)
    return replace(plan, judged={"calibrated": JudgedAnswer((predicted,))})


def test_scatter_and_what_the_data_leave_open_are_kept_apart() -> None:
    parts = said(compared({"nominal": BEFORE, "calibrated": with_parts(1.5e-3, 1e-3)}))["plan-error-parts"]
    assert millimetres(parts) == pytest.approx({"scatter": 1.5, "systematic": 1.0})
    far = PostureDistance(0.7, "joint1", 0.5)
    found = said(compared({"nominal": BEFORE, "calibrated": with_parts(0.1e-3, 1.8e-3, far)}))
    danger = found["plan-outside-measured-range"]
    assert (danger.severity, danger.about, danger.values["beyond"].value) == ("danger", "joint1", 0.5)  # type: ignore[union-attr]
    assert found["plan-mostly-systematic"].values["sources"] == ("joint1.a",)
    assert "--problem calibrated.yaml --for task" in found["measure-for-task"].text
    near = PostureDistance(0.2, "", 0.0)
    found = said(compared({"nominal": BEFORE, "calibrated": with_parts(0.1e-3, 1.8e-3, near)}))
    assert found["plan-inside-measured-range"].values["nearest"].value == 0.2  # type: ignore[union-attr]
    assert found["plan-mostly-systematic"].severity == "caution"


def test_a_task_that_no_measured_range_reaches_is_said_to_be_one() -> None:
    far = with_parts(0.1e-3, 1.8e-3, PostureDistance(0.7, "joint1", 0.5))
    solution: Any = far.answer
    solution.problem = SimpleNamespace(**(vars(ONE_JOINT) | {"within_measured": False}))
    narrowed: Any = SimpleNamespace(**(vars(ONE_JOINT) | {"narrowed": True}))
    assert "plan-needs-unmeasured-range" in said(
        compared({"nominal": BEFORE, "calibrated": replace(far, problem=narrowed)})
    )


def test_scatter_that_no_file_states_is_not_said_to_be_small() -> None:
    unstated = "plan-scatter-unstated"
    assert unstated in said(compared({"nominal": BEFORE, "calibrated": with_parts(0.0, 1.8e-3)}))
    assert unstated in said(compared({"nominal": BEFORE, "calibrated": without_scatter(1.0e-3)}))
    assert unstated not in said(compared({"nominal": BEFORE, "calibrated": with_parts(1e-7, 1.8e-3)}))


def without_scatter(systematic: float) -> ComparedAnswer:
    """A plan that misses by little of what it missed before."""
    plan = with_parts(0.0, systematic)
    predicted = replace(plan.judged["calibrated"].worst, critical_error=systematic)
    return replace(plan, judged={"calibrated": JudgedAnswer((predicted,))})


def test_the_block_has_both_parts_of_the_error() -> None:
    found = compared({"nominal": BEFORE, "calibrated": with_parts(1.5e-3, 1e-3, PostureDistance(0.2, "", 0.0))})
    (block,) = comparison_blocks(found)
    (table,) = block.items
    assert isinstance(table, Table)
    assert ("scatter alone", "", "1.50 mm") in table.rows
    assert ("systematic (constant) part", "", "1.00 mm") in table.rows


def test_a_model_without_a_posture_says_why() -> None:
    reason = ComparedAnswer(ONE_JOINT, reasons=("the target is out of reach",))
    none = compared({"nominal": ComparedAnswer(ONE_JOINT), "calibrated": reason})
    half = compared({"nominal": reason, "calibrated": CALIBRATED})
    assert comparison_blocks(none) == ()
    for found, model in ((none, "calibrated"), (half, "nominal")):
        impossible = said(found)["plan-impossible"]
        assert (impossible.about, impossible.values["reason"]) == (model, "the target is out of reach")
    assert comparison_blocks(None) == plan_statements(None) == ()
