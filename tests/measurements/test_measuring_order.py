"""Rows that are not in the order in which they were made: sides of approach follow the clock, where there is one."""

from __future__ import annotations

import numpy as np

import posture_opt as po
from tests.helpers.simulated_session import SimulatedSession
from tests.hidden.designs import Plan
from tests.hidden.effects import Effect


def session() -> tuple[SimulatedSession, dict]:
    """A UR10 with play in its second joint, sides not stated, the clock logged."""
    case = SimulatedSession(501, "ur10", Plan(logged=True, sides=False, repeated=10, visits=3))
    return case, case.table(case.points(Effect("backlash", "joint2", {"b": 0.5e-3})))


def by_pose(table: dict) -> tuple[dict, np.ndarray]:
    order = np.argsort(table["pose"], kind="stable")
    return {name: np.asarray(values)[order] for name, values in table.items()}, order


def test_sides_in_a_table_that_was_sorted_by_pose_are_those_of_the_clock() -> None:
    case, table = session()
    moved, order = by_pose(table)
    problem = po.problem_from_dict(case.document())
    straight, sorted_ = (po.read_measurements(one, problem) for one in (table, moved))
    np.testing.assert_array_equal(sorted_.approach, straight.approach[order])
    np.testing.assert_array_equal(sorted_.approach_length, straight.approach_length[order])
    assert any("the row before one is that before it in time" in note for note in sorted_.notes)
    without = po.read_measurements({name: v for name, v in moved.items() if "time" not in name}, problem)
    assert np.mean(without.approach != sorted_.approach) > 0.1


def test_a_clock_that_starts_anew_is_asked_about_and_leaves_the_rows_as_they_stand() -> None:
    case, table = session()
    half = len(table["pose"]) // 2
    time = np.array(table["time [s]"])
    time[half:] -= time[half]
    problem = po.problem_from_dict(case.document())
    read = po.read_measurements(table | {"time [s]": time}, problem)
    np.testing.assert_array_equal(read.approach, po.read_measurements(table, problem).approach)
    assert any("as if the clock had started anew" in note for note in read.warnings)
