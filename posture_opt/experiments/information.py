"""What measurements at any posture would say about an arm, and what is known of it already.

The information of a measurement with the whitened derivatives A (b, k) is ``AᵀA``: the inverse of the covariance of
the k unknowns that it alone would leave. It adds up over measurements.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from posture_opt.calibration.assumptions.frames import (
    DEFAULT_SIGMA_M,
    arm_and_data,
    fit_frames,
    held_length,
    unknown_parameters,
)
from posture_opt.calibration.assumptions.instrument import (
    further_sigmas,
    planned_sigma,
    position_sigma,
    reading_sigmas,
    usable_share,
)
from posture_opt.calibration.estimation.fit import estimate_parameters
from posture_opt.calibration.estimation.fit_setup import determine_directions
from posture_opt.calibration.estimation.least_squares import triangular_factor
from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.calibration.estimation.tolerances import widths_of_data
from posture_opt.experiments.planned_instrument import planned_places
from posture_opt.experiments.planned_kind import KindPlaces
from posture_opt.measurements.measurements import Measurements, nominal_poses, reach_of, still_axes
from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array, Mask
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.sources.sources import Sources

OF_PLACES = ("place", "second_arm")
"""Groups of parameters that belong to what is measured, and not to the arm."""
_MET_EXACTLY = 1e-18  # of the instrument's variance: rounding, which says nothing of noise
_MIN_VARIANCE_FREEDOM = 20  # degrees of freedom from which on the residual variance, not the instrument's, is believed


@dataclass(frozen=True, eq=False)
class GivenInformation:
    """What measurements made already say of the unknowns of a plan.

    Args:
        R: (m, k) square root of their information, ``RᵀR``, in units of the instrument's σ; no rows for none.
        x: (k,) deviations from nominal [rad, m] at which everything is linearised.
        variance: of a measured coordinate in units of the instrument's: what a fit to the data leaves, or where
            they do not determine it, the arm's own scatter from repeat to repeat added to the instrument's.
        rows, coordinates: how many measurements, and numbers measured in them.
        notes: sentences for the report.
    """

    R: Array
    x: Array
    variance: float
    rows: int
    coordinates: int = 0
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class MeasurementModel:
    """The measurement of all targets at one posture, measured ``repeats`` times, as a function of the posture.

    Args:
        residuals: the arm against one planned row of each target; the row says what the instrument measures.
        problem: for the noise of the instrument.
        repeats: a mean of r repeats has ``1/√r`` of the standard deviation.
        places: what an instrument measures that shows no position; None of positions.
        at: unknown of these places -> its deviation in the fit to the given rows.
        made: (k,) tolerances of manufacturing that `calibrate` takes parts to be within by the given rows; NaN of what
            has none, None without such rows.
    """

    residuals: Residuals
    problem: ProblemData
    repeats: int = 1
    places: KindPlaces | None = None
    at: Mapping[str, float] = field(default_factory=dict)
    made: Array | None = None

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The k unknowns."""
        return self.residuals.parameters

    @property
    def start(self) -> Array:
        """(k,) deviations at the arm of the file, with the places as a fit to the given rows has them [rad, m]."""
        return np.array([self.at.get(p.name, 0.0) for p in self.parameters])

    @property
    def targets(self) -> tuple[str, ...]:
        """Names of the points on the tool that are measured, of those that reach places the first; empty for one."""
        return self.residuals.data.target_names[: None if self.places is None else 1]

    @property
    def rows(self) -> int:
        """Measurements at one posture, of one repeat."""
        return max(len(self.targets), 1) * (1 if self.places is None else self.places.each)

    @property
    def coordinates(self) -> int:
        """Numbers measured at one posture, of one repeat."""
        return self.residuals.block * self.rows

    def blocks(self, q: Array, x: Array) -> Array:
        """(N, b, k) derivatives of the mean of all repeats of the postures (N, n), in standard deviations of it.

        ``b`` is `coordinates`. An instrument whose noise grows with the range is less certain at far postures.
        """
        template = self.residuals.data
        own, turned = q[:, : self.residuals.robot.n], template.rotation is not None
        data = planned_rows(self.residuals.robot, own, template.measured_axes, self.targets, oriented=turned)
        data = data if self.places is None else self.places.rows(data, q)
        _, J = self.residuals.of_data(data).residuals_and_jacobian(x)
        rows = J.reshape(len(q), self.rows, self.residuals.block, len(x)) * np.sqrt(self.repeats)
        rows = rows if self.places is None else rows * self.places.weights(q)[:, :, None, None]
        return np.asarray(self._scaled_rows(q, rows).reshape(len(q), self.coordinates, len(x)))

    def _scaled_rows(self, q: Array, rows: Array) -> Array:
        """Rows (N, targets, block, k) in the standard deviations of their own range, and as many as are usable."""
        if not self.problem.effects or self.places is not None:
            return rows
        sigma = reading_sigmas(self.problem, nominal_poses(self.residuals.robot, q)[0])
        own = np.divide(self.residuals.sigma, sigma, out=np.ones(len(q)), where=sigma > 0)
        scale = np.ones((len(q), self.residuals.block))
        scale[:, : len(self.residuals.axes)] = own[:, None]
        return np.asarray(np.sqrt(usable_share(self.problem)) * rows * scale[:, None, :, None])

    def tool_rows(self, q: Array, x: Array, basis: Array) -> Array:
        """Shift (t, k) of the (first) tool point at the posture q (n,) along ``basis``, per unit of each unknown.

        The rows of ``basis`` (t, 3) are directions about the arm as its nominal base is; they turn with a base found
        elsewhere.
        """
        data = planned_rows(self.residuals.robot, q[None], np.ones(3, dtype=bool), self.targets).take([0])
        here = self.residuals.of_data(data)
        own = [k for k, p in enumerate(self.parameters) if p.source and p.code <= 0]
        twists = here.arm.twists([self.parameters[k].source for k in own], here.q, here.walk(x), here.deviations(x))
        columns = np.zeros((3, len(x)))
        columns[:, own] = [[float(np.ravel(shift[axis])[0]) for shift, _ in twists] for axis in range(3)]
        return np.asarray(basis @ self._base_rotation(np.zeros(len(x))) @ self._base_rotation(x).T @ columns)

    def _base_rotation(self, x: Array) -> Array:
        """(3, 3) orientation of the base in the world."""
        factors = self.residuals.robot.base
        values = {p.name: float(v) for p, v in zip(self.parameters, x, strict=True) if p.group == "base"}
        return np.array(walk(factors, factor_values(factors, (), values)).columns, dtype=float).T


def planned_rows(
    robot: Robot, q: Array, axes: Mask, targets: tuple[str, ...], *, oriented: bool = False
) -> Measurements:
    """Measurements of every target at the postures q (N, n) [rad or m], with nothing measured yet: positions are zero.

    Args:
        axes: (3,) which coordinates will be measured.
        targets: names of the points on the tool; empty for one.
        oriented: whether orientations will be measured; they are the identity.
    """
    each = max(len(targets), 1)
    rows, n = len(q) * each, robot.n
    zeros = np.zeros(rows, dtype=np.intp)
    pose = np.repeat(np.arange(len(q)), each)
    rotation = np.tile([1.0, 0.0, 0.0, 0.0], (rows, 1)) if oriented else None
    return Measurements(
        joint_names=robot.joint_names, q=np.repeat(q, each, axis=0), position=np.zeros((rows, 3)), measured_axes=axes,
        rotation=rotation, pose=pose, goal=pose.copy(), target=np.tile(np.arange(each), len(q)), robot=zeros,
        point=zeros.copy(), target_names=targets, robot_names=(), point_names=(), approach=np.zeros((rows, n)),
        approach_length=np.zeros((rows, n)), payload=None, temperature=None, time=None, line=zeros.copy(),
    )  # fmt: skip


def measurement_model(
    problem: ProblemData, given: Measurements | None, repeats: int = 1
) -> tuple[MeasurementModel, tuple[str, ...]]:
    """The instrument of a problem and what it measures, and sentences on what was assumed.

    It measures what the given data have; without data, every coordinate that the arm can move.
    """
    if given is not None and given.position is None:
        return _model_of_kind(problem, given, repeats)
    robot, further = problem.robot, further_sigmas(problem)
    sigma = planned_sigma(problem, reach_of(robot)) if given is None else position_sigma(problem, given)
    notes = [] if sigma else [f"no σ of the instrument is stated: {DEFAULT_SIGMA_M * 1e3:g} mm taken"]
    axes = ~still_axes(robot) if given is None else given.measured_axes
    targets = given.target_names if given is not None and len(given.target_names) > 1 else ()
    data = planned_rows(robot, np.zeros((1, robot.n)), axes, targets, oriented=bool(further))
    parameters = unknown_parameters(problem, data)
    return MeasurementModel(
        Residuals.of(problem.arm, data, parameters, sigma or DEFAULT_SIGMA_M, further), problem, repeats
    ), tuple(notes)


def _model_of_kind(problem: ProblemData, given: Measurements, repeats: int) -> tuple[MeasurementModel, tuple[str, ...]]:
    """The instrument of the given rows, at the places that a fit to them finds."""
    residuals, notes = arm_and_data(problem, given)
    x = fit_frames(residuals)
    known = determine_directions(problem, residuals, x, held_length(residuals), priors=True)
    found = estimate_parameters(residuals, x, known.directions, known.prior, weight=known.noise)
    x, widths = found.x, known.widths
    if len(widths.own):
        widths = widths_of_data(found, widths)
    places = planned_places(residuals, x)
    at = {p.name: float(v) for p, v in zip(residuals.parameters, x, strict=True) if p.group in OF_PLACES}
    return MeasurementModel(residuals, problem, repeats, places, at, widths.uncertain), notes


def repeat_variance(problem: ProblemData, sigma: float, q: Array) -> float:
    """Mean variance of a measured coordinate at the postures (N, n) in units of the instrument's, ``sigma`` [m].

    To the instrument's comes what the arm scatters by from repeat to repeat: ``1 + tr(J V Jᵀ) / (r σ²)`` on average
    over the postures, J (3, k) the Jacobian of the tool point by the sources, V their scatter, r its axes of motion.
    """
    sources = problem.sources
    point = ToolPoint.of(problem.arm, Sources(sources.names, sources.scatter))
    if not point.names:
        return 1.0
    reached, _ = point.walk([np.ascontiguousarray(column) for column in q.T])
    J = np.broadcast_to(point.jacobian(reached), (len(q), 3, len(point.names)))
    spread = np.einsum("nij,jk,nik->n", J, point.covariance, J)
    return 1.0 + float(np.mean(spread)) / (max(int(np.sum(~still_axes(problem.robot))), 1) * sigma**2)


def nothing_measured(unknowns: int, variance: float = 1.0) -> GivenInformation:
    """Where nothing was measured yet: the nominal arm, and a measured coordinate of this variance.

    Args:
        unknowns: k, how many.
        variance: of a measured coordinate in units of the instrument's.
    """
    return GivenInformation(np.zeros((0, unknowns)), np.zeros(unknowns), variance, 0)


def given_information(
    problem: ProblemData, data: Measurements, parameters: tuple[Parameter, ...], expected: float = 1.0
) -> GivenInformation:
    """What ``data`` say of ``parameters``; touched points, which are unknowns of the data alone, are worked out.

    With the touched points first, the triangular factor R of the Jacobian holds in its last rows what is left for the
    unknowns of the plan: their information after the points are projected out.

    Where the data suffice, the arm is fitted to them: the plan then starts from that arm, without its outliers, and
    counts with what the fit leaves in place of the ``expected`` variance.

    Args:
        parameters: the k unknowns of the plan.
        expected: variance of a measured coordinate in units of the instrument's, before anything was measured.
    """
    residuals, notes = arm_and_data(problem, data)
    x = fit_frames(residuals)
    _, J = residuals.residuals_and_jacobian(x)
    names = [p.name for p in residuals.parameters]
    known = determine_directions(problem, residuals, x, held_length(residuals), priors=True)
    variance, kept = expected, np.arange(len(data))
    if len(J) >= known.directions.shape[1] + _MIN_VARIANCE_FREEDOM:
        found = estimate_parameters(residuals, x, known.directions, known.prior, weight=known.noise)
        x, kept = found.x, np.flatnonzero(found.kept)
        variance = found.variance if found.variance > _MET_EXACTLY else expected
        _, J = residuals.take(kept).residuals_and_jacobian(x)
    own = [names.index(p.name) for p in parameters if p.name in names]
    others = [i for i in range(len(names)) if i not in own]
    # With the others first, the last rows of the triangular factor hold what is left for the shared unknowns.
    R = triangular_factor(J[:, [*others, *own]])[len(others) :, len(others) :]
    at = [i for i, p in enumerate(parameters) if p.name in names]
    wide, start = np.zeros((len(R), len(parameters))), np.zeros(len(parameters))
    wide[:, at], start[at] = R, x[own]
    same = any(p.group == "place" for p in parameters)  # the plan is for this very instrument
    if data.position is None and not same:  # how well a ball sits in its socket says nothing of the instrument to come
        wide, variance = wide * np.sqrt(expected / variance), expected
    gone = len(data) - len(kept)
    notes += (f"{gone} of the given rows left out as outliers",) * (gone > 0)
    return GivenInformation(wide, start, variance, len(kept), len(J), notes)
