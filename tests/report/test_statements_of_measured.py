"""Every id of the rooms that check, plan, recheck and simulate is made: by an example, or by a variant of one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace as Made
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.changes.what_changed import GrossRow
from posture_opt.report.text.blocks import Document
from posture_opt.statements import every_entry, state
from posture_opt.uncertainty.moments.pose_covariance import Validity
from posture_opt.validation.model_errors import Sides, Trend
from tests.helpers.every_result import MADE, PROBLEMS

QUOTED = {"changes.inspect", "experiments.inseparable"}
ROOMS = ("batch", "changes", "experiments", "uncertainty", "validation")
NAMES = ("Spread", "Cloud", "Assessment", "SpreadCheck", "AccuracyMap", "MeasurementPlan", "Recheck", "Batch",
         "BatchDiagnosis")  # fmt: skip


def made(name: str) -> Any:
    return MADE[name]()


def rechecks() -> Iterator[Any]:
    found = made("Recheck")
    kinds = {change.kind: change for change in found.changes}
    base, backlash, other = kinds["base_frame"], kinds["backlash"], kinds["joint_offset"]
    one = replace(found, verdict="changed", named_count=1, plan=None)
    alike = replace(other, probability=0.9, possible=replace(other.possible, alike=("joint1.d",)))
    stated = Made(arm=Made(effects=(backlash.possible.effect,), inputs=Made(payload=2.0)), robot=found.problem.robot)
    loaded = Made(dimensions=backlash.possible.effect.dimensions, kind="a", target="b", asks=("payload",),
                  inspect=lambda robot: "the gear of b")  # fmt: skip
    yield replace(found, verdict="unchanged", unplanned="no posture is allowed")
    yield replace(one, changes=(alike, base), gross=(GrossRow(5, 3e-3),))
    yield replace(one, changes=(base, backlash), shared_count=1, errors_after=2 * found.errors_before)
    yield replace(one, changes=(replace(backlash, probability=0.8), replace(base, probability=0.2)), problem=stated)
    yield replace(one, changes=(replace(backlash, possible=replace(backlash.possible, effect=loaded)),), problem=stated)
    yield replace(found, verdict="unclear", named_count=0)
    yield replace(found, verdict="several", named_count=0)


def plans() -> Iterator[Any]:
    plan = made("MeasurementPlan")
    remarks = (state("experiments.no-tool"), state("experiments.task-posture-unknown", reason="it is too far"))
    yield replace(plan, equivalent=None, keeps_height=False, purpose="task", remarks=remarks)
    yield replace(plan, equivalent=2, tour=replace(plan.tour, blocked=(1,), sides=np.array([0.0, 0.5])))
    yield replace(plan, before=replace(plan.before, task=math.nan), second=("a joint",))


def assessments() -> Iterator[Any]:
    found = made("Assessment")
    off, few = replace(found.calibrated.blocks[0], zero=False), replace(found.calibrated, blocks=(), coordinate=0.0)
    wrong = replace(found.calibrated, blocks=(off, *found.calibrated.blocks[1:]), beyond3=0.2)
    trend = Trend("time", (0.0, 3600.0), np.array([1e-4, 0.0]), np.array([1e-5, 1e-5]), 1e-4, True)
    side = Sides("joint1", -1e-4, 1e-5, 1e-4, True)
    yield replace(found, calibrated=wrong, trends=(trend,), sides=(side,), instrument=0.0)
    yield replace(found, calibrated=replace(few, mean=None), residual_scatter=None)
    yield replace(found, residual_scatter=None)
    for unseen in ("no-task-direction", "direction-unmeasured", "direction-of-measurements"):
        yield replace(found, unseen=unseen)
    for poses in ((), (Made(nominal=Made(n=5)),)):
        yield replace(found, repeats=Made(poses=poses))


def spread_checks() -> Iterator[Any]:
    found = made("SpreadCheck")
    nominal, models = found.coverage["nominal"], found.scatter_predictions
    yield replace(found, stated=False, correlated=("joint1.a with joint2.a",))
    for factor in (2.0, 0.3):
        yield replace(found, coverage={"nominal": replace(nominal, factor=factor, factor_interval=(factor, factor))})
    yield replace(found, coverage={"nominal": replace(nominal, probability=np.linspace(0.6, 1.0, 60))})
    for gain in (0.01, -1.0):
        judged = tuple(replace(model, gain=gain, gain_std=0.1) for model in models)
        yield replace(found, scatter_predictions=judged, from_repeats=True)
    yield replace(found, repeat_sigma=0.9 * found.residual_rms, outlying=(3,))
    assumed = Made(request=Made(problem=Made(sources=Made(assumed=True))))
    for verdict in ("right", "understated", "overstated"):
        test = Made(interval=(0.9, 1.1), factor=1.0, verdict=verdict, p_size=0.5, poses=(), groups=9)
        one = replace(found, repeat_sigma=0.1 * found.residual_rms, repeats=test, repeats_by="visit")
        yield replace(one, calibration=assumed)


def maps() -> Iterator[Any]:
    found, problem = made("AccuracyMap"), po.load_problem("insert_planar_2r_calibrated")
    data = po.read_measurements(PROBLEMS / "planar_2r_measured.csv", problem)
    measured = po.map_accuracy(problem, data, counts=(2, 2)).measured
    assert measured is not None
    ids = ("rows-touch-points", "measured-elsewhere")
    remarks = (
        state("validation.rows-of-first-target", "ball"),
        state("validation.frames-fitted-to-rows", frames=["base"]),
    )
    every, nowhere = np.ones(60, bool), np.zeros(60, bool)
    more = [(every, every, ()), (nowhere, nowhere, ()), (np.arange(60) < 57, np.arange(60) < 5, remarks)]
    for inside, near, notes in more:
        one = replace(measured, inside=inside, near=near, remarks=notes, comparable=True)
        away = replace(found.targets.map_points[0], q=())
        yield replace(found, corrections=3, measured=one, targets=Made(feasible=np.array([False]), map_points=(away,)))
    big = {name: np.tile(getattr(measured, name), 20) for name in ("cell", "near", "corrected", "limit")}
    over = replace(measured, **big, inside=np.ones(1200, bool), remarks=tuple(state(f"validation.{i}") for i in ids))
    yield replace(found, measured=replace(over, comparable=True))


def batches() -> Iterator[Any]:
    found, diagnosis = made("Batch"), made("BatchDiagnosis")
    cause = next(change.possible.effect for change in made("Recheck").changes if change.kind == "backlash")
    refuted = replace(found.calibrations[0], contradictions=(Made(cause=cause),))
    vague = replace(found.spread, interval=0.0 * found.spread.interval)
    yield replace(found, pairs=(), calibrations=(refuted, *found.calibrations[1:]), spread=vague)
    yield replace(found, robots=found.robots[:5], calibrations=found.calibrations[:5])
    yield replace(diagnosis, uneven=(), effects=())
    marks = ({"scatters": True}, {"refuted": True}, {"still": True})
    yield replace(diagnosis, effects=(), uneven=tuple(replace(diagnosis.uneven[0], **mark) for mark in marks))


def spreads() -> Iterator[Any]:
    ur10 = {"robot": {"kind": "preset", "name": "ur10"}, "uncertainty": {"repeatability": "0.1 mm"}}
    q, task = "0 deg, -90 deg, 90 deg, 0 deg, 90 deg, 0 deg", {"kind": "insert", "direction": [0, 0, -1]}
    place = {"position": ["0.5 m", "0.5 m", "0.1 m"], "clearance": "0.01 mm"}
    yield po.propagate(po.problem_from_dict(ur10), q)
    for more in (place, {"clearance": "1 mm"}, {"clearance": "1 mm", "length": "50 mm"}):
        yield po.propagate(po.problem_from_dict({**ur10, "task": {**task, **more}}), q)
    sigma = {"sigma": {"shoulder_pan.theta": "1 mrad"}}
    stated = po.problem_from_dict({**ur10, "uncertainty": sigma, "task": {**task, "clearance": "0.5 mm"}})
    yield po.propagate(stated, "400 deg, -400 deg, 90 deg, 0 deg, 90 deg, 0 deg")
    for seed in (1, 2):
        cloud = po.simulate(stated, q, n=1000, seed=seed)
        yield replace(cloud, inside=(900, 1000)[seed - 1], hits=(0, cloud.hits)[seed - 1])
    stable = po.simulate(stated, q, adaptive=True, digits=1)
    yield stable
    yield replace(stable, adaptive=replace(stable.adaptive, stable=False))


def test_every_sentence_is_made_and_every_id_has_one() -> None:
    variants = (rechecks, plans, assessments, spread_checks, maps, batches, spreads)
    results = [*(made(name) for name in NAMES), *(result for make in variants for result in make())]
    statements = [statement for result in results for statement in result.statements]
    statements += [Validity(*values).statement for values in ((0.3, 0.1), (0.9, 0.1), (math.inf, 0.1))]
    entries = {name for name in every_entry() if name.partition(".")[0] in ROOMS}
    assert {one.id for one in statements} >= entries, entries - {one.id for one in statements}
    long = [
        one.text
        for one in statements
        if max(len(s.split()) for s in one.text.split(". ")) > 25 and one.id in entries - QUOTED
    ]
    assert not long, "\n".join(dict.fromkeys(long))
    for one in statements:
        assert not {"None", "nan", "not known"} & set(one.text.split()), one.text
        assert one.text[-1] in ".?)" or one.id not in entries - QUOTED, one.text


@pytest.mark.parametrize("name", NAMES)
def test_the_first_screen_has_an_answer_and_ends(name: str) -> None:
    document = made(name).document()
    assert isinstance(document, Document)
    assert document.statements[0].severity == "result"
    words = " ".join(f"{label} {text}" for label, text in document.lines).split()
    assert len(words) <= 90
