"""``map_accuracy``: errors of the arm without its corrections, and how it scatters, over a grid of targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.calibration.estimation.starting_values import kabsch
from posture_opt.interrupts import interruptible
from posture_opt.measurements.measurements import Measurements, nominal_poses
from posture_opt.numerics import Array, Json, Progress, finite_or_none
from posture_opt.result import Result
from posture_opt.selection.maps.grid_layout import Plane
from posture_opt.selection.maps.map_points import Grid, MapPoint
from posture_opt.selection.maps.target_map import TargetMap, map_targets
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.regions.coverage_radius import central_radii
from posture_opt.uncertainty.regions.regions import coverage_factor
from posture_opt.uncertainty.spread.spread import ellipse_basis
from posture_opt.validation.measured_errors import MeasuredErrors, measured_errors
from posture_opt.workers import Executor

_ALIGNMENT_TOLERANCE = 1e-9
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

    def fields_json(self) -> dict[str, Json]:
        """The document ``map.json``: SI units, finite numbers only."""
        joints = self.targets.optimisation_problem.robot.joint_names
        return {
            "name": self.targets.problem.name,
            "task": self.targets.optimisation_problem.task.kind,
            "quantity": "accuracy",
            "direction": self.targets.target.direction.tolist(),
            "corrections": self.corrections,
            "effects": self.effects,
            "own": None if self.own is None else {"bias": self.own[0].tolist(), "radius95": self.own[1]},
            "grid": self.grid.to_json(),
            "targets": [self._target(k, map_point, joints) for k, map_point in enumerate(self.targets.map_points)],
            "measured": None if self.measured is None else self.measured.to_json(),
            "seconds": self.targets.seconds,
            "notes": [str(note) for note in self.targets.notes],
        }

    def _target(self, k: int, map_point: MapPoint, joints: tuple[str, ...]) -> dict[str, Json]:
        """The entry of one target under ``targets``: bias [m], covariance [m²], the 95 % region and the posture [rad or
        m].
        """
        document = map_point.to_json(joints)
        kept = {key: document[key] for key in ("position", "feasible", "reason")}
        return {
            **kept,
            "bias": self.bias[k].tolist() if map_point.feasible else None,
            "covariance": self.covariance[k].tolist() if map_point.feasible else None,
            "semi_axes95": self.semi_axes95[k].tolist() if map_point.feasible else None,
            "radius95": finite_or_none(float(self.radius95[k])),
            "posture": document["posture"],
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
    settled = _bias_without_shift(targets.grid.points, bias)
    return AccuracyMap(
        problem, targets, *known_of_arm, bias, covariance, basis, radius, semi_axes, settled, own, measured
    )


def _bias_without_shift(points: Array, bias: Array) -> Array:
    """(N,) [m] the bias that no shift and turn of the base would take off; NaN where there is no posture.

    A rigid motion of the base is the best fit of landed to wanted points (`kabsch`); two points determine none.
    """
    left, known = np.full(len(points), np.nan), np.isfinite(bias[:, 0])
    if np.count_nonzero(known) > 2:
        landed = points[known] + bias[known]
        R, t = kabsch(landed, points[known])
        left[known] = np.linalg.norm(landed @ R.T + t - points[known], axis=1)
    return left


def _predicted_moments(tool_point: ToolPoint, map_points: Sequence[MapPoint]) -> tuple[Array, Array]:
    """Bias (N, 3) [m] and covariance (N, 3, 3) [m²]; NaN where there is no posture.

    Args:
        tool_point: moments of the corrected arm; map_points: N targets with their postures.
    """
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
    """Corners of a flat box, across the direction, that holds most of the rows; None where the file says more.

    Most means all but `_UNCOVERED_SHARE` on each side, rounded outwards to `_BOX_STEP_M`.
    """
    task = problem.task
    if task is None or task.region is not None:
        return None, None
    d = np.array(task.direction) / np.linalg.norm(task.direction)
    axis = int(np.argmax(np.abs(d)))
    if abs(d[axis]) < 1 - _ALIGNMENT_TOLERANCE:
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
