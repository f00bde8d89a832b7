"""An arm set against measurements: what is unknown, how it starts, and the free frames fitted."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.assumptions.instrument import further_sigmas, place_sigmas, position_sigma
from posture_opt.calibration.estimation.fit import Fit, estimate_parameters, minimum_of
from posture_opt.calibration.estimation.identifiability import identify_parameters
from posture_opt.calibration.estimation.least_squares import robust_noise
from posture_opt.calibration.estimation.parameters import (
    Parameter,
    Prior,
    candidate_parameters,
    place_parameters,
    prior_covariance,
    tool_unknown,
)
from posture_opt.calibration.estimation.residuals import Distance, Residuals, counted
from posture_opt.calibration.estimation.starting_values import (
    frame_rotation,
    offset_of_tool,
    starting_deviations,
    tool_sigma,
)
from posture_opt.errors import InputError, Issue
from posture_opt.measurements.measurements import Measurements, reach
from posture_opt.measurements.orientation_columns import NO_ORIENTATION_NOTE
from posture_opt.measurements.rotations import roll_pitch_yaw
from posture_opt.numerics import Array, Mask
from posture_opt.robot.robot import Factor, frame_factors
from posture_opt.selection.problem_data import ProblemData

DEFAULT_SIGMA_M = 0.1e-3  # m, of an instrument that the file says nothing of; only a stated prior depends on it

_MAX_TOOL_REACHES, _MAX_BASE_REACHES = 2.0, 3.0  # times the reach of the arm: farther off, no frame can be


def arm_and_data(problem: ProblemData, data: Measurements) -> tuple[Residuals, tuple[str, ...]]:
    """The arm of a problem against measurements, and sentences on what was assumed."""
    if len(data.robot_names) > 1:
        names = ", ".join(f"'{name}'" for name in data.robot_names)
        hint = "calibrate the batch, or one robot at a time"
        raise InputError(Issue(f"measurements of several robots: {names}", ("column robot",), hint=hint))
    notes = []
    sigma = position_sigma(problem, data)
    if not sigma:
        sigma = DEFAULT_SIGMA_M
        unit = "mm at the tool" if data.lever is not None else f"m{data.kind.unit}"
        notes.append(f"no σ of the instrument is stated: {DEFAULT_SIGMA_M * 1e3:g} {unit} taken")
    further, given = further_sigmas(problem), data
    data = counted(given, further)
    if data is not given:
        notes.append(NO_ORIENTATION_NOTE)
    offset = problem.robot.factors[problem.robot.driven[0]].parameter
    if data.kind.fixed_to_base and offset:
        moved = f"it moves arm and {data.kind.place_noun} together"
        notes.append(f"{data.kind.noun} say nothing of {offset} and what lies before it: {moved}")
    parameters = unknown_parameters(problem, data)
    distances = _known_distances(problem, data, sigma)
    own = place_sigmas(problem, data)
    return Residuals.of(problem.arm, data, parameters, sigma, further, distances, own), tuple(notes)


def unknown_parameters(problem: ProblemData, data: Measurements) -> tuple[Parameter, ...]:
    """The candidates without what the problem file states as known: frames neither free nor given a σ."""
    found = candidate_parameters(problem.robot, data)
    stated = prior_covariance(problem, found)[0]
    free = {"base": problem.robot.base_free, "tool": tool_unknown(problem.robot, data)}
    return tuple(p for i, p in enumerate(found) if free.get(p.group, True) or i in stated)


def _known_distances(problem: ProblemData, data: Measurements, sigma: float) -> tuple[Distance, ...]:
    points = data.kind.touched_points(data.point_names)
    if not points:
        return ()
    own, found, issues = place_sigmas(problem, data), [], []
    for index, (a, b, length) in enumerate(problem.data.distances):
        missing = [name for name in (a, b) if name not in points]
        if missing:
            hint = f"the points of the data are: {', '.join(points)}"
            issues.append(Issue(f"no row touches '{missing[0]}'", ("data", "distances", index), missing[0], hint))
        else:
            found.append((points[a], points[b], float(length), own.get(data.point_names[points[a]], sigma)))
    if issues:
        raise InputError(issues)
    return tuple(found)


def fit_frames(residuals: Residuals, known: Array | None = None) -> Array:
    """Deviations (k,) from nominal with only what is free fitted: frames and touched points.

    known (k,) deviations of a fit to more rows: the search for places starts there, as few rows may leave open on which
    side of the arm an anchor is.
    """
    x0 = starting_deviations(residuals)
    if known is not None:
        x0 = np.where([p.group == "place" for p in residuals.parameters], known, x0)
    found = fit_groups(residuals, x0, residuals.free_groups)
    return x0 if found is None else found.x


def fit_groups(residuals: Residuals, x0: Array, groups: Collection[str]) -> Fit | None:
    """The estimate of the parameters of some groups alone, or ``None`` where there are none.

    x0 (k,) deviations [rad, m] where the fit starts; groups: of ``geometry``, ``base``, ``tool``, ``effect``,
    ``place``.
    """
    found = _determined_directions(residuals, x0, groups)
    if found is None:
        return None
    directions, spread = found
    tools = [i for i, p in enumerate(residuals.parameters) if offset_of_tool(p) and np.any(directions[i])]
    if not tools:
        return estimate_parameters(residuals, x0, directions)
    near = Prior.of(tools, tool_sigma(residuals.robot) ** 2 * np.eye(len(tools)))
    return estimate_parameters(residuals, x0, directions, near, weight=spread)


def _determined_directions(residuals: Residuals, x0: Array, groups: Collection[str]) -> tuple[Array, float] | None:
    """(k, rank) what the data determine of the parameters of some groups, or ``None`` where there are none."""
    columns = [i for i, p in enumerate(residuals.parameters) if p.group in groups]
    if not columns:
        return None
    names = [residuals.parameters[i].name for i in columns]
    r, J = residuals.residuals_and_jacobian(x0)
    rows = len(residuals.data) * residuals.block
    spread = max(robust_noise(r[:rows], J[:rows, columns], residuals.block), 1.0)
    part = identify_parameters(names, J[:, columns], len(residuals.data), scale=np.ones(len(columns)), noise=spread)
    directions = np.zeros((len(x0), part.rank))
    directions[columns] = part.directions
    return directions, spread


def frames_again(residuals: Residuals, x: Array) -> tuple[Residuals, Array]:
    """Base and tool fitted again, though the problem file may state them as known: the wider arm and its deviations.

    x (k,) deviations of ``residuals.parameters`` [rad, m].
    """
    data = residuals.data
    robot = replace(residuals.robot, base_free=True, tool_free=True)
    effects = tuple(p for p in residuals.parameters if p.group == "effect")
    wide = replace(residuals, parameters=(*candidate_parameters(robot, data), *effects))
    value = dict(zip((p.name for p in residuals.parameters), x, strict=True))
    start_at = np.array([value.get(p.name, 0.0) for p in wide.parameters])
    determined = _determined_directions(wide, start_at, {"base", "tool", "place"})
    if determined is None:
        return wide, start_at
    directions, _ = determined
    poses = len(np.unique(data.pose))
    if poses * wide.block <= directions.shape[1]:
        counted = "1 pose is" if poses == 1 else f"{poses} poses are"
        message = f"{counted} too few to fit base and tool again and to judge by what is left"
        hint = "test with 20 poses or more, or without --refit-frames"
        raise InputError(Issue(message, hint=hint, file=data.file))
    return wide, estimate_parameters(wide, start_at, directions).x


def places_again(residuals: Residuals, x: Array) -> tuple[Residuals, Array]:
    """The places of the rows fitted, as planes and anchors, the arm as it is: with these unknowns, and all deviations.

    x (k,) deviations of ``residuals.parameters`` [rad, m], none of which is of a place.
    """
    places = tuple(p for p in place_parameters(residuals.data) if p.group == "place")
    if not places:
        return residuals, x
    own = residuals.parameters
    wide = replace(residuals, parameters=(*own, *places))
    start = starting_deviations(replace(wide, parameters=places))
    x0 = np.r_[x, start]
    steps = np.concatenate([np.zeros((len(own), len(places))), np.eye(len(places))])
    return wide, minimum_of(wide, x0, steps, np.zeros((0, len(x0))))[0]


def held_length(residuals: Residuals, priors: bool = True) -> int | None:
    """The length that is held where an arm touches points or planes and no known distance determines its size."""
    kind = residuals.data.kind
    if kind.fixes_size or residuals.distances or (priors and kind.leaves_geometry_open):
        return None
    rows = enumerate(residuals.parameters)
    every = {i: abs(p.nominal) for i, p in rows if p.group == "geometry" and p.unit == "m" and p.nominal}
    moving = residuals.robot.joint_names[1:-1]
    inner = [i for i in every if residuals.parameters[i].name.rpartition(".")[0] in moving]
    return max(inner or every, key=lambda i: every[i], default=None)


def far_places(residuals: Residuals, x: Array) -> dict[str, float]:
    """Places, as of cameras and anchors, that lie outside of the workspace by far, and how far from the base [m]."""
    value = {p.name: p.nominal + v for p, v in zip(residuals.parameters, x, strict=True)}
    base = {f.parameter: f.nominal for f in residuals.robot.base}
    foot = np.array([value.get(f"base.{axis}", base.get(f"base.{axis}", 0.0)) for axis in "xyz"])
    found: dict[str, float] = {}
    for name in {p.name.rpartition(".")[0] for p in residuals.parameters if p.group == "place"}:
        if all(f"{name}.{axis}" in value for axis in "xyz"):
            away = float(np.linalg.norm(np.array([value[f"{name}.{axis}"] for axis in "xyz"]) - foot))
            # 10.0 times the reach: no camera, anchor or touched point is outside the hall
            found |= {name: away} if away > 10.0 * reach(residuals.robot) else {}
    return found


def far_frames(residuals: Residuals, x: Array) -> dict[str, float]:
    """Free frames that are where none can be, and how far off [m]: data that do not determine them let them run away.

    x (k,) deviations of the calibrated arm [rad, m].
    """
    robot, data = residuals.robot, residuals.data
    value = {p.name: p.nominal + v for p, v in zip(residuals.parameters, x, strict=True)}
    found: dict[str, float] = {}
    for tool in {p.name.rpartition(".")[0] for p in residuals.parameters if offset_of_tool(p)}:
        length = float(np.linalg.norm([value.get(f"{tool}.{axis}", 0.0) for axis in "xyz"]))
        found |= {tool: length} if length > _MAX_TOOL_REACHES * reach(robot) else {}
    if data.position is not None and robot.base_free:
        base = np.array([value[f"base.{axis}"] for axis in "xyz"])
        away = float(np.linalg.norm((data.position.mean(axis=0) - base)[residuals.axes]))
        found |= {"base": away} if away > _MAX_BASE_REACHES * reach(robot) else {}
    return found


_MIN_COSINE = 0.01  # cosine of the pitch in standard errors of roll and yaw, which would be endless at ±90°
_ANGLE_NAMES = ("yaw", "pitch", "roll")


@dataclass(frozen=True, eq=False)
class Chart:
    """The unknowns of ``given`` as they are reported, and those of ``fitted`` as they are fitted."""

    given: Residuals
    fitted: Residuals
    locked: tuple[str, ...]  # which of ``base`` and ``tool`` start within 6° of a pitch of ±90°

    @classmethod
    def of(cls, residuals: Residuals) -> Chart:
        """The chart that suits where free frames start."""
        robot = residuals.robot
        value = dict(zip((p.name for p in residuals.parameters), starting_deviations(residuals), strict=True))
        free = {"base": robot.base_free, "tool": tool_unknown(robot, residuals.data)}
        locked = []
        for frame in ("base", "tool"):
            nominal = {f.parameter: f.nominal for f in getattr(robot, frame)}
            names = {turn: f"{frame}.{turn}" for turn in _ANGLE_NAMES}
            if not free[frame] or not set(names.values()) <= set(value):
                continue
            angles = {turn: nominal[name] + value[name] for turn, name in names.items()}
            # 0.1 cosine of the pitch: below, a turn about one axis takes large turns of roll against yaw
            if abs(math.cos(angles["pitch"])) < 0.1:
                small = _unlocked_factors(frame, getattr(robot, frame), angles)
                robot = replace(robot, base=small) if frame == "base" else replace(robot, tool=small)
                locked.append(frame)
        nominal = {name: factor.nominal for name, factor in robot.parameters.items()}
        parameters = tuple(replace(p, nominal=nominal.get(p.source, p.nominal)) for p in residuals.parameters)
        return cls(residuals, residuals.of_robot(robot, parameters) if locked else residuals, tuple(locked))

    def given_deviations(self, x: Array) -> Array:
        """Deviations (k,) of ``given`` from those of ``fitted``."""
        x = x.copy()
        for frame in self.locked:
            at, angles = self._angles(frame, x)
            nominal = {f.parameter: f.nominal for f in getattr(self.given.robot, frame)}
            x[at] = [angles[turn] - nominal[f"{frame}.{turn}"] for turn in _ANGLE_NAMES]
        return x

    def given_steps(self, x: Array, directions: Array) -> Array:
        """Steps (k, r) of ``given`` from those of ``fitted``."""
        return np.asarray(self._rates(x) @ directions) if self.locked else directions

    def given_determined(self, x: Array, fixed: Mask, covariance: Array) -> Mask:
        """Which of ``given``'s are determined (k,): an angle is, where all the turns are that it is made of."""
        # 1e-3 of an undetermined turn: a smaller part of it in an angle is no matter
        loose = np.asarray((np.abs(self._rates(x)) * ~fixed > 1e-3).any(axis=1))
        for frame in self.locked:
            at, angles = self._angles(frame, x)
            yaw, pitch, roll = at
            tilt = math.sqrt(max(covariance[yaw, yaw], covariance[pitch, pitch], 0.0))
            # 5 standard errors from the lock: from there on roll and yaw have errors as others have
            if abs(math.cos(angles["pitch"])) < max(_MIN_COSINE, 5.0 * tilt):
                loose[[yaw, roll]] = True
        return np.asarray(~loose)

    def given_sizes(self, x: Array, sizes: Array) -> Array:
        """Sizes of errors (k,) of ``given`` from those of ``fitted``."""
        return np.asarray(np.sqrt(self._rates(x) ** 2 @ sizes**2))

    def _rates(self, x: Array) -> Array:
        """The derivative (k, k) of the deviations of ``given`` by those of ``fitted``, at x (k,)."""
        G = np.eye(len(x))
        for frame in self.locked:
            at, angles = self._angles(frame, x)
            G[np.ix_(at, at)] = _angle_rates(angles["roll"], angles["pitch"])
        return G

    def _angles(self, frame: str, x: Array) -> tuple[list[int], dict[str, float]]:
        """Indices of yaw, pitch and roll of a frame among the parameters, and its angles as reported [rad]."""
        names = [p.name for p in self.given.parameters]
        at = [names.index(f"{frame}.{turn}") for turn in _ANGLE_NAMES]
        turns = dict(zip(_ANGLE_NAMES, x[at], strict=True))
        return at, roll_pitch_yaw(frame_rotation(getattr(self.fitted.robot, frame), turns))


def _unlocked_factors(frame: str, factors: tuple[Factor, ...], angles: dict[str, float]) -> tuple[Factor, ...]:
    shifts = tuple(f for f in factors if f.kind == "translate")
    turned = frame_factors(frame, (0.0, 0.0, 0.0), (angles["roll"], angles["pitch"], angles["yaw"]))[3:]
    small = frame_factors(frame, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))[3:]
    return (*shifts, *(replace(factor, parameter="") for factor in turned), *small)


def _angle_rates(roll: float, pitch: float) -> Array:
    """Rates (3, 3) of (yaw, pitch, roll) per small turn about the frame's (z, y, x); cos(pitch) is kept off zero."""
    c, s = math.cos(roll), math.sin(roll)
    cosine = math.copysign(max(abs(math.cos(pitch)), _MIN_COSINE), math.cos(pitch))
    tangent = math.sin(pitch) / cosine
    return np.array([[c / cosine, s / cosine, 0.0], [-s, c, 0.0], [c * tangent, s * tangent, 1.0]])
