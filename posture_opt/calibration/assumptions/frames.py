"""An arm set against measurements: what is unknown, how it starts, and the free frames fitted."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from posture_opt.calibration.assumptions.instrument import further_sigmas, place_sigmas, position_sigma
from posture_opt.calibration.estimation.fit import Fit, estimate_parameters, minimum_of
from posture_opt.calibration.estimation.identifiability import identify_parameters
from posture_opt.calibration.estimation.least_squares import robust_noise
from posture_opt.calibration.estimation.parameters import (
    Parameter,
    candidate_parameters,
    place_parameters,
    prior_covariance,
    tool_unknown,
)
from posture_opt.calibration.estimation.prior import Prior
from posture_opt.calibration.estimation.residuals import Distance, Residuals, counted
from posture_opt.calibration.estimation.starting_values import offset_of_tool, starting_deviations, tool_sigma
from posture_opt.errors import InputError, Issue
from posture_opt.measurements.affine_fit import reach
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.orientation_columns import NO_ORIENTATION_NOTE
from posture_opt.numerics import Array
from posture_opt.selection.problem_data import ProblemData

DEFAULT_SIGMA_M = 0.1e-3  # m, of an instrument that the file says nothing of; only a stated prior depends on it

_MAX_TOOL_REACHES, _MAX_BASE_REACHES = 2.0, 3.0  # times the reach of the arm: farther off, no frame can be
_MAX_PLACE_REACHES = 10.0  # times the reach: no camera, anchor or touched point is outside the hall


def arm_and_data(problem: ProblemData, data: Measurements) -> tuple[Residuals, tuple[str, ...]]:
    """The arm of a problem against measurements, and sentences on what was assumed.

    The σ of a coordinate is that of the problem's instrument, `DEFAULT_SIGMA_M` where none is stated; it scales the
    residuals and matters only against a prior. Orientations count only where a σ is stated for them.

    Raises:
        InputError: measurements of several robots, or distances between points that no row touches.
    """
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
    if data.kind.fixed_to_base:
        offset = problem.robot.factors[problem.robot.driven[0]].parameter
        moved = f"it moves arm and {data.kind.place_noun} together"
        notes.append(f"{data.kind.noun} say nothing of {offset} and what lies before it: {moved}")
    parameters = unknown_parameters(problem, data)
    distances = _known_distances(problem, data, sigma)
    own = place_sigmas(problem, data)
    return Residuals.of(problem.arm, data, parameters, sigma, further, distances, own), tuple(notes)


def unknown_parameters(problem: ProblemData, data: Measurements) -> tuple[Parameter, ...]:
    """The candidates without what the problem file states as known: frames neither free nor given a σ.

    Several targets are several points of one tool, of which the file can state but one: their offsets are unknown.
    """
    found = candidate_parameters(problem.robot, data)
    stated = prior_covariance(problem, found)[0]
    free = {"base": problem.robot.base_free, "tool": tool_unknown(problem.robot, data)}
    return tuple(p for i, p in enumerate(found) if free.get(p.group, True) or i in stated)


def _known_distances(problem: ProblemData, data: Measurements, sigma: float) -> tuple[Distance, ...]:
    """Known distances, each as certain as the instrument (the play of the ball in its socket).

    Raises:
        InputError: a stated distance names a point that no row touches.
    """
    points = data.kind.touched_points(data.point_names)
    if not points:
        return ()
    own = place_sigmas(problem, data)
    found, issues = [], []
    for index, (a, b, length) in enumerate(problem.data.distances):
        missing = [name for name in (a, b) if name not in points]
        if missing:
            hint = f"the points of the data are: {', '.join(points)}"
            issues.append(Issue(f"no row touches '{missing[0]}'", ("data", "distances", index), missing[0], hint))
        else:
            ends = points[a], points[b]
            found.append((*ends, float(length), own.get(data.point_names[ends[0]], sigma)))
    if issues:
        raise InputError(issues)
    return tuple(found)


def fit_frames(residuals: Residuals, known: Array | None = None) -> Array:
    """Deviations (k,) from nominal with only what is free fitted: frames and touched points.

    Args:
        known: (k,) deviations of a fit to more rows: the search for places starts there, as few rows may leave open on
            which side of the arm an anchor is.
    """
    x0 = starting_deviations(residuals)
    if known is not None:
        x0 = np.where([p.group == "place" for p in residuals.parameters], known, x0)
    found = fit_groups(residuals, x0, residuals.free_groups)
    return x0 if found is None else found.x


def fit_groups(residuals: Residuals, x0: Array, groups: Collection[str]) -> Fit | None:
    """The estimate of the parameters of some groups alone, or ``None`` where there are none.

    A tool stays as near to its start as the size of the arm asks: without that, tool and base would run away together
    where the data hardly distinguish them.

    Args:
        x0: (k,) deviations [rad, m] where the fit starts; groups: of ``geometry``, ``base``, ``tool``, ``effect``,
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
    """(k, rank) what the data determine of the parameters of some groups, or ``None`` where there are none.

    Beside it the standard deviation of what they leave, in units of the instrument's, at least 1.
    """
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

    Touched points, which are unknown, are fitted with them.

    Args:
        x: (k,) deviations of ``residuals.parameters`` [rad, m].

    Raises:
        InputError: the frames would bend to any measurements.
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

    Args:
        x: (k,) deviations of ``residuals.parameters`` [rad, m], none of which is of a place.
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
    """The length that is held where an arm touches points or planes and no known distance determines its size.

    A smaller arm in a smaller world misses its points by less: left to the fit, the arm would shrink to nothing.
    The longest one between the second and the last joint is held, as what lies before or behind is not the arm's alone;
    where there is none, the longest of all. With ``priors`` none is: the tolerances of all lengths hold the size.
    """
    robot = residuals.robot
    kind = residuals.data.kind
    if kind.fixes_size or residuals.distances or (priors and kind.leaves_geometry_open):
        return None
    every = {
        i: abs(p.nominal)
        for i, p in enumerate(residuals.parameters)
        if p.group == "geometry" and p.unit == "m" and p.nominal
    }
    joint_of = {i: residuals.parameters[i].name.rpartition(".")[0] for i in every}
    inner = [i for i in every if joint_of[i] in robot.joint_names[1:-1]]
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
            found |= {name: away} if away > _MAX_PLACE_REACHES * reach(residuals.robot) else {}
    return found


def far_frames(residuals: Residuals, x: Array) -> dict[str, float]:
    """Free frames that are where none can be, and how far off [m]: data that do not determine them let them run away.

    A tool is no longer than twice its arm, and no arm reaches points that are three times its reach from its base.

    Args:
        x: (k,) deviations of the calibrated arm [rad, m].
    """
    robot, data = residuals.robot, residuals.data
    value = {p.name: p.nominal + v for p, v in zip(residuals.parameters, x, strict=True)}
    found = {}
    tools = {p.name.rpartition(".")[0] for p in residuals.parameters if offset_of_tool(p)}
    for tool in tools:
        length = float(np.linalg.norm([value.get(f"{tool}.{axis}", 0.0) for axis in "xyz"]))
        if length > _MAX_TOOL_REACHES * reach(robot):
            found[tool] = length
    if data.position is not None and robot.base_free:
        base = np.array([value[f"base.{axis}"] for axis in "xyz"])
        away = float(np.linalg.norm((data.position.mean(axis=0) - base)[residuals.axes]))
        if away > _MAX_BASE_REACHES * reach(robot):
            found["base"] = away
    return found
