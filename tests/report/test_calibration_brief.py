"""The first screen of a report holds what matters most, however much there is to say."""

from __future__ import annotations

from posture_opt.report.blocks import Facts, Report
from posture_opt.report.calibration_brief import SCREEN, on_a_screen
from posture_opt.report.text import render

LONG = "This sentence is as long as those that a report begins with, and takes more than one line of a hundred columns."
LABELS = ("Measured", "Parameters", "Undetermined", "Outliers", "Next", "More")
FACTS = [(label, f"{label}: {LONG}") for label in LABELS]


def labels(report: Report) -> list[str]:
    (facts,) = report.blocks[0].items
    assert isinstance(facts, Facts)
    return [label for label, _ in facts.rows]


def test_all_of_it_where_there_is_room() -> None:
    report = on_a_screen(Report("Arm", ("Calibrated.",), ()), FACTS)
    assert labels(report) == list(LABELS)


def test_what_matters_least_goes_first() -> None:
    report = on_a_screen(Report("Arm", (LONG,) * 5, ()), FACTS)
    assert len(render(report).splitlines()) <= SCREEN
    assert "Outliers" not in labels(report)
    assert {"Parameters", "Next", "More"} <= set(labels(report))
    assert len(report.lead) == 5


def test_the_end_of_a_long_lead_goes_too() -> None:
    report = on_a_screen(Report("Arm", tuple(f"{k}. {LONG}" for k in range(12)), ()), FACTS)
    assert len(render(report).splitlines()) <= SCREEN
    assert labels(report) == ["Next", "More"]
    assert report.lead[0].startswith("0.")
