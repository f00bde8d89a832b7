"""What the comparison of frozen documents lets pass, and what it does not: both directions of every kind of number."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest

from tests.golden.__main__ import FOLDER
from tests.golden.cases import WHOLE
from tests.golden.compare import differences

PLANAR = "solve-insert_planar_2r"
UR10 = "solve-insert_ur10"
TRAY = "solve-insert_scara_tray"
Place = tuple[str | int, ...]


def frozen(name: str) -> Any:
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def changed(document: Any, place: Place, value: Any) -> Any:
    """A copy with another value at a place."""
    copied = copy.deepcopy(document)
    inner = copied
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    return copied


def at(document: Any, place: Place) -> Any:
    for key in place:
        document = document[key]
    return document


def passes(document: Any, place: Place, value: Any) -> bool:
    return not list(differences(document, changed(document, place, value)))


@pytest.mark.parametrize("name", sorted(WHOLE))
def test_a_document_agrees_with_itself(name: str) -> None:
    assert list(differences(frozen(name), frozen(name))) == []
    assert list(differences(frozen(name), frozen(name), 1e-12)) == []


@pytest.mark.parametrize(
    ("name", "place", "rounding", "real"),
    [
        # an optimum: its value to 1e-6, what follows the joints to the root of that
        (UR10, ("critical", "sigma_max"), 2e-7, 1e-4),
        (UR10, ("posture", "elbow"), 2e-4, 2e-3),
        (UR10, ("tool", "position", 0), 2e-7, 1e-4),
        (UR10, ("tool", "quaternion_wxyz", 2), 2e-4, 5e-3),
        (UR10, ("covariance", 1, 1), 2e-4, 5e-3),
        (UR10, ("what_would_help", 1, "sigma_max"), 2e-7, 1e-4),
        (UR10, ("success_probability",), 2e-6, 1e-4),
        ("solve-weld_planar_2r", ("sigma_max",), 2e-7, 1e-4),
        ("plan-planar", ("parameters", 0, "after"), 2e-7, 1e-4),
        # a placement: to what its search ends at
        (TRAY, ("critical", "sigma_max"), 2e-4, 2e-3),
        # resampled
        ("calibrate-planar", ("spread_check", "coverage", "calibrated", "factor_interval95", 1), 6e-3, 5e-2),
        ("calibrate-planar", ("residuals", "calibrated", "rms_interval95", 0), 6e-3, 5e-2),
        ("diagnose-ur10", ("effects", 0, "gain_interval95", 1), 6e-3, 5e-2),
        # computed from residuals
        ("calibrate-planar", ("residual_rms", "calibrated"), 2e-7, 1e-5),
        ("diagnose-ur10", ("residual_rms", "extended"), 2e-7, 1e-5),
        ("calibrate-planar", ("singular_values", 0), 2e-7, 1e-5),
    ],
)
def test_a_number_may_differ_by_rounding_and_not_more(name: str, place: Place, rounding: float, real: float) -> None:
    document = frozen(name)
    value = at(document, place)
    for sign in (1, -1):
        assert passes(document, place, value * (1 + sign * rounding))
        assert not passes(document, place, value * (1 + sign * real))


@pytest.mark.parametrize(
    ("name", "place", "error", "rounding", "real"),
    [
        ("calibrate-planar", ("parameters", 0, "estimate"), "std", 5e-7, 1e-5),
        ("calibrate-ur10", ("parameters", 3, "estimate"), "std", 5e-7, 1e-5),
        ("diagnose-ur10", ("effects", 0, "estimate", "compliance", "value"), "std", 5e-5, 1e-3),
        ("calibrate-planar", ("assessment", "nominal", "mean_test", "mean", 0), "std_error", 5e-7, 1e-5),
        ("calibrate-planar", ("assessment", "calibrated", "deviations", "x", "bias"), "rms", 5e-7, 1e-5),
    ],
)
def test_a_fitted_number_is_compared_in_its_standard_errors(
    name: str, place: Place, error: str, rounding: float, real: float
) -> None:
    document = frozen(name)
    value = at(document, place)
    key = next(i for i in reversed(range(len(place))) if isinstance(place[i], str))
    std = at(document, (*place[:key], error, *place[key + 1 :]))
    assert passes(document, place, value + rounding * std)
    assert not passes(document, place, value + real * std)


def test_the_logarithm_of_a_p_value_is_compared() -> None:
    document = {"effects": [{"p_value": 1e-200}]}
    assert not list(differences(document, {"effects": [{"p_value": 1.001e-200}]}))
    assert list(differences(document, {"effects": [{"p_value": 1.1e-200}]}))
    assert list(differences({"p_value": 0.04}, {"p_value": 0.0401}))


@pytest.mark.parametrize(
    ("name", "place", "value"),
    [
        (UR10, ("status",), "feasible"), (UR10, ("clearance", "between", 0), "elbow"),
        (UR10, ("budget", 0, "parameter"), "elbow.theta"), (UR10, ("mounting", "assumed"), False),
        (UR10, ("success_probability",), None), (UR10, ("what_would_help", 0, "assumed"), False),
        ("calibrate-planar", ("rank",), 5), ("calibrate-planar", ("outliers",), [3]),
        ("calibrate-planar", ("parameters", 0, "determined"), False),
        ("calibrate-planar", ("parameters", 1, "std"), 1e-3), ("diagnose-ur10", ("verdict",), "unexplained"),
        ("diagnose-ur10", ("effects", 0, "kind"), "backlash"),
        ("diagnose-ur10", ("effects", 1, "confounded_with"), [{"kind": "slip", "target": "base"}]),
        ("diagnose-ur10", ("effects", 0, "target"), "base"), ("plan-planar", ("random_equivalent",), 12),
        ("map-panda", ("targets", 3, "status"), "optimal"),
    ],
)  # fmt: skip
def test_a_decision_a_name_and_a_count_are_exact(name: str, place: Place, value: Any) -> None:
    document = frozen(name)
    assert at(document, place) != value
    assert not passes(document, place, value)


def test_nothing_may_be_gone_or_one_less() -> None:
    document = frozen("diagnose-ur10")
    assert list(differences(document, {k: v for k, v in document.items() if k != "residual_rms"}))
    assert not passes(document, ("effects",), document["effects"][1:])
    assert not passes(document, ("effects",), [document["effects"][0], *document["effects"][:2]])


def test_text_for_people_may_change() -> None:
    document = {"notes": ["one"], "issue": {"mend": "a", "hint": "b", "reason": "c", "key": "d"}}
    assert not list(differences(document, {"notes": [], "issue": {"key": "d"}}))
    assert list(differences(document, {"notes": [], "issue": {"key": "e"}}))


def mirrored(document: dict[str, Any], which: int = 1) -> dict[str, Any]:
    """The solution with another of its alternatives as the choice."""
    other = copy.deepcopy(document)
    chosen = other["alternatives"].pop(which)
    other["alternatives"].insert(0, chosen)
    other["posture"], other["critical"]["sigma_max"] = chosen["posture"], chosen["sigma_max"]
    other["tool"]["quaternion_wxyz"] = [0.0, 0.6, 0.8, 0.0]
    other["covariance"] = [list(reversed(row)) for row in reversed(other["covariance"])]
    return other


def test_the_mirrored_optimum_is_the_same_answer() -> None:
    document = frozen(UR10)
    assert not list(differences(document, mirrored(document)))
    assert list(differences(document, mirrored(document, 2))), "the third alternative is 1.6 % worse"
    lost = changed(mirrored(document), ("alternatives",), mirrored(document)["alternatives"][:3])
    assert list(differences(document, lost))
    assert not passes(mirrored(document), ("covariance", 0, 0), 1.0), "of the same choice, everything is compared"


def test_another_placement_of_equal_value_is_the_same_answer() -> None:
    document = frozen(TRAY)
    turned = copy.deepcopy(document)
    turned["workpiece"]["yaw"] -= 3.1
    for feature, other in zip(turned["features"], reversed(document["features"]), strict=True):
        feature |= {key: copy.deepcopy(other[key]) for key in ("posture", "critical")}
    turned["posture"], turned["critical"] = turned["features"][0]["posture"], turned["features"][0]["critical"]
    turned["worst_feature"]["name"] = "seat 6"
    assert not list(differences(document, turned))
    for feature in turned["features"]:
        feature["critical"]["sigma_max"] *= 1.001
    assert list(differences(document, turned))
    assert not passes(document, ("worst_feature", "name"), "seat 6"), "of the same placement, everything is compared"


def test_ranked_lists_are_compared_without_their_order() -> None:
    document = frozen(PLANAR)
    assert passes(document, ("budget",), document["budget"][::-1])
    swapped = copy.deepcopy(document["budget"])
    swapped[0]["share"], swapped[-1]["share"] = swapped[-1]["share"], swapped[0]["share"]
    assert not passes(document, ("budget",), swapped)
