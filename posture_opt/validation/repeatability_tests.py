"""What repeated measurements say: ISO 9283 at every pose, scatter of repeats, and one goal in several postures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from posture_opt.measurements.measurements import Measurements, outlying_groups, rows_of
from posture_opt.numerics import Array, Codes, Json
from posture_opt.uncertainty.regions import standard_deviation_interval
from posture_opt.uncertainty.repeatability import (
    OrientationPerformance,
    PositionPerformance,
    orientation_performance,
    position_accuracy,
    position_performance,
    repeatability_from_covariance,
)

ISO_CYCLES = 30  # of the standard


@dataclass(frozen=True, eq=False)
class PosePerformance:
    """ISO 9283 at one pose: AP of the model before calibration and after, RP of the arm."""

    line: int  # of the first repeat in the file
    nominal: PositionPerformance  # nominal, calibrated: their accuracies differ, repeatability is the arm's
    calibrated: PositionPerformance
    # Of small rotations about x, y and z of the world against the calibrated model, where orientation was measured;
    # their accuracy counts only where the model's orientation was fitted.
    orientation: tuple[OrientationPerformance, ...] = ()

    def to_json(self, oriented: bool) -> dict[str, Json]:
        models = {"nominal": self.nominal, "calibrated": self.calibrated}
        document: dict[str, Json] = {
            "line": self.line,
            "n": self.nominal.n,
            **{k: {"AP": m.accuracy, "AP_interval95": list(m.accuracy_interval)} for k, m in models.items()},
            "RP": self.nominal.repeatability,
            "RP_interval95": list(self.nominal.repeatability_interval),
        }
        if self.orientation:
            document["orientation_RP"] = [angle.repeatability for angle in self.orientation]
            document["orientation_AP"] = [angle.accuracy for angle in self.orientation] if oriented else None
        return document


@dataclass(frozen=True, eq=False)
class Repeats:
    """Postures that were commanded repeatedly."""

    rows: int  # in groups of two or more; ``groups`` how many groups
    groups: int
    covariance: Array  # (d, d) of one repeat about the mean of its pose, pooled over the groups [m²]
    dof: int  # repeats minus groups
    sigma: float  # standard deviation of a coordinate, pooled over the axes; ``interval`` holds it with 95 % [m]
    interval: tuple[float, float]
    repeatability: float  # RP of the pooled scatter [m]
    poses: tuple[PosePerformance, ...]  # those with three repeats or more, the most repeated first
    left_out: int = 0  # poses with as many that are not listed, for there are too many
    oriented: bool = False  # whether the orientations' accuracy counts
    outlying: tuple[int, ...] = ()  # lines of the first repeats of postures that were left out, as slips

    def to_json(self) -> dict[str, Json]:
        return {
            "visits": self.rows, "groups": self.groups, "dof": self.dof, "covariance": self.covariance.tolist(),
            "sigma": self.sigma, "sigma_interval95": list(self.interval), "repeatability": self.repeatability,
            "poses": [pose.to_json(self.oriented) for pose in self.poses], "odd": list(self.outlying),
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
    """One goal reached in several postures: how far apart they land, in pairs."""

    goals: int  # with two postures or more; ``pairs`` of postures in them
    pairs: int
    measured: Distances  # distance of the two places
    said: dict[str, Distances]  # by the model's name, the distance that it says
    missed: dict[str, Distances]  # by the model's name, what it misses of the vector between them

    def to_json(self) -> dict[str, Json]:
        models = {name: {"said": vars(self.said[name]), "missed": vars(self.missed[name])} for name in self.said}
        return {"goals": self.goals, "pairs": self.pairs, "measured": vars(self.measured), **models}


def repeats_of(
    data: Measurements, codes: Codes, moved: Array, deviations: dict[str, Array], rotations: Array | None = None,
    oriented: bool = False,
) -> Repeats | None:  # fmt: skip
    """What repeats say, or ``None`` where no posture was repeated.

    codes (N,) rows of one code repeat one posture; moved (N, d) measured minus one model for all rows, which shows how
    repeats differ [m]; deviations: ``nominal`` and ``calibrated``, (N, d) measured minus model [m]; rotations (N, 3)
    measured minus model as small rotations [rad].
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
    # 2000 whose tests are simulated for their intervals: a second or two
    chosen = often[: int(np.searchsorted(np.cumsum([len(r) for r in often]), 2000)) + 1]
    poses = tuple(_pose_performance(data, deviations, rotations, r) for r in chosen)
    return Repeats(
        len(inner), len(rows), covariance, dof, sigma, (low * sigma, high * sigma),
        repeatability_from_covariance(covariance), poses, len(often) - len(chosen), oriented,
        tuple(int(data.line[r[0]]) for r, gross in zip(every, slipped, strict=True) if gross),
    )  # fmt: skip


def goals_of(data: Measurements, errors: dict[str, Array]) -> Goals | None:
    """How far apart postures of one goal land, or ``None`` where no goal was reached in two.

    errors: by model, (N, 3) measured minus model [m].
    """
    if data.position is None or not data.goal_given:
        return None
    pairs: list[tuple[Codes, Codes]] = []
    for rows in rows_of(data.goal * (data.target.max(initial=0) + 1) + data.target):
        postures = [rows[mine] for mine in rows_of(data.pose[rows])]
        # 20 postures of one goal, 190 pairs, evenly over the file
        some = np.unique(np.linspace(0, len(postures) - 1, min(len(postures), 20)).round().astype(int))
        pairs += combinations([postures[k] for k in some], 2)
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


def _pose_performance(
    data: Measurements, deviations: dict[str, Array], rotations: Array | None, rows: Codes
) -> PosePerformance:
    goal = np.zeros(deviations["nominal"].shape[1])
    nominal = position_performance(deviations["nominal"][rows], goal)
    # RP is the arm's, whatever the model: its interval need not be simulated twice.
    accuracy, interval = position_accuracy(deviations["calibrated"][rows], goal)
    calibrated = replace(nominal, accuracy=accuracy, accuracy_interval=interval)
    turned = () if rotations is None else tuple(orientation_performance(angle, 0.0) for angle in rotations[rows].T)
    return PosePerformance(int(data.line[rows[0]]), nominal, calibrated, turned)
