"""``map_accuracy``: where the arm lands without its corrections, and how it scatters, over a grid of targets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.diagnosis.comparison import compare, fit_frames
from posture_opt.diagnosis.cross_validation import position_errors
from posture_opt.diagnosis.measurements import Measurements
from posture_opt.diagnosis.nominal import nominal_poses
from posture_opt.diagnosis.start import kabsch
from posture_opt.errors import InputError, Issue
from posture_opt.problem.problem import Problem
from posture_opt.robot.robot import Robot
from posture_opt.selection.grid import Grid, Plane
from posture_opt.selection.multistart import Progress
from posture_opt.selection.target_map import Spot, TargetMap, map_targets
from posture_opt.uncertainty.ball import central_radii
from posture_opt.uncertainty.regions import coverage_factor
from posture_opt.uncertainty.spread import ellipse_basis
from posture_opt.uncertainty.tool_point import ToolPoint
from posture_opt.uncertainty.validity import finite_or_none

Floats = np.ndarray
_ALIGNED = 1e-9
_OUTER = 0.02  # of the rows, on either side, that the map need not cover
_ELSEWHERE = 20  # times the predicted distance: no spread is that much understated
_STEP = 0.01  # m, that its box is rounded to

TOUCHES = (
    "touched points tell how well touches agree, not where the arm stands: errors count from the mean of each point, "
    "and no share of them can be set against the predicted distances"
)
FITTED = (
    "free and fitted to these rows: what that takes off their errors is still in the prediction, and no share of "
    "them can be set against it"
)
ELSEWHERE = (
    "so far off, base, tool or instrument were not where the file has them when these rows were measured: calibrate "
    "with them, or leave base and tool free"
)


@dataclass(frozen=True, eq=False)
class MeasuredErrors:
    """Measured rows beside what is predicted where they lie.

    Args:
        place: (M, 3) tool point of the rows by the model [m], world.
        cell: (M,) the target in whose cell each lies; -1 for none.
        near: (M,) whether they lie in a cell that has a prediction.
        uncorrected, corrected: (M,) distance of the measured from the modelled tool point [m], by the arm without
            its corrections and as it stands in the file.
        limit: (M,) distance that 95 % of all rows should keep in the cell, the instrument's part included [m]; NaN
            off the map.
        inside: (M,) whether a row lies in the 95 % region that is predicted for its own posture.
        comparable: whether the rows tell all of the error: not where they touch points, or where frames are fitted
            to them.
        reach: rows count as near the map within this distance of its plane [m]; 0 where all lie in it.
        notes: sentences for the report.
    """

    place: Floats
    cell: Floats
    near: Floats
    uncorrected: Floats
    corrected: Floats
    limit: Floats
    inside: Floats
    comparable: bool
    reach: float
    notes: tuple[str, ...] = ()

    @property
    def share_near(self) -> float:
        """Share of the near rows within the distance predicted for their cell; NaN for none, or if not comparable."""
        near = self.near
        known = near.any() and self.comparable
        return float(np.mean(self.corrected[near] <= self.limit[near])) if known else math.nan

    @property
    def share(self) -> float:
        """Share of all rows in the 95 % region that is predicted for their own posture; NaN if not comparable."""
        return float(np.mean(self.inside)) if self.comparable else math.nan

    def to_json(self) -> dict[str, Any]:
        """Counts, shares, and lengths [m]."""
        rms = {name: float(np.sqrt(np.mean(e**2))) for name, e in (("un", self.uncorrected), ("", self.corrected))}
        return {
            "rows": len(self.cell),
            "rows_near": int(self.near.sum()),
            "near_within": self.reach,
            "share_within_95_of_cell": finite_or_none(self.share_near),
            "share_within_95_of_own_posture": finite_or_none(self.share),
            "rms_uncorrected": rms["un"],
            "rms": rms[""],
            "notes": list(self.notes),
        }


@dataclass(frozen=True, eq=False)
class AccuracyMap:
    """Bias and spread of the arm at every target of a grid, in the posture that the task takes there.

    Args:
        targets: the postures of the arm without corrections: what its controller would command.
        corrections: number of parameters that the file corrects; ``effects`` of effects that it knows.
        bias: (N, 3) mean tool point of the arm in the file minus the target, world [m]; NaN without a posture.
        covariance: (N, 3, 3) of the tool point [m²].
        basis: (2, 3) the plane of a planar arm, else (3, 3).
        radius95: (N,) distance from their mean that 95 % of all tool points keep [m].
        semi_axes95: (N, m) of the 95 % region, ascending [m].
        settled: (N,) what would be left of the bias if the base were shifted and turned to suit the map [m].
        own: bias (3,) and radius95 [m] at the position in the file; None without one, or without a posture there.
        measured: measured rows, where there are data.
    """

    targets: TargetMap
    corrections: int
    effects: int
    bias: Floats
    covariance: Floats
    basis: Floats
    radius95: Floats
    semi_axes95: Floats
    settled: Floats
    own: tuple[Floats, float] | None
    measured: MeasuredErrors | None

    @property
    def grid(self) -> Grid:
        """The targets."""
        return self.targets.grid

    @cached_property
    def distance(self) -> Floats:
        """(N,) length of the bias [m]."""
        return np.asarray(np.linalg.norm(self.bias, axis=1))

    def to_json(self) -> dict[str, Any]:
        """The document ``map.json``: SI units, finite numbers only."""
        joints = self.targets.programme.robot.joint_names
        return {
            "name": self.targets.problem.name,
            "task": self.targets.programme.task.kind,
            "quantity": "accuracy",
            "direction": self.targets.goal.direction.tolist(),
            "corrections": self.corrections,
            "effects": self.effects,
            "own": None if self.own is None else {"bias": self.own[0].tolist(), "radius95": self.own[1]},
            "grid": self.grid.to_json(),
            "targets": [self._target(k, spot, joints) for k, spot in enumerate(self.targets.spots)],
            "measured": None if self.measured is None else self.measured.to_json(),
            "seconds": self.targets.seconds,
            "notes": list(self.targets.notes),
        }

    def _target(self, k: int, spot: Spot, joints: tuple[str, ...]) -> dict[str, Any]:
        kept = {key: value for key, value in spot.to_json(joints).items() if key in ("position", "feasible", "reason")}
        return {
            **kept,
            "bias": self.bias[k].tolist() if spot.feasible else None,
            "covariance": self.covariance[k].tolist() if spot.feasible else None,
            "semi_axes95": self.semi_axes95[k].tolist() if spot.feasible else None,
            "radius95": finite_or_none(float(self.radius95[k])),
            "posture": spot.to_json(joints)["posture"],
        }

    def plot(self) -> Any:
        """File name -> matplotlib figure: the bias, where there are corrections, and the spread."""
        from posture_opt.report.figures.accuracy import accuracy_figures

        return accuracy_figures(self)

    @property
    def corrected(self) -> bool:
        """Whether the file corrects the arm at all: else the bias is the second-order shift of the mean."""
        return self.corrections + self.effects > 0


def map_accuracy(
    problem: Problem,
    data: Measurements | None = None,
    *,
    counts: tuple[int, ...] | None = None,
    low: tuple[float, float, float] | None = None,
    high: tuple[float, float, float] | None = None,
    plane: Plane | None = None,
    seed: int | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> AccuracyMap:
    """Where an arm lands that is driven without its corrections, and how it scatters, over a grid of targets.

    The posture at a target is the one that the task takes there by the arm without corrections and effects. With the
    forward models f of the corrected and f₀ of the uncorrected arm, ``f₀(q) = target`` and the bias is
    ``E f(q) − target``.
    Without corrections that leaves the second-order shift of the mean.

    Args:
        data: measurements, to be set against what is predicted; with them the map covers where they lie.
        counts, low, high, plane, seed, workers, progress: as of `map_targets`.

    Raises:
        InputError, NoSolutionError: as `map_targets`; measurements of several robots.
    """
    nominal = problem.spec.robot.nominal(problem.folder)
    uncorrected = replace(problem, robot=nominal)
    if data is not None and low is None and high is None and plane is None:
        low, high = _box_of(problem, data)
    targets = map_targets(
        uncorrected, counts=counts, low=low, high=high, plane=plane, seed=seed, workers=workers, progress=progress
    )
    tool_point = ToolPoint.of(problem.robot, problem.sources)
    bias, covariance = _predicted(tool_point, targets.spots)
    known = targets.feasible
    basis = ellipse_basis(tool_point, covariance[known][0])
    radius, semi_axes = np.full(len(bias), np.nan), np.full((len(bias), len(basis)), np.nan)
    projected = basis @ covariance @ basis.T
    semi_axes[known] = coverage_factor(0.95, len(basis)) * np.sqrt(np.linalg.eigvalsh(projected[known]).clip(0))
    radius[known] = central_radii(0.95, projected[known])
    own = None
    if targets.own is not None and targets.own.feasible:
        (at,), C = _predicted(tool_point, (targets.own,))
        own = at, float(central_radii(0.95, basis @ C @ basis.T)[0])
    measured = None if data is None else _measured(problem, uncorrected, data, targets, projected, tool_point)
    known_of_arm = len(problem.spec.robot.corrections), len(problem.effects)
    settled = _settled(targets.grid.points, bias)
    return AccuracyMap(targets, *known_of_arm, bias, covariance, basis, radius, semi_axes, settled, own, measured)


def _settled(points: Floats, bias: Floats) -> Floats:
    """(N,) [m] the bias that no shift and turn of the base would take off; NaN where there is no posture."""
    left, known = np.full(len(points), np.nan), np.isfinite(bias[:, 0])
    if np.count_nonzero(known) > 2:
        landed = points[known] + bias[known]
        R, t = kabsch(landed, points[known])
        left[known] = np.linalg.norm(landed @ R.T + t - points[known], axis=1)
    return left


def _predicted(tool_point: ToolPoint, spots: Sequence[Spot]) -> tuple[Floats, Floats]:
    """Bias (N, 3) [m] and covariance (N, 3, 3) [m²]; NaN where there is no posture."""
    known, count = np.array([spot.feasible for spot in spots]), len(spots)
    Q = np.array([spot.q for spot in spots])[known]
    moments = tool_point.moments([np.ascontiguousarray(column) for column in Q.T])
    bias, covariance = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    bias[known] = moments.mean - np.array([spot.position for spot in spots])[known]
    covariance[known] = moments.covariance
    return bias, covariance


def _box_of(
    problem: Problem, data: Measurements
) -> tuple[tuple[float, float, float] | None, tuple[float, float, float] | None]:
    """Corners of a flat box, across the direction, that holds most of the rows; None where the file says more."""
    task = problem.task
    if task is None or task.region is not None:
        return None, None
    d = np.array(task.direction) / np.linalg.norm(task.direction)
    axis = int(np.argmax(np.abs(d)))
    if abs(d[axis]) < 1 - _ALIGNED:
        return None, None
    place, _ = nominal_poses(problem.robot, data.q)
    low, high = np.quantile(place, [_OUTER, 1 - _OUTER], axis=0)
    low, high = _STEP * np.floor(low / _STEP), _STEP * np.ceil(high / _STEP)
    if np.count_nonzero(np.ptp(place, axis=0) > _STEP) == 3:
        level = float(np.median(place[:, axis]))
        if task.position is not None and low[axis] <= task.position[axis] <= high[axis]:
            level = task.position[axis]
        low[axis] = high[axis] = level
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def _measured(
    problem: Problem, uncorrected: Problem, data: Measurements, targets: TargetMap, projected: Floats,
    tool_point: ToolPoint,
) -> MeasuredErrors:  # fmt: skip
    """The rows of the first target, their errors by both arms, and what is predicted for them."""
    notes = []
    if len(data.target_names) > 1:
        data = data.take(np.flatnonzero(data.target == 0))
        notes.append(f"only rows of the target {data.target_names[0]} are compared")
    free = [name for name, is_free in (("base", problem.robot.base_free), ("tool", problem.robot.tool_free)) if is_free]
    if data.touches:
        notes.append(TOUCHES)
    elif free:
        notes.append(f"{' and '.join(free)} {'is' if len(free) == 1 else 'are'} {FITTED}")
    if not len(data):
        raise InputError(Issue("no row measures the tool point of this problem", ("--data",), mend="name other data"))
    errors = [_errors(one, data) for one in (uncorrected, problem)]
    instrument = problem.measurement.position if problem.measurement is not None else 0.0
    place, _ = nominal_poses(problem.robot, data.q)
    cell = targets.grid.cells(place)
    limits = np.full(len(targets.spots) + 1, np.nan)  # the last one is that of rows off the map
    used = np.flatnonzero(targets.feasible)
    limits[used] = central_radii(0.95, projected[used] + instrument**2 * np.eye(projected.shape[1]))
    inside = _inside(problem.robot, tool_point, data, errors[1], instrument)
    lengths = [np.linalg.norm(e, axis=1) for e in errors]
    reach = 0.0 if len(projected[0]) < 3 else targets.grid.sides[2] / 2
    elsewhere = not free and not data.touches and float(np.median(lengths[1])) > _ELSEWHERE * np.nanmedian(limits)
    notes += [ELSEWHERE] if elsewhere else []
    comparable = not data.touches and not free and not elsewhere
    near = (cell >= 0) & np.isfinite(limits[cell])
    return MeasuredErrors(
        place, cell, near, lengths[0], lengths[1], limits[cell], inside, comparable, reach, tuple(notes)
    )


def _errors(problem: Problem, data: Measurements) -> Floats:
    """(M, 3) model minus measurement [m]; frames that the file leaves free are fitted."""
    residuals, _ = compare(problem, data)
    return position_errors(residuals, fit_frames(problem.robot, residuals))


def _inside(robot: Robot, tool_point: ToolPoint, data: Measurements, errors: Floats, instrument: float) -> Floats:
    """(M,) whether errors (M, 3) lie in the 95 % region predicted for the rows' own postures."""
    moments = tool_point.moments([np.ascontiguousarray(column) for column in data.q.T], complete=False)
    C = np.broadcast_to(moments.covariance, (len(data), 3, 3)) + instrument**2 * np.eye(3)
    axes = np.flatnonzero(data.measured_axes) if data.position is not None else np.arange(3)
    C, e = C[:, axes][:, :, axes], errors[:, axes]
    squared = np.einsum("ni,ni->n", e, np.linalg.solve(C, e[..., None])[..., 0])
    return np.asarray(squared <= coverage_factor(0.95, len(axes)) ** 2)
