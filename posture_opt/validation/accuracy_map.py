"""Errors of an arm without its corrections and its scatter over a grid of targets, beside measured rows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.calibration.assumptions.frames import arm_and_data, fit_frames
from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.calibration.cross_validation import position_errors
from posture_opt.calibration.estimation.starting_values import kabsch
from posture_opt.encoding import Encoded
from posture_opt.errors import InputError, Issue
from posture_opt.interrupts import interruptible
from posture_opt.measurements.measurements import Measurements, nominal_poses
from posture_opt.numerics import Array, Codes, Mask, Progress, rms
from posture_opt.result import Result
from posture_opt.robot.robot import Robot
from posture_opt.selection.maps.grid_layout import Grid, Plane
from posture_opt.selection.maps.map_points import MapPoint
from posture_opt.selection.maps.target_map import TargetMap, map_targets
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.clearance import central_radii
from posture_opt.uncertainty.regions import coverage_factor
from posture_opt.uncertainty.spread import ellipse_basis
from posture_opt.uncertainty.tool_point import ToolPoint
from posture_opt.validation.coverage import squared_distances
from posture_opt.workers import Executor


@dataclass(frozen=True, eq=False)
class MeasuredErrors(Encoded):
    """Measured rows compared with what is predicted where they lie."""

    place: Array  # (M, 3) tool point of the rows by the model [m], world
    cell: Codes  # (M,) the target in whose cell each lies; -1 for none
    near: Mask  # (M,) whether they lie in a cell that has a prediction
    # uncorrected, corrected: (M,) distance of the measured from the modelled tool point [m], by the arm without its
    # corrections and as the file states it
    uncorrected: Array
    corrected: Array
    # (M,) distance that 95 % of all rows should keep in the cell, the instrument's part included [m]; NaN off the map
    limit: Array
    inside: Mask  # (M,) whether a row lies in the 95 % region that is predicted for its own posture
    # whether the rows show all of the error: not where they touch points, or where frames are fitted to them
    comparable: bool
    reach: float  # rows count as near the map within this distance of its plane [m]; 0 where all lie in it
    remarks: tuple[Statement, ...] = ()  # what the rows are, and why they may not be comparable

    @property
    def statements(self) -> Iterator[Statement]:
        """How many rows lie within what is predicted, for their own postures and on the map."""
        rows, near = len(self.cell), int(self.near.sum())
        if self.comparable:
            verdict = f"-{self.verdict}" if self.verdict else ""
            yield state(f"validation.rows-in-region{verdict}", share=Quantity(self.share, "share"), rows=rows)
            if near:
                yield state("validation.rows-in-cells", share=Quantity(self.share_near, "share"), rows=near)
            else:
                yield state("validation.rows-off-map")
        yield from self.remarks

    @property
    def verdict(self) -> str:
        """``understated`` or ``overstated``: the share in the regions is further from 95 % than chance takes it.

        ``|share − 0.95| > 4 sqrt(0.95 · 0.05 / rows)``: neighbouring postures err alike, so that rows count for fewer
        than they are. Empty otherwise, and with fewer than 20 rows.
        """
        rows = len(self.cell)
        # 20 rows: fewer say little about a share of 95 %
        if rows < 20 or abs(self.share - 0.95) <= 4 * math.sqrt(0.95 * 0.05 / rows):
            return ""
        return "understated" if self.share < 0.95 else "overstated"

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

    def fields_json(self) -> dict[str, object]:
        return {
            "rows": len(self.cell),
            "rows_near": self.near.sum(),
            "near_within": self.reach,
            "share_within_95_of_cell": self.share_near,
            "share_within_95_of_own_posture": self.share,
            "rms_uncorrected": rms(self.uncorrected),
            "rms": rms(self.corrected),
            "notes": [remark.text for remark in self.remarks],
        }


def measured_errors(
    problem: ProblemData, uncorrected: ProblemData, data: Measurements, targets: TargetMap,
    projected: Array, tool_point: ToolPoint,
) -> MeasuredErrors:  # fmt: skip
    """The rows of the first target, their errors by both arms, and what is predicted for them.

    projected (N, m, m) predicted covariance at the targets [m²]; NaN where there is no posture.
    """
    if data.position is None and not data.touches:
        message = f"a map predicts positions, and these rows are {data.kind.noun}"
        raise InputError(Issue(message, ("--data",), hint="name rows with x, y, z", file=data.file))
    remarks = []
    if len(data.target_names) > 1:
        data = data.take(np.flatnonzero(data.target == 0))
        remarks.append(state("validation.rows-of-first-target", data.target_names[0]))
    free = [name for name, is_free in (("base", problem.robot.base_free), ("tool", problem.robot.tool_free)) if is_free]
    if data.touches:
        remarks.append(state("validation.rows-touch-points"))
    elif free:
        remarks.append(state("validation.frames-fitted-to-rows", frames=free))
    if not len(data):
        raise InputError(Issue("no row measures the tool point of this problem", ("--data",), hint="name other data"))
    # Model minus measurement (M, 3) [m], world; frames that the file leaves free are fitted to these rows.
    arms = [arm_and_data(one, data)[0] for one in (uncorrected, problem)]
    errors = [position_errors(residuals, fit_frames(residuals)) for residuals in arms]
    instrument = position_sigma(problem, data)
    place, _ = nominal_poses(problem.robot, data.q)
    cell = targets.grid.cells(place)
    limits = np.full(len(targets.map_points) + 1, np.nan)  # the last one is that of rows off the map
    used = np.flatnonzero(targets.feasible)
    limits[used] = central_radii(0.95, projected[used] + instrument**2 * np.eye(projected.shape[1]))
    inside = _inside_regions(problem.robot, tool_point, data, errors[1], instrument)
    lengths = [np.linalg.norm(e, axis=1) for e in errors]
    reach = 0.0 if len(projected[0]) < 3 else targets.grid.sides[2] / 2
    # 20 times the predicted distance: no spread is that much understated
    elsewhere = not free and not data.touches and float(np.median(lengths[1])) > 20 * np.nanmedian(limits)
    remarks += [state("validation.measured-elsewhere")] if elsewhere else []
    comparable = not data.touches and not free and not elsewhere
    near = (cell >= 0) & np.isfinite(limits[cell])
    return MeasuredErrors(
        place, cell, near, lengths[0], lengths[1], limits[cell], inside, comparable, reach, tuple(remarks)
    )


def _inside_regions(robot: Robot, tool_point: ToolPoint, data: Measurements, errors: Array, instrument: float) -> Mask:
    """(M,) whether errors (M, 3) lie in the 95 % region predicted for the rows' own postures.

    ``eᵀ (C + s² I)⁻¹ e ≤ χ²_d(0.95)`` in the d measured axes in which a spread is predicted (in the plane alone of an
    arm that moves in one), C of each row's own posture and s the instrument's σ.
    """
    moments = tool_point.moments([np.ascontiguousarray(column) for column in data.q.T])
    C = np.broadcast_to(moments.covariance, (len(data), 3, 3)) + instrument**2 * np.eye(3)
    measured = data.kind.axes(data.measured_axes)
    axes = measured[np.diagonal(C, axis1=1, axis2=2)[:, measured].min(axis=0) > 0]
    C, e = C[:, axes][:, :, axes], errors[:, axes]
    return np.asarray(squared_distances(e, C) <= coverage_factor(0.95, len(axes)) ** 2)


_UNCOVERED_SHARE = 0.02  # of the rows, on either side, that the map need not cover
_BOX_STEP_M = 0.01  # m, that its box is rounded to


@dataclass(frozen=True, eq=False, repr=False)
class AccuracyMap(Result):
    """Bias and spread of the arm at every target of a grid, in the posture that the task takes there.

    Args:
        problem: with the corrections and effects of the arm.
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

    problem: ProblemData
    targets: TargetMap
    corrections: int
    effects: int
    bias: Array
    covariance: Array
    basis: Array
    radius95: Array
    semi_axes95: Array
    settled: Array
    own: tuple[Array, float] | None
    measured: MeasuredErrors | None

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """What is off without corrections, what scatters with them, and how that compares with measured rows."""
        most, least = Quantity(float(np.nanmax(self.distance))), Quantity(float(np.nanmin(self.distance)))
        bias = (
            state("validation.map-bias", most=most, least=least)
            if self.corrected
            else state("validation.map-uncorrected", most=most)
        )
        ends = {name: Quantity(float(of(self.radius95))) for name, of in (("most", np.nanmax), ("least", np.nanmin))}
        without, targets = int(np.count_nonzero(~self.targets.feasible)), len(self.targets.map_points)
        missing = [state("validation.targets-without-posture", without=without, targets=targets)] if without else []
        measured = () if self.measured is None else self.measured.statements
        return (bias, state("validation.map-radius", "", **ends), *missing, *measured)

    @property
    def grid(self) -> Grid:
        """The targets."""
        return self.targets.grid

    @cached_property
    def distance(self) -> Array:
        """(N,) length of the bias [m]."""
        return np.asarray(np.linalg.norm(self.bias, axis=1))

    def fields_json(self) -> dict[str, object]:
        """The document ``map.json``: SI units, finite numbers only."""
        joints, entries = self.targets.optimisation_problem.robot.joint_names, list[object]()
        for k, point in enumerate(self.targets.map_points):
            document, values = point.to_json(joints), ("bias", "covariance", "semi_axes95")
            entry = {key: document[key] for key in ("position", "feasible", "reason", "posture")}
            entry |= {name: getattr(self, name)[k] if point.feasible else None for name in values}
            entries.append({**entry, "radius95": self.radius95[k]})
        return {
            "name": self.targets.problem.name,
            "task": self.targets.optimisation_problem.task.kind,
            "quantity": "accuracy",
            "direction": self.targets.target.direction,
            "corrections": self.corrections,
            "effects": self.effects,
            "own": None if self.own is None else {"bias": self.own[0], "radius95": self.own[1]},
            "grid": self.grid,
            "targets": entries,
            "measured": self.measured,
            "seconds": self.targets.seconds,
            "notes": [str(note) for note in self.targets.notes],
        }

    @property
    def corrected(self) -> bool:
        """Whether the file corrects the arm at all: else the bias is the second-order shift of the mean."""
        return self.corrections + self.effects > 0


@interruptible()
def map_accuracy(
    problem: ProblemData,
    data: Measurements | None = None,
    *,
    counts: tuple[int, ...] | None = None,
    low: tuple[float, float, float] | None = None,
    high: tuple[float, float, float] | None = None,
    plane: Plane | None = None,
    seed: int | None = None,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> AccuracyMap:
    """Errors of an arm that is driven without its corrections, mean and scatter, over a grid of targets.

    The posture at a target is the one that the task takes there by the arm without corrections and effects. With the
    forward models f of the corrected and f₀ of the uncorrected arm, ``f₀(q) = target`` and the bias is
    ``E f(q) − target``.
    Without corrections that leaves the second-order shift of the mean.

    Args:
        problem: a task, and an arm with corrections or effects.
        data: measurements, to be set against what is predicted; with them the map covers where they lie.
        counts, low, high, plane, seed, workers, executor, progress: as of `map_targets`.

    Returns:
        ``AccuracyMap``: of each of the ``targets`` the expected error ``bias`` [m], the ``covariance`` [m²] and
        ``radius95`` [m]; ``to_dataframe()`` has a row a point.

    Raises:
        InputError, NoSolutionError: as `map_targets`; measurements of several robots.

    Example:
        >>> import posture_opt as po
        >>> problem = po.load_problem("insert_planar_2r_calibrated")
        >>> found = po.map_accuracy(problem, counts=(2, 2, 1), low=(1.0, 0.2, 0.0), high=(1.2, 0.4, 0.0))
        >>> found.bias.shape, bool((found.radius95 > 0).all())
        ((4, 3), True)
    """
    uncorrected = problem.uncorrected
    if data is not None and low is None and high is None and plane is None:
        low, high = _box_of(problem, data)
    targets = map_targets(
        uncorrected,
        counts=counts,
        low=low,
        high=high,
        plane=plane,
        seed=seed,
        workers=workers,
        executor=executor,
        progress=progress,
    )
    tool_point = ToolPoint.of(problem.arm, problem.sources)
    bias, covariance = _predicted_moments(tool_point, targets.map_points)
    known = targets.feasible
    basis = ellipse_basis(tool_point, covariance[known][0])
    radius, semi_axes = np.full(len(bias), np.nan), np.full((len(bias), len(basis)), np.nan)
    projected = basis @ covariance @ basis.T
    semi_axes[known] = coverage_factor(0.95, len(basis)) * np.sqrt(np.linalg.eigvalsh(projected[known]).clip(0))
    radius[known] = central_radii(0.95, projected[known])
    own = None
    if targets.own is not None and targets.own.feasible:
        (at,), C = _predicted_moments(tool_point, (targets.own,))
        own = at, float(central_radii(0.95, basis @ C @ basis.T)[0])
    measured = None if data is None else measured_errors(problem, uncorrected, data, targets, projected, tool_point)
    known_of_arm = len(problem.corrections), len(problem.arm.effects)
    settled, points = np.full(len(bias), np.nan), targets.grid.points[known]
    if np.count_nonzero(known) > 2:  # two points determine no motion of the base
        landed = points + bias[known]
        R, t = kabsch(landed, points)
        settled[known] = np.linalg.norm(landed @ R.T + t - points, axis=1)
    return AccuracyMap(
        problem, targets, *known_of_arm, bias, covariance, basis, radius, semi_axes, settled, own, measured
    )


def _predicted_moments(tool_point: ToolPoint, map_points: Sequence[MapPoint]) -> tuple[Array, Array]:
    """Bias (N, 3) [m] and covariance (N, 3, 3) [m²]; NaN where there is no posture."""
    known, count = np.array([map_point.feasible for map_point in map_points]), len(map_points)
    Q = np.array([map_point.q for map_point in map_points])[known]
    moments = tool_point.moments([np.ascontiguousarray(column) for column in Q.T])
    bias, covariance = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    bias[known] = moments.mean - np.array([map_point.position for map_point in map_points])[known]
    covariance[known] = moments.covariance
    return bias, covariance


def _box_of(
    problem: ProblemData, data: Measurements
) -> tuple[tuple[float, float, float] | None, tuple[float, float, float] | None]:
    task = problem.task
    if task is None or task.region is not None:
        return None, None
    d = np.array(task.direction) / np.linalg.norm(task.direction)
    axis = int(np.argmax(np.abs(d)))
    if abs(d[axis]) < 1 - 1e-9:
        return None, None
    place, _ = nominal_poses(problem.robot, data.q)
    low, high = np.quantile(place, [_UNCOVERED_SHARE, 1 - _UNCOVERED_SHARE], axis=0)
    low, high = _BOX_STEP_M * np.floor(low / _BOX_STEP_M), _BOX_STEP_M * np.ceil(high / _BOX_STEP_M)
    if np.count_nonzero(np.ptp(place, axis=0) > _BOX_STEP_M) == 3:
        level = float(np.median(place[:, axis]))
        if task.position is not None and low[axis] <= task.position[axis] <= high[axis]:
            level = task.position[axis]
        low[axis] = high[axis] = level
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])
