"""Rows that models had no part in: another file, its targets matched by name, and what thinning left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.assumptions.frames import frames_again, places_again
from posture_opt.calibration.cross_validation import position_errors
from posture_opt.calibration.estimation.error_statistics import Statistics
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.errors import InputError, Issue, one_of
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import Thinning
from posture_opt.numerics import Array, Json, Mask

Model = tuple[Residuals, Array]
"""An arm against the file that it was fitted to, and its deviations (k,)."""


@dataclass(frozen=True, eq=False)
class OtherFile:
    """Position errors of several models on measurements that taught them nothing."""

    # those measurements; ``errors`` by model (N, 3) model minus measured [m], the model in question last
    data: Measurements
    errors: Mapping[str, Array]
    outside: Mask  # (N,) rows with a joint outside the range in which the models were fitted; ``joints`` such joints
    joints: tuple[str, ...] = ()
    refitted: bool = False  # whether base and tool were fitted again

    @cached_property
    def models(self) -> dict[str, Statistics]:
        """The errors of all rows by model, with a bootstrap over poses."""
        return {name: Statistics.of(errors, self.data.pose) for name, errors in self.errors.items()}

    @property
    def improves(self) -> bool:
        """Whether the last model is better than every other one."""
        *others, last = (statistics.rms for statistics in self.models.values())
        return all(last < rms for rms in others)

    def rms(self, model: str, rows: Mask) -> float:
        """Root mean square of the errors of some rows [m]; NaN of none."""
        squares = np.sum(self.errors[model][rows] ** 2, axis=1)
        return float(np.sqrt(squares.mean())) if len(squares) else float("nan")

    def to_json(self) -> dict[str, Json]:
        document = {name: statistics.to_json() for name, statistics in self.models.items()}
        for name in self.models if self.outside.any() else ():
            document[name]["rms_outside_training"] = self.rms(name, self.outside)
        rows = {"rows": len(self.data), "rows_outside_training": int(self.outside.sum())}
        return {**document, "improves": self.improves, "frames_refitted": self.refitted, **rows}


def predict_other_file(
    models: Mapping[str, Model], learned: Measurements, other: Measurements, refit_frames: bool
) -> OtherFile:
    """Errors of models on another file, nothing fitted to it, or base and tool alone if ``refit_frames``."""
    other = match_targets(learned, other)
    low, high = learned.q.min(axis=0) - 1e-9, learned.q.max(axis=0) + 1e-9  # rad or m: rounding
    out = (other.q < low) | (other.q > high)
    joints = tuple(name for name, beyond in zip(other.joint_names, out.any(axis=0), strict=True) if beyond)
    errors = {name: errors_on(model, other, refit_frames) for name, model in models.items()}
    return OtherFile(other, errors, out.any(axis=1), joints, refit_frames)


def errors_on(model: Model, other: Measurements, refit_frames: bool) -> Array:
    """(N, 3) position errors [m] of a model on matched measurements; of touched points, about the mean of each.

    model: residuals of the file it was fitted to, and its deviations (k,) [rad, m].
    """
    residuals, x = model
    kept = [i for i, p in enumerate(residuals.parameters) if p.group != "place"]  # places of a file are its own
    there = residuals.of_data(other).with_parameters([residuals.parameters[i] for i in kept])
    if refit_frames:
        return position_errors(*frames_again(there, x[kept]))
    return position_errors(*(there, x[kept]) if other.touches else places_again(there, x[kept]))


def match_targets(learned: Measurements, other: Measurements) -> Measurements:
    """Other measurements with the codes that their targets have in those that taught a model, matched by name."""
    known, file = learned.target_names, other.file
    if len(other.robot_names) > 1:
        raise InputError(Issue("the test file holds several robots", hint="test with one robot at a time", file=file))
    if other.without_orientation().kind.kind != learned.without_orientation().kind.kind:
        seen, taught = other.kind.noun, learned.kind.noun
        raise InputError(
            Issue(f"the test file holds {seen}, the first file {taught}", hint="test with data of one kind", file=file)
        )
    for name in other.target_names:
        if name not in known:
            hint = f"{one_of(name, known)}" if known else "leave out the column: the first file names no targets"
            raise InputError(Issue(f"the first file has no target '{name}'", ("target",), name, hint, file))
    if len(known) > 1 and not other.target_names:
        hint = f"add a column 'target' with one of: {', '.join(known)}"
        raise InputError(Issue("the test file does not say which target it measures", hint=hint, file=file))
    codes = np.array([known.index(name) for name in other.target_names] or [0], dtype=np.intp)
    return replace(other, target=codes[other.target], target_names=known)


@dataclass(frozen=True, eq=False)
class LargeFile:
    """The rows of a file that taught a model, and those that judge it."""

    thinning: Thinning  # which rows were used
    models: Mapping[str, Statistics]  # position errors of the rows left out, by model [m]
    # root mean square of what the standard errors of the fit move the tool by [m]; of n times as many rows it would be
    # smaller by √n
    uncertainty: float

    @classmethod
    def of(cls, thinning: Thinning, models: Mapping[str, tuple[Residuals, Array]], fit: Fit) -> LargeFile:
        """The rows that are left out, predicted by models, each residuals and deviations (k,)."""
        clocked, rest = thinning.clocked, thinning.rest
        errors = {
            name: position_errors(residuals.of_data(clocked).take(rest), x) for name, (residuals, x) in models.items()
        }
        groups = thinning.blocks[rest]
        judged = {name: Statistics.of(e, groups) for name, e in errors.items()}
        return cls(thinning, judged, tool_uncertainty(fit))

    @property
    def left(self) -> float:
        """Root mean square error of the last model on the rows left out [m]."""
        return list(self.models.values())[-1].rms

    def to_json(self) -> dict[str, Json]:
        return {
            **self.thinning.to_json(),
            "left_out": {name: statistics.to_json() for name, statistics in self.models.items()},
            "fit_uncertainty_rms": self.uncertainty,
        }


def tool_uncertainty(fit: Fit) -> float:
    """Root mean square over the rows of what the standard errors of a fit move the tool by [m]: ``√ tr(J C Jᵀ)``."""
    used = fit.residuals
    # 2000 rows: enough for the mean of what parameters do to the tool
    some = used.take(np.unique(np.linspace(0, len(used.data) - 1, 2000).astype(np.intp)))
    J = some.residuals_and_jacobian(fit.x)[1][: some.measured].reshape(len(some.data), some.block, -1)
    L = some.metres(J[:, : len(some.axes)]) @ fit.directions
    return float(np.sqrt(np.einsum("nij,jk,nik->", L, fit.C, L, optimize=True) / len(some.data)))
