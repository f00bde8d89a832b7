"""Statements of a diagnosis and a calibration in circumstances that no small data set has all of."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.calibration import calibration_statements as of_calibration
from posture_opt.calibration.doubts import Doubt
from posture_opt.calibration.start_up import ScatterChange, StartUp
from posture_opt.calibration.weights import GravityReading, MassReading
from posture_opt.diagnosis.measured_goals import Choice
from posture_opt.statements import Statement
from tests.helpers.planar_2r import position
from tests.helpers.planar_files import PROBLEM, write


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> po.Diagnosis:
    """A wheel at the first joint, seen by 0.02 mm of noise."""
    folder = tmp_path_factory.mktemp("wheel")
    rng = np.random.default_rng(4)
    q = rng.uniform(-2.5, 2.5, (120, 2))
    write(
        folder / "data.csv",
        q,
        position(q + np.outer(4e-4 * np.sin(7 * q[:, 0]), [1, 0])) + rng.normal(0, 2e-5, q.shape),
    )
    problem = po.problem_from_dict(PROBLEM)
    return po.diagnose(problem, po.read_measurements(folder / "data.csv", problem), plan=False)


def ids(found: po.Diagnosis, known: dict[str, Any] | None = None, **changes: Any) -> dict[str, Statement]:
    other = replace(found, **changes)
    vars(other).update(known or {})
    return {one.id.removeprefix("diagnosis."): one for one in other.statements}


def of_text(statements: list[Statement]) -> dict[str, str]:
    return {one.id.removeprefix("calibration."): one.text for one in statements}


@pytest.mark.parametrize(
    ("rms", "low", "id"),
    [
        ((1.0, 1.1, 1.2), 0.1, "test-nothing-holds"),
        ((1.0, 0.9, 1.2), 0.1, "test-effects-fail"),
        ((1.0, 0.8, 0.9), 0.1, "test-no-gain"),
        ((1.0, 0.8, 0.5), 0.1, "test-gain-holds"),
        ((1.0, 0.8, 0.5), -0.1, "test-gain-unsure"),
    ],
)
def test_a_gain_is_held_against_another_file(
    found: po.Diagnosis, rms: tuple[float, float, float], low: float, id: str
) -> None:
    names = ("nominal", "calibrated", "extended")
    models = {name: replace(found.errors["nominal"], rms=1e-3 * size) for name, size in zip(names, rms, strict=True)}
    gain, effect = SimpleNamespace(value=-0.1, low=low), SimpleNamespace(label="wheel")
    file = SimpleNamespace(refitted=False, data=range(20), models=models)
    test: Any = SimpleNamespace(gain=gain, gains=(gain,), models=models, file=file, worse=(0,), effects=(effect,))
    said = ids(found, test=test)
    assert said[id].severity == ("result" if id == "test-gain-holds" else "caution")
    assert said["test-extrapolates"].values["effects"] == ["wheel"]
    assert ("test-confirms" in said) == (low < 0)
    without = ids(found, test=SimpleNamespace(**{**vars(test), "gains": (None,)}))
    assert {"test-without-effects", "calibration.test-holds"} & set(without)


def test_what_is_delivered_and_why_it_lacks_effects(found: po.Diagnosis) -> None:
    kept = {"delivered": (1e-5, 1), "delivered_outliers": (7,)}
    of = found.delivery
    lacking = ids(found, kept, delivery=replace(of, kept=(0,), vague=(0,)))
    assert lacking["delivered-without"].values["reason"] == "of undetermined size"
    assert "delivered-rms" in lacking
    for nominal, id in ((False, "delivered-calibrated"), (True, "delivered-nominal")):
        assert ids(found, kept, delivery=replace(of, kept=(), nominal=nominal))[id].severity == "caution"


def test_rows_and_gains_that_stand_out_are_said(found: po.Diagnosis) -> None:
    best, held = found.errors["extended"], found.held["extended"]
    far = ids(found, errors={**found.errors, "extended": replace(best, max=10 * best.p95)})
    assert far["row-far-off"].values["off"].to_json()["value"] == 10 * best.p95  # type: ignore[union-attr]
    assert "rows-within" in ids(found)
    assert "gain-significant" in ids(found)
    empty = replace(held, inside=np.zeros_like(held.inside))
    assert "regions-too-small" in ids(found, held={**found.held, "extended": empty})
    same = {**found.held, "extended": found.held["calibrated"]}
    assert "gain-insignificant" in ids(found, held=same)
    repeated = replace(found)
    vars(repeated)["noise_floor"] = replace(found.noise_floor, repeated=True)
    assert repeated.statements[0].id == "diagnosis.error-effects-noise"
    assert "promise-of-stretches" in ids(found, by="stretch")


def test_unexplained_structure_says_where_it_is(found: po.Diagnosis) -> None:
    unsure = replace(found.adequacy, structure=1e-9, lack_of_fit=1e-9, place="joint2")
    said = ids(found, verdict="unexplained", adequacy=unsure)
    assert {"structure-small", "structure-along", "neighbours-correlated", "lack-of-fit"} <= set(said)
    assert "causes-explain-part" in said
    curve: Any = SimpleNamespace(words="a curve", kind="curve", target="joint2")
    depends = ids(found, verdict="unexplained", adequacy=unsure, unexplained=(curve,))
    assert depends["structure-depends"].values["components"] == ["a curve"]
    assert {"not-searched", "unknowable"} & set(said)


@pytest.mark.parametrize(("better", "id"), [(0.9, "goals-choice-better"), (0.5, "goals-choice-random")])
def test_what_a_choice_of_postures_is_worth(found: po.Diagnosis, better: float, id: str) -> None:
    choice = Choice(np.array([1e-4]), np.array([2e-4]), better)
    both = {"nominal": choice, "extended": choice}
    goals = SimpleNamespace(sent=both, uncorrected=both, chance=0.5, margin=0.1, goals=1, to_json=dict)
    assert {"goals-missed", id} <= set(ids(found, {"goals": goals}))


def test_doubts_about_the_file_are_stated() -> None:
    """Each is one statement with the numbers that raise it."""
    doubts = (
        Doubt("copies", {"rows": 3, "of": 9}),
        Doubt("fahrenheit", {"low": 68.0, "high": 93.0, "low_if_f": 20.0, "high_if_f": 33.9}),
        Doubt("approach", {"against": 30, "moves": 30}),
    )
    copies, warm, sides = (doubt.statement.text for doubt in doubts)
    assert copies.startswith("3 of 9 rows")
    assert "20.0 to 33.9 °C" in warm
    assert sides.startswith("30 of 30 stated sides")
    gravity = GravityReading((0, 0, 9.81), (0, 0, 9.81), "mounting", 50.0, {}).statement
    assert "write 'gravity: [0, 0, 9.81]'" in gravity.text
    assert "6.00 ± 0.50 kg at tool" in MassReading("tool", 6.0, 0.5, 50.0).statement.text


def test_an_instrument_that_is_worse_than_the_arm_is_said_first() -> None:
    scatter = SimpleNamespace(exceeds=True, scatter=3e-4, arm=1e-4, unit="m")

    def said(nominal: bool, better: bool, probability: float) -> dict[str, str]:
        found: Any = SimpleNamespace(
            instrument_scatter=scatter, better_than_nominal=probability, predicts_better=better
        )
        return of_text(of_calibration.instrument(found, nominal))

    assert set(said(False, True, 0.97)) == {"instrument-scatters-more", "probably-better"}
    assert set(said(True, True, 0.6)) == {"instrument-scatters-more", "nominal-kept-unsure"}
    assert set(said(True, False, 0.97)) == {"instrument-scatters-more", "nominal-kept-no-gain"}


def test_rows_in_time_and_rows_left_out() -> None:
    data: Any = SimpleNamespace(
        time=np.array([0.0, 9.0, 1.0, 2.0]), visit=None, robot=np.zeros(4, dtype=int), line=np.arange(2, 6)
    )
    start = StartUp(12, 60.0, 2e-4, 1e-4, 1e-3, spread=True, warming=(3.0, 0.2))
    change = ScatterChange(40, 1e-4, 4e-4, 1e-5, ("B",))
    assert set(of_text(of_calibration.rows_in_time(data, start))) == {
        *("clock-restarts", "start-up", "start-up-temperature"),
    }
    elsewhere = of_text(of_calibration.rows_in_time(data, replace(start, spread=False, warming=None)))
    assert "start-up-elsewhere" in elsewhere
    changed = of_text(of_calibration.rows_in_time(data, None, change))
    assert "where B is touched" in changed["scatter-changes-at-points"]
    for run, id in ((0, "outliers"), (5, "outliers-at-end")):
        gone: Any = SimpleNamespace(outliers_at_ends=run)
        assert set(of_text(of_calibration.left_out(gone, [3, 4]))) == {id}


def test_a_thinned_file_says_whether_more_rows_would_help() -> None:
    models = {name: SimpleNamespace(rms=1e-4) for name in ("nominal", "calibrated")}
    for uncertainty, id in ((1e-6, "thinning-suffices"), (5e-5, "thinning-limits")):
        thinning = SimpleNamespace(data=range(900), rows=range(100))
        large: Any = SimpleNamespace(models=models, thinning=thinning, uncertainty=uncertainty, left=1e-4)
        assert set(of_text(of_calibration.thinned(large))) == {"thinned", id}


def test_a_calibration_states_what_it_changed_and_what_comes_next(found: po.Diagnosis) -> None:
    calibration = found.calibration
    said = {one.id: one for one in calibration.statements}
    assert said["calibration.error-reduced" if "calibration.error-reduced" in said else "calibration.error-not-reduced"]
    assert any(id.startswith("calibration.next-") for id in said)
    assert "calibration.significant-parameters" in said
    worse = replace(calibration, calibrated=calibration.nominal)
    assert worse.statements[0].id == "calibration.error-not-reduced"
