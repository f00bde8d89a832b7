"""``MeasurementPlan``: which postures to measure next, and what they are expected to show."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.encoding import encoded
from posture_opt.experiments.candidate_postures import Workspace
from posture_opt.experiments.information import ExpectedErrors
from posture_opt.experiments.plan_search import Tour
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Mask
from posture_opt.result import Result
from posture_opt.robot.posture import Posture
from posture_opt.robot.robot import Joint, Robot
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Quantity, Statement, state
from posture_opt.texts import csv_line
from posture_opt.uncertainty.clearance import PARTS

Purpose = Literal["parameters", "task", "recheck"]
INSTRUMENT = "instrument"
"""Column that says which instrument measured a row."""
_WRITTEN = {"revolute": ("deg", math.degrees(1.0)), "prismatic": ("mm", 1e3)}


@dataclass(frozen=True, eq=False)
class Target:
    """The posture whose tool point a plan serves, and the directions (t, 3) along which its error counts."""

    q: Array  # (n,) the posture [rad or m]
    basis: Array  # (t, 3) orthonormal directions, world; ``within`` names them: ``across``, ``along`` or ``all``
    within: str


@dataclass(frozen=True, eq=False)
class SecondJoint:
    """A joint of a second arm, which the tool touches."""

    name: str  # ``ARM.JOINT``
    joint: Joint
    values: Array  # (count,) at each posture [rad or m]; NaN where another instrument is used


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
        columns: column of the file -> (count,) its values: the plane, anchor, point or camera of each posture,
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
        mounting = self.workspace.scene.mounting_statement(self.q)
        floor = (state("experiments.table-unstated"),) * (not self.keeps_height)
        surface = (*((mounting,) if mounting else ()), *floor)
        undetermined = (state("experiments.inseparable", what=what) for what in self.undetermined)
        slowly = state("experiments.run-slowly")
        answer = _worth(self), *surface, *_task_error(self)
        return (*answer, *tour_statements(self), *self.remarks, slowly, *undetermined)

    @property
    def listed(self) -> list[int]:
        """Indices of the parameters that can be determined and are not as good as exact already."""
        # 1e-7 m, rad: rounding of a covariance in which parameters are correlated
        return np.flatnonzero(self.settled & ~(self.before.std < 1e-7)).tolist()

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
        joints = [*self.robot.joints]
        headers = [f"{joint.name} [{_WRITTEN[joint.type][0]}]" for joint in joints]
        headers += ["pose"] * (self.repeats > 1) + ["target"] * bool(self.targets)
        headers += [f"{one.name} [{_WRITTEN[one.joint.type][0]}]" for one in self.second]
        headers += dict.fromkeys((*self.columns, *self.columns_by_row))
        lines = [csv_line(headers)]
        for _ in range(self.repeats):
            for k, row in enumerate(self.q):
                cells = [_written(joint, value) for joint, value in zip(joints, row, strict=True)]
                cells += [str(k + 1)] * (self.repeats > 1)
                second = [_written(one.joint, one.values[k]) for one in self.second]
                for target in [[name] for name in self.targets] or [[]]:
                    lines += [csv_line([*cells, *target, *second, *more]) for more in self._rows_beside(k)]
        return "\n".join(lines) + "\n"

    def _rows_beside(self, k: int) -> list[tuple[str, ...]]:
        by_row = {name: cells[k] for name, cells in self.columns_by_row.items()}
        count = max(map(len, by_row.values()), default=1)
        every = {name: (cells[k],) * count for name, cells in self.columns.items()} | by_row
        return [*zip(*every.values(), strict=True)] or [()]

    def fields_json(self) -> dict[str, object]:
        """The document ``plan.json``: SI units and radians."""
        stages = {"before": self.before, "after": self.after, "random": self.random}
        rows = enumerate(zip(self.postures, self.points, strict=True))
        own = [s.text for s in self.statements if s in self.remarks or s.id == "experiments.table-unstated"]
        task: dict[str, object] | None = None
        if self.target is not None:
            posture = dict(zip(self.robot.joint_names, self.target.q, strict=True))
            task = {"posture": posture, "std": {name: stage.task for name, stage in stages.items()}}
        return {
            "purpose": self.purpose,
            "count": len(self.q),
            "repeats": self.repeats,
            "given": len(self.given) if self.given is not None else 0,
            "postures": [{"posture": q, "tool": point, **self._beside(k)} for k, (q, point) in rows],
            **encoded(self, "gain random_equivalent=equivalent"),
            "parameters": [
                {"name": p.name, "unit": p.unit, **{name: stage.std[i] for name, stage in stages.items()}}
                for i, p in enumerate(self.parameters)
            ],
            "observability": {name: stage.observability for name, stage in stages.items()},
            "task": task,
            **encoded(self, "undetermined travel=tour.travel"),
            "blocked": [k + 1 for k in self.tour.blocked],
            "notes": [*self.notes, *own],
        }

    def _beside(self, k: int) -> dict[str, object]:
        """What else the document says of a posture: instrument, place, joints of a second arm [rad or m]."""
        found: dict[str, object] = {}
        for name, cells in (("instrument", self.instruments), ("place", self.places)):
            found |= {name: cells[k]} if cells and cells[k] else {}
        second = {one.name: one.values[k] for one in self.second if np.isfinite(one.values[k])}
        return {**found, "second": second} if second else found


def _written(joint: Joint, value: float) -> str:
    """A joint value [rad or m] in deg or mm; empty where the arm is not used."""
    return f"{value * _WRITTEN[joint.type][1] + 0.0:.2f}" if math.isfinite(value) else ""


def _worth(plan: MeasurementPlan) -> Statement:
    count = len(plan.q)
    if plan.equivalent is None:
        return state("experiments.worth-more", postures=count, random=plan.tried, purpose=plan.purpose)
    if plan.equivalent <= count:
        return state("experiments.worth-as-many", postures=count, purpose=plan.purpose)
    return state("experiments.worth", postures=count, random=plan.equivalent, purpose=plan.purpose)


def _task_error(plan: MeasurementPlan) -> Iterator[Statement]:
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
    if len(plan.q) > 1 and not plan.robot.pose_prefix:  # a flange has no joints to move
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
