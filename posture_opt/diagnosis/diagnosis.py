"""Diagnosis: what the simulation gets wrong, its cause by name, and what the extended model gains."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.adequacy import LEVEL, Adequacy, adequacy
from posture_opt.diagnosis.calibration import Calibration, calibrate
from posture_opt.diagnosis.extended import Extended, fit_extended
from posture_opt.diagnosis.gains import HeldOut, held_out
from posture_opt.diagnosis.geometry_names import GeometryCause, geometry_causes
from posture_opt.diagnosis.limits import unknowable
from posture_opt.diagnosis.measurements import Measurements
from posture_opt.diagnosis.noise_causes import NoiseCause, noise_causes
from posture_opt.diagnosis.parameters import CalibrationProblem
from posture_opt.diagnosis.search import Scene, Verdict, search, with_names
from posture_opt.diagnosis.second_session import Gain, SecondSession, second_session
from posture_opt.diagnosis.stages import Stages
from posture_opt.diagnosis.suspects import Suspect
from posture_opt.diagnosis.tangents import Tangents, case_of
from posture_opt.diagnosis.umbrellas import Umbrella
from posture_opt.diagnosis.validation import By, Statistics, folds_of, groups_of
from posture_opt.model.effects import Effect
from posture_opt.units import DIMENSIONS

Array = NDArray[np.float64]
Outcome = Literal["effects_found", "none_found", "unexplained", "insufficient_data"]
Progress = Callable[[int, int], None]

FLIPS, FEW, MANY = 299, 99, 3000
"""Draws of the null, and those for so many rows that nothing hangs on the last digit of a p-value."""


@dataclass(frozen=True, eq=False)
class Finding:
    """One cause with its size.

    Args:
        estimate: parameter -> (value, standard error, SI unit).
        p_value: family-wise, of the data without this cause.
        gain: relative drop of the cross-validated RMS that it brings.
        confounded_with: (kind, target) that could stand for it.
        interval: of the gain, 95 %, by bootstrap over the groups of the cross-validation; of effects alone.
    """

    kind: str
    target: str
    estimate: Mapping[str, tuple[float, float, str]]
    p_value: float
    gain: float
    confounded_with: tuple[tuple[str, str], ...] = ()
    effect: Effect | None = None
    interval: tuple[float, float] | None = None

    def to_json(self) -> dict[str, Any]:
        """The entry of ``effects`` in ``diagnosis.json``."""
        interval = {} if self.interval is None else {"gain_interval95": list(self.interval)}
        return {
            "kind": self.kind,
            "target": self.target,
            "estimate": {n: {"value": v, "std": s, "unit": u} for n, (v, s, u) in self.estimate.items()},
            "p_value": self.p_value,
            "gain": self.gain,
            **interval,
            "confounded_with": [{"kind": k, "target": t} for k, t in self.confounded_with],
        }


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What measurements say about the cause of an arm's errors.

    Args:
        findings: non-geometric causes first, the weightiest first.
        nominal, calibrated, extended: cross-validated position errors [m] of the arm as it stands, calibrated, and
            with the effects.
        held: those errors row by row, by model.
        model: the fitted arm with its effects; ``lasting`` the one without those of time, to plan and predict with.
        unexplained: umbrellas, curves without a name, that the residuals need.
        adequacy: what is left after everything.
        groups: (N,) what the cross-validation left out together, of the rows that are no outliers.
        test: another file predicted by what this one taught.
    """

    outcome: Outcome
    findings: tuple[Finding, ...]
    calibration: Calibration
    nominal: Statistics
    calibrated: Statistics
    extended: Statistics
    held: Mapping[str, HeldOut]
    model: Extended
    lasting: Extended
    search: Verdict
    unexplained: tuple[Umbrella, ...]
    adequacy: Adequacy
    by: By
    groups: NDArray[np.intp]
    test: SecondSession | None = None
    notes: tuple[str, ...] = field(default=())

    @property
    def verdict(self) -> Outcome:
        """``effects_found``, ``none_found``, ``unexplained`` or ``insufficient_data``."""
        return self.outcome

    @property
    def effects(self) -> tuple[Finding, ...]:
        """The same as `findings`."""
        return self.findings

    def to_json(self) -> dict[str, Any]:
        """The document ``diagnosis.json``: SI units and radians."""
        names = ("nominal", "calibrated", "extended")
        p = self.adequacy.p_value
        if self.unexplained and self.search.judged:
            p = min(p, self.search.judged[0].p_value)
        test = {} if self.test is None else {"test": self.test.to_json()}
        return {
            "verdict": self.outcome,
            "effects": [self._effect_json(i) for i in range(len(self.findings))],
            "unexplained": {
                "p_value": p,
                "place": [f"{u.kind}: {u.target}" for u in self.unexplained] or [self.adequacy.place],
            },
            "residual_rms": {name: getattr(self, name).rms for name in names},
            "residuals": {name: getattr(self, name).to_json() for name in names},
            "coverage95": {name: float(self.held[name].inside.mean()) for name in names},
            "cross_validation": self.by,
            "gain": self.gain.to_json(),
            **test,
            "candidates": [
                {
                    "kind": j.suspect.kind,
                    "target": j.suspect.target,
                    "p_value": j.p_value,
                    "gain": 1 - float(np.sqrt(max(1 - j.share, 0.0))),
                    "surviving_share": j.rho,
                    "named": j.suspect.named,
                }
                for j in self.search.judged
            ],
            "absorbed": [
                {"kind": s.kind, "target": s.target, "surviving_share": rho} for s, rho in self.search.absorbed
            ],
            "unknowable": [limit.to_json() for limit in unknowable(self.model.residuals)],
            "notes": list(self.notes),
        }

    def plot(self) -> Any:
        """Each named effect with the errors behind it, or the score of every candidate, as a matplotlib figure."""
        from posture_opt.report.diagnosed import Diagnosed
        from posture_opt.report.figures.diagnosis import plot_scores
        from posture_opt.report.figures.diagnosis_curves import plot_curves

        seen = Diagnosed(self.calibration.residuals.data, self)
        return plot_curves(seen) if seen.effects else plot_scores(seen)

    @property
    def gain(self) -> Gain:
        """Of all effects together over the calibrated arm, cross-validated."""
        return Gain.of(self.held["extended"].errors, self.held["calibrated"].errors, self.groups)

    def test_gain(self, finding: int) -> Gain | None:
        """What an effect brings on the other file; None where there is none, or where it is not asked."""
        if self.test is None or self.findings[finding].effect is None:
            return None
        return self.test.gains[sum(f.effect is not None for f in self.findings[:finding])]

    def _effect_json(self, i: int) -> dict[str, Any]:
        gain = self.test_gain(i)
        return self.findings[i].to_json() | ({} if gain is None else {"test_gain": gain.to_json()})


def diagnose(
    problem: CalibrationProblem,
    data: Measurements,
    *,
    folds: int = 5,
    by: By | None = None,
    flips: int | None = None,
    seed: int = 0,
    test: Measurements | None = None,
    refit_frames: bool = False,
    progress: Progress | None = None,
) -> Diagnosis:
    """Name what the model lacks to explain measurements, at 5 % false alarms for the whole verdict.

    Geometry that the data determine is part of every model. Effects and nameless curves compete by what they
    explain of the rest; the null of all of them together comes from flipping the signs of whole poses.

    Args:
        folds, by: of the cross-validation, as in `calibrate`.
        flips: draws of the null; 299, and of thousands of rows, which need fewer, 99.
        test: other measurements, predicted with nothing refitted, or with base and tool if ``refit_frames``.
        progress: is told how many of how many parts are done.

    Raises:
        InputError: as `calibrate`.
        InsufficientDataError: fewer measurements than unknowns.
    """
    stages = Stages(progress, 20, 55, 5, 20)
    calibration = calibrate(problem, data, folds=folds, by=by, progress=stages.next())
    scene = scene_of(calibration, flips or (FLIPS if len(data) < MANY else FEW), seed)
    found = search(scene, stages.rounds(stages.next()))
    stages.next()
    residuals = scene.tangents.residuals
    nameless = tuple(s.what for s in found.chosen if isinstance(s.what, Umbrella))
    names = with_names(scene, found) if nameless else found
    named = [s for s in names.chosen if isinstance(s.what, Effect)]
    directions = calibration.identifiability.directions
    model = fit_extended(residuals, calibration.x, directions, named)
    stays = [s for s in model.suspects if isinstance(s.what, Effect) and s.what.for_planning]
    lasting = model
    if len(stays) < len(named):  # with what belongs to its session left out, frames and lengths are other ones
        lasting = fit_extended(residuals, calibration.x, directions, stays)
    everything = scene.ground(found.chosen)
    left = adequacy(everything, residuals.data, _points(scene), residuals.block)
    unclear = bool(nameless) or left.p_value < LEVEL
    noise = noise_causes(problem, calibration, model, everything, unclear, seed)
    known = _known_directions(calibration)
    geometry = geometry_causes(residuals, calibration.x_nominal, known, model, named)
    groups_by: By = by or calibration.by
    groups = groups_of(residuals.data, groups_by, folds)
    parts = folds_of(groups, folds, groups_by)
    base = fit_extended(residuals, calibration.x, directions, [])
    tell = stages.next()
    held = {
        "nominal": held_out(fit_extended(residuals, calibration.x_nominal, known, []), parts),
        "calibrated": held_out(base, parts),
        "extended": held_out(model, parts),
    }
    findings = (
        *_effect_findings(names, model, held["extended"], parts, groups, tell),
        *(_noise_finding(n) for n in noise),
        *(_geometry_finding(g, held) for g in geometry),
    )
    outcome: Outcome = "unexplained" if unclear else "effects_found" if findings else "none_found"
    statistics = {name: Statistics.of(h.errors, groups) for name, h in held.items()}
    other = None
    if test is not None:
        other = second_session(problem, test, calibration.x_nominal, base, lasting, refit_frames=refit_frames)
        gains = iter(other.gains)
        each = tuple(next(gains) if isinstance(s.what, Effect) and s.what.for_planning else None for s in named)
        other = replace(other, gains=each)
    stages.end()
    return Diagnosis(
        outcome, findings, calibration, statistics["nominal"], statistics["calibrated"], statistics["extended"],
        held, model, lasting, found, nameless, left, groups_by, groups, other,
        (*calibration.notes, *(() if other is None else other.notes)),
    )  # fmt: skip


def scene_of(calibration: Calibration, flips: int = 299, seed: int = 0) -> Scene:
    """The residuals of a calibrated arm, without its outliers, ready for a search."""
    kept = np.setdiff1d(np.arange(len(calibration.residuals.data)), calibration.outliers)
    residuals = calibration.residuals.take(kept)
    r, J = residuals.both(calibration.x)
    rows = len(kept) * residuals.block
    tangents = Tangents(residuals, calibration.x)
    poses = np.repeat(np.unique(residuals.data.pose, return_inverse=True)[1], residuals.block)
    G = J[:rows] @ calibration.identifiability.directions
    return Scene(tangents, case_of(residuals.data, residuals.robot), r[:rows], G, poses, flips, seed)


def _points(scene: Scene) -> Array:
    n = len(scene.tangents.residuals.data)
    return np.stack([np.broadcast_to(np.asarray(v, dtype=float), (n,)) for v in scene.tangents.walk.position], axis=1)


def _known_directions(calibration: Calibration) -> Array:
    """Directions of what is free in the arm as it stands: frames and touched points."""
    robot = calibration.residuals.robot
    groups = {"point"} | ({"base"} if robot.base_free else set()) | ({"tool"} if robot.tool_free else set())
    columns = [i for i, p in enumerate(calibration.parameters) if p.group in groups]
    k = len(calibration.parameters)
    if not columns:
        return np.zeros((k, 0))
    from posture_opt.diagnosis.identifiability import identify

    J = calibration.residuals.both(calibration.x_nominal)[1][:, columns]
    part = identify([calibration.parameters[i].name for i in columns], J, len(calibration.residuals.data))
    directions = np.zeros((k, part.rank))
    directions[columns] = part.directions
    return directions


def _effect_findings(
    found: Verdict, model: Extended, whole: HeldOut, parts: Any, groups: NDArray[np.intp], tell: Progress
) -> list[Finding]:
    named = [i for i, s in enumerate(found.chosen) if s.named]
    std = model.std
    findings = []
    for place, i in enumerate(named):
        suspect: Suspect = model.suspects[place]
        effect = suspect.what
        assert isinstance(effect, Effect)
        part = model.slices[place]
        estimate = {
            name: (float(v), float(s), _unit(dimension))
            for (name, dimension), v, s in zip(effect.dimensions, model.theta[part], std[part], strict=True)
        }
        for name in effect.shape:
            error = model.shape_std.get(place, float("nan")) if name == "cycles" else float("nan")
            estimate[name] = (float(getattr(effect, name)), error, "")
        gain = Gain.of(whole.errors, held_out(model, parts, without=place).errors, groups)
        rivals = tuple((r.kind, r.target) for r in found.rivals[i])
        fitted = effect.with_estimate(model.theta[part].tolist())
        findings.append(
            Finding(
                effect.kind, effect.target, estimate, found.p_values[i], gain.value, rivals, fitted,
                (gain.low, gain.high),
            )
        )  # fmt: skip
        tell(place + 1, len(named))
    return findings


def _unit(dimension: str) -> str:
    return "1" if dimension == "ratio" else DIMENSIONS[dimension][0]


def _noise_finding(cause: NoiseCause) -> Finding:
    return Finding(cause.kind, cause.target, cause.estimate, cause.p_value, 0.0, cause.confounded_with)


def _geometry_finding(cause: GeometryCause, held: Mapping[str, HeldOut]) -> Finding:
    gain = 1 - held["calibrated"].rms / held["nominal"].rms
    if cause.parameter is None:
        return Finding(cause.kind, cause.target, {}, cause.p_value, gain)
    last = cause.parameter.name.rpartition(".")[2]
    estimate = {last: (cause.deviation, cause.std, cause.parameter.unit)}
    return Finding(cause.kind, cause.target, estimate, cause.p_value, gain, cause.confounded_with)
