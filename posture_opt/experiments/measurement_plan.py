"""``MeasurementPlan``: which postures to measure next, and what they are expected to show."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.csv_text import csv_line
from posture_opt.experiments.candidate_postures import Workspace
from posture_opt.experiments.expected_errors import ExpectedErrors
from posture_opt.experiments.plan_search import Tour
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Json, Mask
from posture_opt.result import Result
from posture_opt.robot.posture import Posture
from posture_opt.robot.robot import Joint, Robot
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.regions.critical import PARTS

Purpose = Literal["parameters", "task", "recheck"]
INSTRUMENT = "instrument"
"""Column that says which instrument measured a row."""
_WRITTEN = {"revolute": ("deg", math.degrees(1.0)), "prismatic": ("mm", 1e3)}
_EXACT_STD = 1e-7  # m, rad: rounding of a covariance in which parameters are correlated


@dataclass(frozen=True, eq=False)
class Target:
    """The posture whose tool point a plan serves, and the directions (t, 3) along which its error counts.

    Args:
        q: (n,) the posture [rad or m].
        basis: (t, 3) orthonormal directions, world; ``within`` names them: ``across``, ``along`` or ``all``.
    """

    q: Array
    basis: Array
    within: str


@dataclass(frozen=True, eq=False)
class SecondJoint:
    """A joint of a second arm, which the tool touches.

    Args:
        name: ``ARM.JOINT``.
        values: (count,) at each posture [rad or m]; NaN where another instrument is used.
    """

    name: str
    joint: Joint
    values: Array


@dataclass(frozen=True, eq=False, repr=False)
class MeasurementPlan(Result):
    """Postures to measure, in the order of the tour, and what is expected of them.

    `plan_measurements` makes it. All expected errors hold for the model of the problem file: what the model lacks is
    not in them, so a calibration with the plan can be worse than ``after``, and not better.

    Args:
        problem: the arm that is to be measured, and its task.
        q: (count, n) the postures [rad, m], rounded to 0.01 deg and 0.01 mm.
        points: (count, 3) where the nominal tool point comes to lie, world [m].
        repeats: how often each is measured.
        purpose: ``parameters``, ``task`` or ``recheck``.
        parameters: the (k,) unknowns; ``settled`` (k,) which of them measurements with this instrument can determine.
        undetermined: what no measurement can determine, a sentence each.
        before, after, random: what is known without the plan, with it, and with random postures (medians).
        gain: the criterion's standard error with as many random postures, over that with the chosen ones.
        equivalent: so many random postures do what the chosen ones do; ``None`` where none of the tried sizes does.
        reach: (m, 3) nominal tool points of random postures that are allowed, world [m].
        tried: the largest number of random postures that was tried; ``draws`` of them are behind each median.
        target: the task's posture, or ``None``.
        tour: travel, blocked legs and approach sides.
        workspace: where the arm may go; ``share`` of the random postures that are allowed.
        given: the measurements made already, or ``None``; ``spread`` is the standard deviation of a
            measured coordinate, of arm and instrument together, in units of the instrument's.
        sigma: the instrument's, of a coordinate [m]; ``sigma_rotation`` [rad], 0 where orientations are not measured.
        keeps_height: whether the task, the box or the arm itself keeps the postures from reaching below the table.
        targets: the points on the tool that are measured at each posture; empty for one.
        columns: column of the file -> (count,) what stands there: the plane, anchor, point or camera of each posture,
            and where a file mixes instruments, which of them; empty of positions.
        columns_by_row: the same where a posture has several rows, as one for each marker that a camera sees: the cells
            of all rows of each posture.
        second: the joints of a second arm that is touched.
        notes: sentences on what was assumed of instrument and data; ``remarks`` what the plan itself has to remark.
    """

    problem: ProblemData
    q: Array
    points: Array
    repeats: int
    purpose: Purpose
    parameters: tuple[Parameter, ...]
    settled: Mask
    undetermined: tuple[str, ...]
    before: ExpectedErrors
    after: ExpectedErrors
    random: ExpectedErrors
    gain: float
    equivalent: int | None
    tried: int
    draws: int
    target: Target | None
    tour: Tour
    workspace: Workspace
    share: float
    reach: Array
    given: Measurements | None
    spread: float
    sigma: float
    sigma_rotation: float
    axes: tuple[str, ...]
    targets: tuple[str, ...]
    keeps_height: bool = True
    columns: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    columns_by_row: Mapping[str, tuple[tuple[str, ...], ...]] = field(default_factory=dict)
    second: tuple[SecondJoint, ...] = ()
    notes: tuple[str, ...] = ()
    remarks: tuple[Statement, ...] = ()

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """What the plan is worth, what to know before running it, and what it leaves open."""
        return plan_statements(self)

    @property
    def listed(self) -> list[int]:
        """Indices of the parameters that can be determined and are not as good as exact already."""
        return np.flatnonzero(self.settled & ~(self.before.std < _EXACT_STD)).tolist()

    @property
    def arm_scatter(self) -> float:
        """The arm's own part ``σ sqrt(spread² − 1)`` of the standard deviation of a measured coordinate [m]."""
        return self.sigma * math.sqrt(max(self.spread**2 - 1, 0.0))

    @property
    def robot(self) -> Robot:
        """The robot that is measured."""
        return self.problem.robot

    @property
    def places(self) -> tuple[str, ...]:
        """(count,) the plane, anchor, point or camera that is measured from each posture; empty where there is none."""
        own = [cells for column, cells in self.columns.items() if column != INSTRUMENT]
        return tuple(next((c for c in cells if c), "") for cells in zip(*own, strict=True))

    @property
    def instruments(self) -> tuple[str, ...]:
        """(count,) the instrument that is used at each posture; empty where there is one."""
        return self.columns.get(INSTRUMENT, ())

    @property
    def postures(self) -> list[Posture]:
        """Joint name -> value [rad, m], printed in degrees, in the order of the tour."""
        return [Posture(self.robot, row) for row in self.q]

    def to_csv(self) -> str:
        """The postures in the order of the tour, in deg and mm.

        With what is measured added, ``read_measurements`` reads it.

        With several targets every repeat has a row for each, and pictures have one for each marker; repeats are rounds
        of the whole tour.
        """
        revolute = [joint.type == "revolute" for joint in self.robot.joints]
        headers = [
            f"{j.name} [{'deg' if turns else 'mm'}]" for j, turns in zip(self.robot.joints, revolute, strict=True)
        ]
        headers += ["pose"] * (self.repeats > 1) + ["target"] * bool(self.targets)
        headers += [f"{one.name} [{_WRITTEN[one.joint.type][0]}]" for one in self.second]
        headers += dict.fromkeys((*self.columns, *self.columns_by_row))
        lines = [csv_line(headers)]
        values = self.q * np.where(revolute, math.degrees(1.0), 1e3)
        for _ in range(self.repeats):
            for pose, row in enumerate(values + 0.0, start=1):
                cells = [f"{value:.2f}" for value in row] + [str(pose)] * (self.repeats > 1)
                second = [_written(one, pose - 1) for one in self.second]
                for target in [[name] for name in self.targets] or [[]]:
                    lines += [csv_line([*cells, *target, *second, *more]) for more in self._rows_beside(pose - 1)]
        return "\n".join(lines) + "\n"

    def _rows_beside(self, k: int) -> list[tuple[str, ...]]:
        """What stands beside the joints in each row of a posture."""
        by_row = {name: cells[k] for name, cells in self.columns_by_row.items()}
        count = max(map(len, by_row.values()), default=1)
        every = {name: (cells[k],) * count for name, cells in self.columns.items()} | by_row
        return [*zip(*every.values(), strict=True)] or [()]

    def fields_json(self) -> dict[str, Json]:
        """The document ``plan.json``: SI units and radians."""
        stages = {"before": self.before, "after": self.after, "random": self.random}
        return {
            "purpose": self.purpose,
            "count": len(self.q),
            "repeats": self.repeats,
            "given": len(self.given) if self.given is not None else 0,
            "postures": [
                {"posture": posture, "tool": [float(v) for v in point], **self._beside(k)}
                for k, (posture, point) in enumerate(zip(self.postures, self.points, strict=True))
            ],
            "gain": self.gain,
            "random_equivalent": self.equivalent,
            "parameters": [
                {
                    "name": p.name,
                    "unit": p.unit,
                    **{name: _finite_or_none(stage.std[i]) for name, stage in stages.items()},
                }
                for i, p in enumerate(self.parameters)
            ],
            "observability": {name: dict(stage.observability) for name, stage in stages.items()},
            "task": self._task_json(stages),
            "undetermined": list(self.undetermined),
            "travel": self.tour.travel,
            "blocked": [k + 1 for k in self.tour.blocked],
            "notes": [
                *self.notes,
                *(s.text for s in self.statements if s in self.remarks or s.id == "experiments.table-unstated"),
            ],
        }

    def _beside(self, k: int) -> dict[str, Json]:
        """What else the document says of a posture: instrument, place, joints of a second arm [rad or m]."""
        found: dict[str, Json] = {}
        for name, cells in (("instrument", self.instruments), ("place", self.places)):
            found |= {name: cells[k]} if cells and cells[k] else {}
        second = {one.name: float(one.values[k]) for one in self.second if np.isfinite(one.values[k])}
        return {**found, "second": second} if second else found

    def _task_json(self, stages: dict[str, ExpectedErrors]) -> dict[str, Json] | None:
        """The entry ``task`` of the document: the posture, and the tool point's expected standard deviation at each
        stage [m].
        """
        if self.target is None:
            return None
        posture = dict(zip(self.robot.joint_names, map(float, self.target.q), strict=True))
        return {"posture": posture, "std": {name: _finite_or_none(stage.task) for name, stage in stages.items()}}


def _written(one: SecondJoint, k: int) -> str:
    """A joint value of a second arm in deg or mm; empty where that arm is not used."""
    value = float(one.values[k]) * _WRITTEN[one.joint.type][1]
    return f"{value + 0.0:.2f}" if math.isfinite(value) else ""


def _finite_or_none(value: float) -> float | None:
    """A number of a document: None in place of NaN and infinity, which JSON does not have."""
    return float(value) if np.isfinite(value) else None


def plan_statements(plan: MeasurementPlan) -> tuple[Statement, ...]:
    """What the plan is worth and brings; surface, height and moves; what is assumed, and what stays open."""
    return (_worth(plan), *_surface(plan), *_task_error(plan), *tour_statements(plan), *plan.remarks, *_open(plan))


def _worth(plan: MeasurementPlan) -> Statement:
    """How many random postures the planned ones are worth."""
    count = len(plan.q)
    if plan.equivalent is None:
        return state("experiments.worth-more", postures=count, random=plan.tried, purpose=plan.purpose)
    if plan.equivalent <= count:
        return state("experiments.worth-as-many", postures=count, purpose=plan.purpose)
    return state("experiments.worth", postures=count, random=plan.equivalent, purpose=plan.purpose)


def _surface(plan: MeasurementPlan) -> Iterator[Statement]:
    """What the arm stands on, and how low it may reach."""
    if mounting := plan.workspace.scene.mounting_statement(plan.q):
        yield mounting
    yield from _height(plan)


def _height(plan: MeasurementPlan) -> tuple[Statement, ...]:
    """That nothing keeps the arm from reaching below the table."""
    return () if plan.keeps_height else (state("experiments.table-unstated"),)


def _task_error(plan: MeasurementPlan) -> Iterator[Statement]:
    """The expected error at the posture of the task, where there is one."""
    if plan.target is None or math.isnan(plan.after.task):
        return
    part, error = PARTS[plan.target.within], Quantity(plan.after.task)
    if math.isnan(plan.before.task):
        yield state("experiments.task-error", part=part, error=error)
    else:
        yield state("experiments.task-error-reduced", part=part, error=error, before=Quantity(plan.before.task))


def tour_statements(plan: MeasurementPlan) -> Iterator[Statement]:
    """Moves that collide, what the others keep clear of, and joints that arrive from one side alone."""
    tour, scene = plan.tour, plan.workspace.scene
    if len(plan.q) > 1:
        last = [f"{len(plan.q)} to 1"] if tour.back and plan.repeats > 1 else []
        bodies = ("the arm itself", *(obstacle.name for obstacle in scene.obstacles))
        if tour.blocked or last:
            yield state("experiments.moves-blocked", legs=[*(f"{k + 1} to {k + 2}" for k in tour.blocked), *last])
        elif plan.keeps_height:
            yield state("experiments.moves-clear", bodies=bodies)
        else:
            yield state("experiments.moves-clear-unmounted", bodies=bodies)
        sides = zip(plan.robot.joint_names, tour.sides, strict=True)
        if joints := [name for name, share in sides if share in (0.0, 1.0)]:
            yield state("experiments.one-sided", joints=joints)
    if plan.second:
        yield state("experiments.second-arm")


def _open(plan: MeasurementPlan) -> Iterator[Statement]:
    """What is not checked, and what no posture can separate."""
    yield state("experiments.run-slowly")
    for what in plan.undetermined:
        yield state("experiments.inseparable", what=what)
