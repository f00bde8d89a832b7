"""How well the instrument measures: what the problem file states, as its effects change it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from posture_opt.measurements.kinds.pose import ORIENTATION
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import NoiseEffect
from posture_opt.numerics import Array, rms
from posture_opt.selection.problem_data import ProblemData


def reading_sigmas(problem: ProblemData, points: Array) -> Array:
    """(N,) standard deviations of a measured coordinate at points (N, 3) of the world [m]; 0 where none is stated.

    Noise effects of the problem change the stated σ with the range of a point, its distance from the origin [m].
    """
    stated = problem.measurement.position if problem.measurement is not None else 0.0
    sigma, ranges = np.full(len(points), float(stated or 0.0)), np.linalg.norm(points, axis=1)
    for effect in _noise_effects(problem):
        sigma = effect.reading(sigma, ranges)
    return sigma


def position_sigma(problem: ProblemData, data: Measurements) -> float:
    """σ of a measured coordinate, or of what else is read, over all rows, root mean square [m]; 0 where none is stated.

    ``√(mean σ_i²)`` over the rows; where all rows have one σ, that one exactly.
    """
    if data.part is not None:
        (names, place), stated = data.weighed, data.kind.sigmas(problem.measurement)
        every = np.array([stated[name] for name in names])[place]
        return rms(every if data.lever is None else every * data.lever)
    if data.lever is not None:
        return stated_sigma_of(problem, data) * rms(data.lever)
    if data.kind.sigma_key != "position":
        own = place_sigmas(problem, data)
        if not data.point_names:
            return stated_sigma_of(problem, data)
        return rms(np.array([own.get(name, 0.0) for name in data.point_names])[data.point])
    return _rms_sigma(reading_sigmas(problem, _measured_points(data)))


def stated_sigma_of(problem: ProblemData, data: Measurements) -> float:
    """σ of a reading that the file states for data of this kind [m, rad or px]; 0 where there is none."""
    return float(getattr(problem.measurement, data.kind.sigma_key, None) or 0.0)


def place_sigmas(problem: ProblemData, data: Measurements) -> dict[str, float]:
    """σ of a reading at each plane or anchor [m]: that of the file, and what is stated of the place."""
    if data.lever is not None and data.part is None:
        return {}
    found = data.kind.sigmas(problem.measurement)
    return found if all(found.values()) else {}


def planned_sigma(problem: ProblemData, points: Array) -> float:
    """σ of a measured coordinate over points (N, 3) of the world that the tool can reach, root mean square [m]."""
    return _rms_sigma(reading_sigmas(problem, points))


def rotation_sigma(problem: ProblemData) -> float:
    """σ of a component of a measured rotation [rad]; 0 where none is stated."""
    sigma = float((problem.measurement.orientation or 0.0) if problem.measurement is not None else 0.0)
    for effect in _noise_effects(problem):
        sigma = effect.turning(sigma)
    return sigma


def further_sigmas(problem: ProblemData) -> dict[str, float]:
    """Key -> σ of what may be read beside positions, in its unit; what has none is not in it."""
    sigma = rotation_sigma(problem)
    return {ORIENTATION.key: sigma} if sigma else {}


def further_ratio(problem: ProblemData, used: Mapping[str, float]) -> float:
    """The σ by which orientations are weighed over the stated one."""
    return used[ORIENTATION.key] / rotation_sigma(problem)


def usable_share(problem: ProblemData) -> float:
    """The share of measurements that are expected to be no gross errors."""
    return float(np.prod([effect.usable for effect in _noise_effects(problem)]))


def relative_sigma(problem: ProblemData, data: Measurements) -> Array:
    """(N,) σ of a measured coordinate of each row over that of all; ones where it is the same everywhere."""
    sigma = reading_sigmas(problem, _measured_points(data))
    overall = _rms_sigma(sigma)
    return sigma / overall if overall else np.ones(len(data))


def _measured_points(data: Measurements) -> Array:
    """Measured positions (N, 3) [m], world; zeros where points were touched, so that ranges are zero."""
    return np.zeros((len(data), 3)) if data.position is None else data.position


def _rms_sigma(sigma: Array) -> float:
    """Root mean square of σ's (N,), which keeps the last digit of a constant; 0 of none."""
    # One number for all rows is to come out as it was stated, to the last digit.
    return (float(sigma[0]) if np.ptp(sigma) == 0 else rms(sigma)) if len(sigma) else 0.0


def _noise_effects(problem: ProblemData) -> list[NoiseEffect]:
    return [effect for effect in problem.effects if isinstance(effect, NoiseEffect)]
