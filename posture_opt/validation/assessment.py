"""``assess``: what a model gets wrong, before calibration and after, and whether what remains is mere scatter."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import overload

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.calibration.calibration import Calibration, calibrated_parts
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.encoding import Encoded
from posture_opt.interrupts import interruptible
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import repeats_of_one_kind
from posture_opt.measurements.rotations import rotation_matrices, rotation_vectors
from posture_opt.numerics import Array, Codes
from posture_opt.result import Result
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Quantity, Statement, notation, state
from posture_opt.uncertainty.regions import Ellipsoid, hotelling_factor
from posture_opt.units import fixed
from posture_opt.validation.model_errors import (
    TEST_LEVEL,
    BlockMean,
    ModelErrors,
    Sides,
    Trend,
    measured_parts,
    model_errors,
    sides_of,
    trends_of,
)
from posture_opt.validation.prediction import prismatic_joints
from posture_opt.validation.repeatability_tests import ISO_CYCLES, Goals, Repeats, goals_of, repeats_of

MIN_INSTRUMENT_RATIO = 10.0  # better than what it judges an instrument should be
NORMAL_TAIL = 0.0027  # of normal numbers lie beyond three standard deviations
_SIGMA_EXAMPLES = {"m": "0.05 mm", "rad": "0.002 deg", "px": "0.2 px"}
"""SI unit of a reading -> a standard deviation as a file may state it."""


@dataclass(frozen=True, eq=False)
class ResidualScatter(
    Encoded,
    json="covariance=ellipse.covariance samples dof "
    "semi_axes_1sigma=ellipse.semi_axes axes=ellipse.axes.T coverage95_factor=factor inside",
):
    """The vector uncertainty of what calibration leaves, ``C = (1/l) Σ Δx Δxᵀ``."""

    ellipse: Ellipsoid  # about zero, in the coordinates that were measured
    samples: int  # l, rows
    # independent ones among them, poses; the 95 % region is ``factor`` standard deviations wide,
    # ``hotelling_factor(0.95, d, dof)``: that of a point that comes from the same scatter as C
    dof: int
    factor: float
    inside: float  # share of the rows in that region

    @classmethod
    def of(cls, errors: Array, poses: int) -> ResidualScatter | None:
        """Of errors (l, d) [m] about zero; None with too few poses."""
        ellipse = Ellipsoid(np.zeros(errors.shape[1]), errors.T @ errors / len(errors))
        if not 0 < ellipse.rank < poses + 1:
            return None
        factor = hotelling_factor(0.95, ellipse.rank, poses)
        return cls(ellipse, len(errors), poses, factor, float(np.mean(ellipse.mahalanobis(errors) <= factor)))


@dataclass(frozen=True, eq=False, repr=False)
class Assessment(Result):
    """What a model gets wrong, before calibration and after; deviations are measured minus model.

    Args:
        calibration: what is assessed.
        rows, poses: counted; outliers of the calibration are not.
        axes: indices of the measured coordinates.
        direction: (3,) unit vector of the task in the frame of the measurements, or ``None`` without a task.
        instrument: σ of a coordinate that the problem states [m]; 0 where it states none.
        block_axes: name and unit, m or rad, of what the blocks of the tests are cut along.
        residual_scatter: ``None`` where the poses are too few for a region.
        repeats, goals: ``None`` where nothing was repeated.
        trends, sides: how the calibrated model's errors move with inputs, and with the side of arrival.
        unseen: why errors along and across the task are left out, or in which frame they are; empty without a reason.
    """

    calibration: Calibration
    rows: int
    poses: int
    axes: tuple[int, ...]
    direction: Array | None
    instrument: float
    block_axes: tuple[tuple[str, str], ...]
    nominal: ModelErrors
    calibrated: ModelErrors
    residual_scatter: ResidualScatter | None
    repeats: Repeats | None
    goals: Goals | None
    trends: tuple[Trend, ...] = ()
    sides: tuple[Sides, ...] = ()
    unseen: str = ""

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """The errors before and after; whether a mean error remains; then what each rule of measuring says."""
        parts = (_mean_statements, _unseen, _input_statements, _scatter_statements, _instrument, _repeat_statements)
        before, after = (Quantity(model.coordinate) for model in (self.nominal, self.calibrated))
        one = self.calibration.request.data.kind.number_words
        errors = state("validation.errors", coordinate=one, before=before, after=after)
        return (errors, *(statement for part in parts for statement in part(self)))

    @property
    def notes(self) -> tuple[str, ...]:
        """What is left out of the errors by direction."""
        return tuple(one.text for one in _unseen(self))

    @property
    def largest_mean(self) -> BlockMean | None:
        """The part of the workspace with the largest mean error of the calibrated model that is not zero."""
        off = [block for block in self.calibrated.blocks if not block.zero]
        return max(off, key=lambda block: float(np.linalg.norm(block.test.mean)), default=None)

    @property
    def frequent_large_errors(self) -> bool:
        """Whether more coordinates lie beyond three standard deviations than of normal ones.

        ``P(N ≥ n | λ = 0.0027 · coordinates) = gammainc(n, λ)`` below 5 %.
        """
        from scipy.special import gammainc

        coordinates = self.rows * len(self.axes)
        beyond = round(self.calibrated.beyond3 * coordinates)
        return beyond > 0 and float(gammainc(beyond, coordinates * NORMAL_TAIL)) < TEST_LEVEL

    @property
    def ratios(self) -> dict[str, float]:
        """By model, how many times better the instrument is than what it judges; infinite where it has no σ."""
        models = {"nominal": self.nominal, "calibrated": self.calibrated}
        return {name: m.coordinate / self.instrument if self.instrument else np.inf for name, m in models.items()}

    def fields_json(self) -> dict[str, object]:
        """The entry ``assessment`` of ``calibration.json``: SI units."""
        instrument: dict[str, object] = {"sigma": self.instrument or None}
        if self.instrument:
            instrument |= {"times_better": self.ratios}
            instrument["sufficient"] = {name: ratio >= MIN_INSTRUMENT_RATIO for name, ratio in self.ratios.items()}
        return {
            "sign": "measured minus model", "rows": self.rows, "poses": self.poses,
            "block_axes": [name for name, _ in self.block_axes],
            "direction": self.direction,
            "nominal": self.nominal, "calibrated": self.calibrated,
            "remaining": self.residual_scatter,
            "instrument": instrument,
            "repeats": self.repeats,
            "goals": self.goals,
            "trends": self.trends,
            "approach": self.sides,
            "notes": self.notes,
        }  # fmt: skip


@overload
def assess(calibration: Calibration, /) -> Assessment: ...
@overload
def assess(problem: ProblemData, data: Measurements, calibration: Calibration) -> Assessment: ...
@interruptible()
def assess(
    problem: ProblemData | Calibration, data: Measurements | None = None, calibration: Calibration | None = None
) -> Assessment:
    """What the model gets wrong, before calibration and after, and what two rules of measuring say of it.

    With deviations ``d_i = m_i − f(q_i)`` [m] the bias is their mean, its test Hotelling's ``T² = n d̄ᵀ S⁻¹ d̄``,
    overall and in blocks of the workspace; trends over time, temperature and payload, and differences between the sides
    of arrival, are tested alike. The instrument should be ten times better than what it judges; repeats are evaluated
    as ISO 9283 does.

    The deviations by direction are cross-validated. The means are tested on those of the arm fitted to all rows,
    group by group of rows of one pose; fitted parameters have taken a share of them, so that the tests err on
    the side of zero.

    Args:
        problem: the calibration, which has its problem and its measurements; or the problem.
        data: in that case the measurements.
        calibration: in that case the calibration of these measurements.

    Returns:
        ``Assessment``: RMS, mean and largest error [m] before and after calibration, and of two rules of
        measuring; ``report()`` prints them.

    Example:
        >>> import posture_opt as po
        >>> problem = po.load_problem("insert_planar_2r_measured")
        >>> data = po.read_measurements("problems/planar_2r_measured.csv", problem)
        >>> assessment = po.assess(po.calibrate(problem, data))
        >>> assessment.poses, assessment.calibrated.zero  # nothing speaks against a mean error of zero
        (60, True)
    """
    problem, data, calibration = calibrated_parts(problem, data, calibration)
    kept, residuals = calibration.kept_rows, calibration.residuals.take(calibration.kept_rows)
    axes, used, spatial = residuals.axes, data.take(kept), len(data.kind.axis_names) == 3
    direction = None
    if spatial and problem.task is not None:
        direction = np.array(problem.task.direction, dtype=float) / np.linalg.norm(problem.task.direction)
    every = (calibration.errors_nominal, calibration.errors, calibration.errors_fitted)
    # Measured minus model; less than 1e-12 m is rounding of a coordinate.
    nominal, calibrated, fitted = (np.where(np.abs(e[kept]) > 1e-12, -e[kept], 0.0) for e in every)
    codes, poses = repeats_of_one_kind(used, prismatic_joints(residuals)), len(np.unique(used.pose))
    repeats = None
    if data.position is not None:
        deviations = {"nominal": nominal[:, axes], "calibrated": calibrated[:, axes]}
        rotations = _rotation_errors(residuals, calibration.x, used, codes)
        repeats = repeats_of(used, codes, fitted[:, axes], deviations, rotations, bool(residuals.data.kind.further))
    cut = {"x": "m", "y": "m", "z": "m"}
    if data.position is None:
        cut = {joint.name: "rad" if joint.type == "revolute" else "m" for joint in problem.robot.joints}
    return Assessment(
        calibration=calibration,
        rows=len(kept),
        poses=poses,
        axes=tuple(int(axis) for axis in axes),
        direction=direction,
        instrument=position_sigma(problem, data),
        block_axes=tuple(cut.items()),
        nominal=model_errors(used, nominal, nominal, axes, direction),
        calibrated=model_errors(used, calibrated, fitted, axes, direction),
        residual_scatter=ResidualScatter.of(calibrated[:, axes], poses),
        repeats=repeats,
        goals=goals_of(used, {"nominal": nominal, "calibrated": calibrated}),
        trends=trends_of(used, fitted[:, axes]),
        sides=sides_of(used, fitted, residuals.reading_shifts(residuals.robot.driven, calibration.x)),
        unseen=_why_unseen(problem, axes, direction) if spatial else "",
    )


def _why_unseen(problem: ProblemData, axes: Codes, direction: Array | None) -> str:
    if direction is None:
        return "no-task-direction"
    if not all(measured_parts(axes, direction)):
        return "direction-unmeasured"
    return "direction-of-measurements" if problem.robot.base_free else ""


def _unseen(found: Assessment) -> Iterator[Statement]:
    if found.unseen:
        yield state(f"validation.{found.unseen}")


def _mean_statements(found: Assessment) -> Iterator[Statement]:
    model = found.calibrated
    tests = [*([] if model.mean is None else [model.mean.zero]), *(block.zero for block in model.blocks)]
    if not model.zero:
        yield state("validation.mean-remains", share=Quantity(1 - sum(tests) / len(tests), "share"))
    else:
        yield state("validation.mean-zero" if model.blocks else "validation.poses-few-for-parts")
    worst = found.largest_mean
    if worst is not None:
        size = Quantity(float(np.linalg.norm(worst.test.mean)))
        yield state("validation.largest-mean", size=size, where=_sides_of(found, worst))


def _sides_of(found: Assessment, block: BlockMean) -> list[str]:
    whole = np.ptp([[b.lower, b.upper] for b in found.calibrated.blocks], axis=(0, 1))
    part = (block.upper - block.lower) / np.maximum(whole, 1e-12)
    units = {"rad": (math.degrees(1.0), "deg", 0), "m": (1.0, "m", 2)}
    sides = []
    # 0.6 of the whole range: a block as long was not cut along it
    for k in sorted(k for k in np.argsort(part)[:3] if part[k] < 0.6 and whole[k] > 0):
        name, (factor, unit, decimals) = found.block_axes[k][0], units[found.block_axes[k][1]]
        low, high = (fixed(factor * float(end[k]), decimals) for end in (block.lower, block.upper))
        sides.append(f"{name} is {low} to {high} {unit}")
    return sides


def _input_statements(found: Assessment) -> Iterator[Statement]:
    trends = [trend for trend in found.trends if trend.found]
    for trend in trends:
        change = notation.shift(trend.change.tolist())
        yield state("validation.trend", trend.name, span=trend.span, change=change, p=Quantity(trend.p_value, "p"))
    if trends:
        yield state("validation.trend-confounded")
    calm = [trend.name for trend in found.trends if not trend.found]
    if calm:
        yield state("validation.no-trend", inputs=calm)
    off = sorted((one for one in found.sides if one.found), key=lambda one: -abs(one.difference))
    for one in off:
        yield state("validation.side", one.joint, difference=Quantity(abs(one.difference)))
    if found.sides and not off:
        yield state("validation.no-side")


def _scatter_statements(found: Assessment) -> Iterator[Statement]:
    if found.residual_scatter is None:
        yield state("validation.poses-few-for-region" if found.calibrated.coordinate else "validation.residuals-zero")
    elif not found.calibrated.zero:
        yield state("validation.scatter-systematic")
    if found.frequent_large_errors:
        yield state("validation.large-errors-frequent")


def _instrument(found: Assessment) -> Iterator[Statement]:
    kind = found.calibration.request.data.kind
    if not found.instrument:
        yield state("validation.instrument-unstated", key=kind.sigma_key, example=_SIGMA_EXAMPLES[kind.unit])
        return
    sigma = Quantity(found.instrument, "stated length")
    for name, when in (("nominal", "before"), ("calibrated", "after")):
        if (ratio := found.ratios[name]) < MIN_INSTRUMENT_RATIO:
            yield state("validation.instrument-inaccurate", name, model=when, ratio=ratio, sigma=sigma)


def _repeat_statements(found: Assessment) -> Iterator[Statement]:
    repeats = found.repeats
    if repeats is None:
        unmeasured = found.calibrated.mean is None
        yield state("validation.repeatability-unmeasured" if unmeasured else "validation.repeatability-unknown")
    elif not repeats.poses:
        yield state("validation.repeats-few")
    elif (least := min(pose.nominal.n for pose in repeats.poses)) < ISO_CYCLES:
        yield state("validation.repeats-below-standard", standard=ISO_CYCLES, least=least)


def _rotation_errors(residuals: Residuals, x: Array, data: Measurements, codes: Codes) -> Array | None:
    """Measured minus model (N, 3) [rad] as small rotations in the world; ``None`` without orientations."""
    if data.rotation is None:
        return None
    if residuals.data.kind.further:
        return -residuals.further_error(x)
    # The model's orientation is not fitted: each posture is set against its own first repeat, which shows the scatter.
    _, first, own = np.unique(codes, return_index=True, return_inverse=True)
    R = rotation_matrices(data.rotation)
    return rotation_vectors(R @ np.swapaxes(R[first][own], -1, -2))
