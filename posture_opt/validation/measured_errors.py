"""``MeasuredErrors``: measured rows compared with the accuracy that a map predicts where they lie."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.assumptions.frames import arm_and_data, fit_frames
from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.calibration.cross_validation import position_errors
from posture_opt.errors import InputError, Issue
from posture_opt.measurements.measurements import Measurements, nominal_poses
from posture_opt.numerics import Array, Codes, Json, Mask, finite_or_none, rms
from posture_opt.robot.robot import Robot
from posture_opt.selection.maps.target_map import TargetMap
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.regions.coverage_radius import central_radii
from posture_opt.uncertainty.regions.regions import coverage_factor
from posture_opt.validation.coverage import squared_distances

_ELSEWHERE_RATIO = 20  # times the predicted distance: no spread is that much understated

_MIN_ROWS = 20  # rows: fewer say little about a share of 95 %


@dataclass(frozen=True, eq=False)
class MeasuredErrors:
    """Measured rows compared with what is predicted where they lie.

    Args:
        place: (M, 3) tool point of the rows by the model [m], world.
        cell: (M,) the target in whose cell each lies; -1 for none.
        near: (M,) whether they lie in a cell that has a prediction.
        uncorrected, corrected: (M,) distance of the measured from the modelled tool point [m], by the arm without
            its corrections and as the file states it.
        limit: (M,) distance that 95 % of all rows should keep in the cell, the instrument's part included [m]; NaN
            off the map.
        inside: (M,) whether a row lies in the 95 % region that is predicted for its own posture.
        comparable: whether the rows show all of the error: not where they touch points, or where frames are fitted
            to them.
        reach: rows count as near the map within this distance of its plane [m]; 0 where all lie in it.
        remarks: what the rows are, and why they may not be comparable.
    """

    place: Array
    cell: Codes
    near: Mask
    uncorrected: Array
    corrected: Array
    limit: Array
    inside: Mask
    comparable: bool
    reach: float
    remarks: tuple[Statement, ...] = ()

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
        if rows < _MIN_ROWS or abs(self.share - 0.95) <= 4 * math.sqrt(0.95 * 0.05 / rows):
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

    def to_json(self) -> dict[str, Json]:
        """Counts, shares, and lengths [m]."""
        return {
            "rows": len(self.cell),
            "rows_near": int(self.near.sum()),
            "near_within": self.reach,
            "share_within_95_of_cell": finite_or_none(self.share_near),
            "share_within_95_of_own_posture": finite_or_none(self.share),
            "rms_uncorrected": rms(self.uncorrected),
            "rms": rms(self.corrected),
            "notes": [remark.text for remark in self.remarks],
        }


def measured_errors(
    problem: ProblemData, uncorrected: ProblemData, data: Measurements, targets: TargetMap,
    projected: Array, tool_point: ToolPoint,
) -> MeasuredErrors:  # fmt: skip
    """The rows of the first target, their errors by both arms, and what is predicted for them.

    Args:
        uncorrected: the problem with the arm without its corrections.
        projected: (N, m, m) predicted covariance at the targets [m²]; NaN where there is no posture.

    Raises:
        InputError: no row of the first target, several robots, or rows that are neither positions nor touched points.
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
    errors = [_position_errors(one, data) for one in (uncorrected, problem)]
    instrument = position_sigma(problem, data)
    place, _ = nominal_poses(problem.robot, data.q)
    cell = targets.grid.cells(place)
    limits = np.full(len(targets.map_points) + 1, np.nan)  # the last one is that of rows off the map
    used = np.flatnonzero(targets.feasible)
    limits[used] = central_radii(0.95, projected[used] + instrument**2 * np.eye(projected.shape[1]))
    inside = _inside_regions(problem.robot, tool_point, data, errors[1], instrument)
    lengths = [np.linalg.norm(e, axis=1) for e in errors]
    reach = 0.0 if len(projected[0]) < 3 else targets.grid.sides[2] / 2
    elsewhere = not free and not data.touches and float(np.median(lengths[1])) > _ELSEWHERE_RATIO * np.nanmedian(limits)
    remarks += [state("validation.measured-elsewhere")] if elsewhere else []
    comparable = not data.touches and not free and not elsewhere
    near = (cell >= 0) & np.isfinite(limits[cell])
    return MeasuredErrors(
        place, cell, near, lengths[0], lengths[1], limits[cell], inside, comparable, reach, tuple(remarks)
    )


def _position_errors(problem: ProblemData, data: Measurements) -> Array:
    """Model minus measurement (M, 3) [m], world; frames that the file leaves free are fitted to these rows."""
    residuals, _ = arm_and_data(problem, data)
    return position_errors(residuals, fit_frames(residuals))


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
