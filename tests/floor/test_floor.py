"""One draw of each circumstance: what is named, what is left open, and sizes. Shares belong to the hunt."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from tests.floor.hunt import ask, draw, score
from tests.helpers.variants import conformance

SEED = 2042
NAMED = ("other_sigma", "other_nest", "leaning", "late_tracker")
OPEN = ("two_arms", "scatter_between_stays")
CLEAN = ("clean_visits", "clean_readings", "clean_single")


@pytest.mark.parametrize("name", [*conformance(NAMED, NAMED[:1]), pytest.param("tilting_base", marks=pytest.mark.long)])
def test_the_cause_is_named_with_its_size(name: str) -> None:
    case = draw(name, SEED, 0)
    found = score(case, ask(case))
    assert found["right"], found
    assert not found["false"], found
    assert all(abs(z) < 3 for z in found["z"]), found


@pytest.mark.parametrize("name", conformance(OPEN, []))
def test_what_no_name_explains_is_left_open(name: str) -> None:
    case = draw(name, SEED, 0)
    assert ask(case)["verdict"] == "unexplained"


@pytest.mark.parametrize("name", conformance(CLEAN, ("clean_readings",)))
def test_nothing_is_said_of_an_arm_that_errs_by_its_geometry_alone(name: str) -> None:
    case = draw(name, SEED, 0)
    answer = ask(case)
    assert answer["verdict"] == "effects_found"
    assert not score(case, answer)["named"]
    assert "gravity" not in answer
    assert "masses" not in answer


@pytest.mark.long
def test_a_joint_that_repeats_scatter_along_is_named_where_structure_hides_it_in_all_rows() -> None:
    case = draw("scattering_joint", SEED, 0)
    answer = ask(case)
    found = score(case, answer)
    assert found["right"], found
    assert not found["false"], found
    assert answer["verdict"] == "unexplained"


@pytest.mark.long
def test_the_line_to_paste_states_the_gravity_that_was_found() -> None:
    case = draw("hung", SEED, 0)
    answer = ask(case)
    found = score(case, answer)
    assert found["right"], found
    assert not found["false"], found
    assert all(abs(z) < 3 for z in found["z"]), found
    line = answer["gravity"]["line"]
    case.document["robot"]["gravity"] = [float(v) for v in line.split("[")[1].rstrip("]").split(",")]
    again = ask(case)
    assert "gravity" not in again
    assert not score(case, again)["false"]


@pytest.mark.long
def test_a_gripper_that_the_file_does_not_know_is_no_compliance() -> None:
    case = draw("unstated_gripper", SEED, 0)
    answer = ask(case)
    assert not score(case, answer)["false"]
    assert answer["masses"]["place"] == "tool"
    assert 2.0 < answer["masses"]["mass"] < 9.0
    (cause,) = [e for e in answer["effects"] if e["kind"] == "joint_compliance"]
    assert "compliance" not in cause["estimate"]


@pytest.mark.long
def test_a_path_is_held_out_by_stretches_and_its_promise_kept_at_rest() -> None:
    case = draw("late_tracker", SEED, 1)
    answer = ask(case)
    assert answer["cross_validation"] == "stretch"
    found = score(case, answer)
    assert found["promise"] < 1.3
    assert found["worse"] < 0.5


@pytest.mark.parametrize(
    ("name", "doubt"), [("fahrenheit", "temperature"), ("pasted", "copies"), ("turned_sides", "approach")]
)
def test_what_can_hardly_be_is_doubted(name: str, doubt: str) -> None:
    case = draw(name, SEED, 0)
    problem = po.problem_from_dict(case.document)
    found = po.calibrate(problem, po.read_measurements(case.table, problem), plan=False)
    assert [one.id for one in found.doubts] == [doubt]
    assert [entry["id"] for entry in found.to_json()["doubts"]] == [doubt]
    assert np.isfinite(found.calibrated.rms)


@pytest.mark.parametrize(("shift", "unit"), [(273.15, "K"), (-273.15, "°C")])
def test_a_temperature_that_no_cell_has_names_the_unit_that_fits(shift: float, unit: str) -> None:
    case = draw("clean_single", SEED, 0)
    table = case.table | {"temperature [degC]": case.table["temperature [degC]"] + shift}
    problem = po.problem_from_dict(case.document)
    (doubt,) = po.calibrate(problem, po.read_measurements(table, problem), plan=False).doubts
    assert doubt.values["unit"] == unit
    assert 10 < doubt.values["low_so"] < doubt.values["high_so"] < 35


def test_sides_that_contradict_the_rows_and_make_play_negative_are_read_reversed() -> None:
    case = draw("turned_sides", SEED, 0)
    (play,) = [e for e in ask(case)["effects"] if e["kind"] == "backlash"]
    (size,) = play["estimate"].values()
    assert abs(size["value"] - 0.3e-3) < 4 * size["std"]
