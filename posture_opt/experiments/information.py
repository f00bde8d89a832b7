"""What is known of an arm before and after measurements, and what a measurement at any posture would add."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

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
from posture_opt.calibration.estimation.fit_setup import (
    determine_directions,
    full_prior,
    prior_tolerances,
    widths_of_data,
)
from posture_opt.calibration.estimation.identifiability import (
    Identifiability,
    identify_parameters,
    observability_indices,
)
from posture_opt.calibration.estimation.least_squares import triangular_factor
from posture_opt.calibration.estimation.parameters import Parameter, Prior, prior_covariance
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.experiments.exchange import Criterion, Determinant, Variance, quantity_variances, unit_information
from posture_opt.experiments.planned_kind import KindPlaces
from posture_opt.experiments.planned_mixed import planned_places
from posture_opt.measurements.measurements import Measurements, nominal_poses, reach_of, still_axes
from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array, Mask
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.tool_point import ToolPoint

OF_PLACES = ("place", "second_arm")
"""Groups of parameters that belong to what is measured, and not to the arm."""


@dataclass(frozen=True, eq=False)
class GivenInformation:
    """What measurements made already say of the unknowns of a plan."""

    R: Array  # (m, k) square root of their information, ``RᵀR``, in units of the instrument's σ; no rows for none
    x: Array  # (k,) deviations from nominal [rad, m] at which everything is linearised
    # of a measured coordinate in units of the instrument's: what a fit to the data leaves, or where they do not
    # determine it, the arm's own scatter from repeat to repeat added to the instrument's
    variance: float
    rows: int  # rows, coordinates: how many measurements, and numbers measured in them
    coordinates: int = 0
    notes: tuple[str, ...] = ()  # sentences for the report


@dataclass(frozen=True, eq=False)
class MeasurementModel:
    """The measurement of all targets at one posture, measured ``repeats`` times, as a function of the posture."""

    residuals: Residuals  # the arm against one planned row of each target; the row says what the instrument measures
    problem: ProblemData  # for the noise of the instrument
    repeats: int = 1  # a mean of r repeats has ``1/√r`` of the standard deviation
    places: KindPlaces | None = None  # what an instrument measures that shows no position; None of positions
    # unknown of these places -> its deviation in the fit to the given rows
    at: Mapping[str, float] = field(default_factory=dict)
    # (k,) tolerances of manufacturing that `calibrate` takes parts to be within by the given rows; NaN of what has
    # none, None without such rows
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
        """(N, b, k) derivatives of the mean of all repeats of the postures (N, n), in standard deviations of it."""
        template, robot, block = self.residuals.data, self.residuals.robot, self.residuals.block
        own, turned = q[:, : robot.n], template.rotation is not None
        data = planned_rows(robot, own, template.measured_axes, self.targets, oriented=turned)
        data = data if self.places is None else self.places.rows(data, q)
        _, J = self.residuals.of_data(data).residuals_and_jacobian(x)
        rows = J.reshape(len(q), self.rows, block, len(x)) * np.sqrt(self.repeats)
        if self.places is not None:
            rows = rows * self.places.weights(q)[:, :, None, None]
        elif self.problem.effects:  # σ's that grow with the range, and as many readings as are usable
            sigma = reading_sigmas(self.problem, nominal_poses(robot, own)[0])
            scale = np.ones((len(q), 1, block, 1))
            scale[:, 0, : len(self.residuals.axes), 0] = np.divide(
                self.residuals.sigma, sigma, out=np.ones(len(q)), where=sigma > 0
            )[:, None]
            rows = np.sqrt(usable_share(self.problem)) * rows * scale
        return np.asarray(rows.reshape(len(q), self.coordinates, len(x)))

    def tool_rows(self, q: Array, x: Array, basis: Array) -> Array:
        """Shift (t, k) of the (first) tool point at the posture q (n,) along ``basis``, per unit of each unknown."""
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

    axes (3,) which coordinates will be measured.
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
    """The instrument of a problem and what it measures, and sentences on what was assumed."""
    robot, further = problem.robot, further_sigmas(problem)
    if given is not None and given.position is None:  # at the places that a fit to the given rows finds
        residuals, notes = arm_and_data(problem, given)
        x = fit_frames(residuals)
        known = determine_directions(problem, residuals, x, held_length(residuals), priors=True)
        found = estimate_parameters(residuals, x, known.directions, known.prior, weight=known.noise)
        widths = widths_of_data(found, known.widths) if len(known.widths.own) else known.widths
        parameters = zip(residuals.parameters, found.x, strict=True)
        at = {p.name: float(v) for p, v in parameters if p.group in OF_PLACES}
        places = planned_places(residuals, found.x)
        return MeasurementModel(residuals, problem, repeats, places, at, widths.uncertain), notes
    sigma = planned_sigma(problem, reach_of(robot)) if given is None else position_sigma(problem, given)
    assumed = () if sigma else (f"no σ of the instrument is stated: {DEFAULT_SIGMA_M * 1e3:g} mm taken",)
    axes = ~still_axes(robot) if given is None else given.measured_axes
    targets = given.target_names if given is not None and len(given.target_names) > 1 else ()
    data = planned_rows(robot, np.zeros((1, robot.n)), axes, targets, oriented=bool(further))
    parameters_of_arm = unknown_parameters(problem, data)
    residuals = Residuals.of(problem.arm, data, parameters_of_arm, sigma or DEFAULT_SIGMA_M, further)
    return MeasurementModel(residuals, problem, repeats), assumed


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
    """Where nothing was measured yet: the nominal arm, and a measured coordinate of this variance."""
    return GivenInformation(np.zeros((0, unknowns)), np.zeros(unknowns), variance, 0)


def given_information(
    problem: ProblemData, data: Measurements, parameters: tuple[Parameter, ...], expected: float = 1.0
) -> GivenInformation:
    """What ``data`` say of ``parameters``; touched points, which are unknowns of the data alone, are worked out."""
    residuals, notes = arm_and_data(problem, data)
    x = fit_frames(residuals)
    _, J = residuals.residuals_and_jacobian(x)
    names = [p.name for p in residuals.parameters]
    known = determine_directions(problem, residuals, x, held_length(residuals), priors=True)
    variance, kept = expected, np.arange(len(data))
    # 20 degrees of freedom from which on the residual variance, not the instrument's, is believed
    if len(J) >= known.directions.shape[1] + 20:
        found = estimate_parameters(residuals, x, known.directions, known.prior, weight=known.noise)
        x, kept = found.x, np.flatnonzero(found.kept)
        # 1e-18 of the instrument's variance: rounding, which says nothing of noise
        variance = found.variance if found.variance > 1e-18 else expected
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


@dataclass(frozen=True, eq=False)
class ExpectedErrors:
    """What is expected to be known at one stage."""

    std: Array  # (k,) expected standard errors [rad, m]; NaN where a parameter is not determined
    # expected standard deviation of the tool point at the task's posture that what is not known of the parameters
    # makes: root of the summed variances along the directions that count [m]; NaN without a task, and where it is not
    # determined
    task: float
    # O1 … O5 of all measurements made till then, unknowns scaled to unit RMS over the candidates
    observability: dict[str, float]

    @classmethod
    def median(cls, stages: Sequence[ExpectedErrors]) -> ExpectedErrors:
        """The median of each figure; what is not determined counts as infinite."""
        std = _nan_median([stage.std for stage in stages])
        task = float(_nan_median([np.array(stage.task) for stage in stages]))
        names = stages[0].observability
        return cls(std, task, {name: float(np.median([s.observability[name] for s in stages])) for name in names})


def _nan_median(values: Sequence[Array]) -> Array:
    middle = np.median([np.where(np.isnan(value), np.inf, value) for value in values], axis=0)
    return np.where(np.isinf(middle), np.nan, middle)


@dataclass(frozen=True, eq=False)
class PriorInformation:
    """What is known of the unknowns without any measurement."""

    names: tuple[str, ...]
    scale: Array  # (k,) tolerances [rad, m]
    stated: Mask  # (k,) whether a σ is stated
    W: Array  # square root of the information of the stated σ's (p, k); ``full`` has the tolerances of the geometry too
    full: Array

    @classmethod
    def of(cls, problem: ProblemData, parameters: tuple[Parameter, ...], made: Array | None = None) -> PriorInformation:
        """From the σ's that a problem states and the tolerances of `prior_tolerances`.

        made (k,) tolerances that count in place of these; NaN where there is none.
        """
        rows, covariance = prior_covariance(problem, parameters)
        k, scale = len(parameters), prior_tolerances(parameters, rows)
        within = scale if made is None else np.where(np.isfinite(made), made, scale)
        prior = full_prior(parameters, problem.robot, within, rows, covariance).matrix(k)
        names = tuple(p.name for p in parameters)
        return cls(names, scale, np.isin(np.arange(k), rows), Prior.of(rows, covariance).matrix(k), prior)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The unknowns that candidate measurements say something of, with all that is known already.

    Deviations from nominal are ``x = D z``: directions that nothing measured can feel are projected out.
    """

    prior: PriorInformation
    given: GivenInformation
    known: Identifiability  # what all candidates with the given data and the stated σ's determine
    D: Array  # (k, r) deviations [rad, m] per unit of z; ``T`` (r, r) takes unknowns of unit information to z
    T: Array
    start: Array  # (r, r) information on z from the given data and the prior
    seen: Array  # (k, s) directions that measurements alone determine, of unit RMS over the candidates
    L: Array  # (t, r) shift of the tool point at the task's posture along the t directions that count; (0, r) without

    @classmethod
    def of(cls, prior: PriorInformation, J: Array, given: GivenInformation, tool_rows: Array, count: int) -> Unknowns:
        """From the candidates' derivatives J (N, b, k), for a plan of ``count`` of them."""
        flat = np.sqrt(count / len(J)) * J.reshape(-1, J.shape[-1])
        measured = np.concatenate([flat, given.R]) / np.sqrt(given.variance)
        names, scale = prior.names, prior.scale
        alone = identify_parameters(names, measured, count, scale=scale)
        known = identify_parameters(names, np.concatenate([measured, prior.W]), count, scale=scale)
        D = np.concatenate([known.directions, known.hardly], axis=1)
        start = sum((R @ D).T @ (R @ D) for R in (given.R / np.sqrt(given.variance), prior.full))
        average = measured[: len(flat)] @ D
        rms = np.sqrt(np.mean(np.sum(J**2, axis=1), axis=0))
        unit = 1.0 / np.where(rms > 0, rms, 1.0)
        seen = unit[:, None] * np.linalg.qr(alone.directions / unit[:, None])[0]
        T = unit_information(start + average.T @ average)
        return cls(prior, given, known, D, T, np.asarray(start), seen, tool_rows @ D)

    @property
    def count(self) -> int:
        """The number r of combinations that are determined, or at least felt."""
        return int(self.D.shape[1])

    @property
    def settled(self) -> Mask:
        """(k,) which parameters are determined already, or would be by all candidates together."""
        return np.asarray(self.known.determined | self.already)

    @cached_property
    def already(self) -> Mask:
        """(k,) which parameters the given data and the stated σ's determine: more data take nothing back."""
        return np.asarray(self._identified(self.given.R).determined | self.prior.stated)

    def criterion(self, purpose: str) -> Criterion:
        """What a plan for ``parameters`` or for the ``task`` makes small, in the unknowns z."""
        return Variance(self.L) if purpose == "task" else Determinant()

    def blocks(self, J: Array) -> Array:
        """(N, b, r) what candidates measure of z, in standard deviations of the measurement."""
        return np.asarray(J @ self.D / np.sqrt(self.given.variance))

    def before(self, J: Array) -> ExpectedErrors:
        """What is known without the measurements J (n, b, k)."""
        stage, W = self.after(J[:0]), self.prior.W @ self.D
        if self.given.rows:
            return stage
        return replace(stage, task=_root_sum(quantity_variances(W.T @ W, self.L, self.T)))

    def after(self, J: Array) -> ExpectedErrors:
        """What is known after the measurements J (n, b, k) on top of what is known already."""
        flat = self.blocks(J).reshape(-1, self.count)
        M = self.start + flat.T @ flat
        task = _root_sum(quantity_variances(M, self.L, self.T))
        found = self._identified(np.concatenate([J.reshape(-1, J.shape[-1]), self.given.R]))
        # Combinations that nothing determines leave each parameter its part of a tolerance.
        std = np.sqrt(quantity_variances(M, self.D, self.T) + found.unseen**2)
        std = np.where(self.already | found.determined, std, np.nan)
        return ExpectedErrors(std, task, self._observability(J))

    def _identified(self, rows: Array) -> Identifiability:
        """What whitened rows (m, k) together with the stated σ's determine."""
        stack = np.concatenate([rows / np.sqrt(self.given.variance), self.prior.W])
        return identify_parameters(self.prior.names, stack, len(stack) + 1, scale=self.prior.scale)

    def _observability(self, J: Array) -> dict[str, float]:
        """O1 … O5 of the given data with measurements J (n, b, k)."""
        s = np.linalg.svd(np.concatenate([self.given.R, J.reshape(-1, J.shape[-1])]) @ self.seen, compute_uv=False)
        # 1e-7 of the largest singular value
        if not 0 < self.seen.shape[1] <= len(s) or s[-1] <= 1e-7 * s[0]:
            return dict.fromkeys(("O1", "O2", "O3", "O4", "O5"), 0.0)
        return observability_indices(np.asarray(s, dtype=float), self.given.rows + len(J))


def _root_sum(along: Array) -> float:
    return float(np.sqrt(np.sum(along))) if len(along) else float("nan")
