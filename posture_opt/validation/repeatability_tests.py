"""What repeated measurements say: ISO 9283 at every pose, scatter of repeats, and one goal in several postures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from posture_opt.measurements.measurements import Measurements, outlying_groups, rows_of
from posture_opt.numerics import Array, Codes, Json
from posture_opt.uncertainty.regions.regions import standard_deviation_interval
from posture_opt.uncertainty.sources.iso9283 import (
    OrientationPerformance,
    PositionPerformance,
    orientation_performance,
    position_accuracy,
    position_performance,
    repeatability_from_covariance,
)

ISO_CYCLES = 30  # of the standard
_MAX_GOAL_POSTURES = 20  # of one goal, 190 pairs
_MAX_SIMULATED_ROWS = 2000  # whose tests are simulated for their intervals: a second or two


@dataclass(frozen=True, eq=False)
class PosePerformance:
    """ISO 9283 at one pose: AP of the model before calibration and after, RP of the arm.

    Args:
        line: of the first repeat in the file.
        nominal, calibrated: their accuracies differ, repeatability is the arm's.
        orientation: of small rotations about x, y and z of the world against the calibrated model; empty where
            no orientation was measured. Their accuracy counts only where the model's orientation was fitted.
    """

    line: int
    nominal: PositionPerformance
    calibrated: PositionPerformance
    orientation: tuple[OrientationPerformance, ...] = ()


@dataclass(frozen=True, eq=False)
class Repeats:
    """Postures that were commanded repeatedly.

    Args:
        rows: in groups of two or more; ``groups`` how many groups.
        covariance: (d, d) of one repeat about the mean of its pose, pooled over the groups [m²].
        dof: repeats minus groups.
        sigma: standard deviation of a coordinate, pooled over the axes; ``interval`` holds it with 95 % [m].
        repeatability: RP of the pooled scatter [m].
        poses: those with three repeats or more, the most repeated first.
        left_out: poses with as many that are not listed, for there are too many.
        oriented: whether the orientations' accuracy counts.
        outlying: lines of the first repeats of postures that were left out, as slips.
    """

    rows: int
    groups: int
    covariance: Array
    dof: int
    sigma: float
    interval: tuple[float, float]
    repeatability: float
    poses: tuple[PosePerformance, ...]
    left_out: int = 0
    oriented: bool = False
    outlying: tuple[int, ...] = ()

    def to_json(self) -> dict[str, Json]:
        """Plain numbers [m, m², rad]."""
        return {
            "visits": self.rows, "groups": self.groups, "dof": self.dof, "covariance": self.covariance.tolist(),
            "sigma": self.sigma, "sigma_interval95": list(self.interval), "repeatability": self.repeatability,
            "poses": [_pose_json(pose, self.oriented) for pose in self.poses], "odd": list(self.outlying),
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Distances:
    """Median, 95 % below, and the largest of some distances [m]."""

    median: float
    p95: float
    max: float

    @classmethod
    def of(cls, vectors: Array) -> Distances:
        """Of the lengths of vectors (n, d) [m]."""
        lengths = np.linalg.norm(vectors, axis=1)
        return cls(float(np.median(lengths)), float(np.quantile(lengths, 0.95)), float(lengths.max()))


@dataclass(frozen=True, eq=False)
class Goals:
    """One goal reached in several postures: how far apart they land, in pairs.

    Args:
        goals: with two postures or more; ``pairs`` of postures in them.
        measured: distance of the two places.
        said: by the model's name, the distance that it says.
        missed: by the model's name, what it misses of the vector between them.
    """

    goals: int
    pairs: int
    measured: Distances
    said: dict[str, Distances]
    missed: dict[str, Distances]

    def to_json(self) -> dict[str, Json]:
        """Plain numbers [m]."""
        models = {name: {"said": vars(self.said[name]), "missed": vars(self.missed[name])} for name in self.said}
        return {"goals": self.goals, "pairs": self.pairs, "measured": vars(self.measured), **models}


def repeats_of(
    data: Measurements, codes: Codes, moved: Array, deviations: dict[str, Array], rotations: Array | None = None,
    oriented: bool = False,
) -> Repeats | None:  # fmt: skip
    """What repeats say, or ``None`` where no posture was repeated.

    Args:
        codes: (N,) rows of one code repeat one posture.
        moved: (N, d) measured minus one model for all rows, which shows how repeats differ [m].
        deviations: ``nominal`` and ``calibrated``, (N, d) measured minus model [m].
        rotations: (N, 3) measured minus model as small rotations [rad].
        oriented: whether the model's orientation was fitted.
    """
    every = [group for group in rows_of(codes) if len(group) > 1]
    about = [moved[r] - moved[r].mean(axis=0) for r in every]
    freedom = np.array([(len(r) - 1) * moved.shape[1] for r in every], dtype=float)
    slipped = outlying_groups(np.array([np.sum(a**2) for a in about]), freedom)
    rows = [r for r, gross in zip(every, slipped, strict=True) if not gross]
    if not rows:
        return None
    inner = np.concatenate([a for a, gross in zip(about, slipped, strict=True) if not gross])
    dof = len(inner) - len(rows)
    covariance = inner.T @ inner / dof
    sigma = float(np.sqrt(np.trace(covariance) / len(covariance)))
    low, high = standard_deviation_interval(dof * len(covariance) + 1)
    often = sorted((r for r in rows if len(r) >= 3), key=len, reverse=True)
    chosen = often[: int(np.searchsorted(np.cumsum([len(r) for r in often]), _MAX_SIMULATED_ROWS)) + 1]
    poses = tuple(_pose_performance(data, deviations, rotations, r) for r in chosen)
    return Repeats(
        len(inner), len(rows), covariance, dof, sigma, (low * sigma, high * sigma),
        repeatability_from_covariance(covariance), poses, len(often) - len(chosen), oriented,
        tuple(int(data.line[r[0]]) for r, gross in zip(every, slipped, strict=True) if gross),
    )  # fmt: skip


def goals_of(data: Measurements, errors: dict[str, Array]) -> Goals | None:
    """How far apart postures of one goal land, or ``None`` where no goal was reached in two.

    Args:
        errors: by model, (N, 3) measured minus model [m].
    """
    if data.position is None or not data.goal_given:
        return None
    pairs = list(_posture_pairs(data))
    if not pairs:
        return None
    goals = len({int(data.goal[a[0]]) for a, _ in pairs})

    def apart(values: Array) -> Array:
        return np.array([values[a].mean(axis=0) - values[b].mean(axis=0) for a, b in pairs])

    measured, missed = apart(data.position), {name: apart(e) for name, e in errors.items()}
    said = {name: Distances.of(measured - miss) for name, miss in missed.items()}
    return Goals(
        goals, len(pairs), Distances.of(measured), said, {name: Distances.of(miss) for name, miss in missed.items()}
    )


def _posture_pairs(data: Measurements) -> Iterator[tuple[Codes, Codes]]:
    """Rows of two postures of one goal and target; of very many postures some, evenly over the file."""
    for rows in rows_of(data.goal * (data.target.max(initial=0) + 1) + data.target):
        postures = [rows[mine] for mine in rows_of(data.pose[rows])]
        some = np.unique(np.linspace(0, len(postures) - 1, min(len(postures), _MAX_GOAL_POSTURES)).round().astype(int))
        yield from combinations([postures[k] for k in some], 2)


def _pose_performance(
    data: Measurements, deviations: dict[str, Array], rotations: Array | None, rows: Codes
) -> PosePerformance:
    """ISO 9283 at the pose of some rows: accuracy AP before and after calibration, repeatability RP; rotations too."""
    goal = np.zeros(deviations["nominal"].shape[1])
    nominal = position_performance(deviations["nominal"][rows], goal)
    # RP is the arm's, whatever the model: its interval need not be simulated twice.
    accuracy, interval = position_accuracy(deviations["calibrated"][rows], goal)
    calibrated = replace(nominal, accuracy=accuracy, accuracy_interval=interval)
    turned = () if rotations is None else tuple(orientation_performance(angle, 0.0) for angle in rotations[rows].T)
    return PosePerformance(int(data.line[rows[0]]), nominal, calibrated, turned)


def _pose_json(pose: PosePerformance, oriented: bool) -> dict[str, Json]:
    """An entry of ``repeats.poses``: AP and RP with their intervals [m], of rotations [rad]."""
    document: dict[str, Json] = {"line": pose.line, "n": pose.nominal.n}
    for name, found in (("nominal", pose.nominal), ("calibrated", pose.calibrated)):
        document[name] = {"AP": found.accuracy, "AP_interval95": list(found.accuracy_interval)}
    document["RP"] = pose.nominal.repeatability
    document["RP_interval95"] = list(pose.nominal.repeatability_interval)
    if pose.orientation:
        document["orientation_RP"] = [angle.repeatability for angle in pose.orientation]
        document["orientation_AP"] = [angle.accuracy for angle in pose.orientation] if oriented else None
    return document
