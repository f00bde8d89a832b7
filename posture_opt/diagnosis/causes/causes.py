"""Findings: each cause that a diagnosis names, with its size, gain and plausibility."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.effect_sensitivities import case_of
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.diagnosis.causes.delivered_arm import PredictiveModel
from posture_opt.diagnosis.causes.determined_sizes import (
    is_determined,
    places_of_parts,
    stated_parts,
    turn_about_mean,
    turns_of,
)
from posture_opt.diagnosis.causes.sessions import Gain
from posture_opt.diagnosis.noise.uneven_noise import NoiseCause
from posture_opt.diagnosis.search.search import SearchResult
from posture_opt.encoding import Encoded, encoded
from posture_opt.model.effects import (
    CATALOGUE,
    EFFECTS,
    INPUTS,
    ROWS,
    Cause,
    Effect,
    Evidence,
    FittedSizes,
    Limit,
    NoiseEffect,
)
from posture_opt.model.effects.base.joint_effect import GravityLoaded, LostMotion
from posture_opt.model.effects.base.multiples import RotatingPart, resolution
from posture_opt.model.effects.base.plausible_range import PlausibleRange
from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Robot
from posture_opt.units import DIMENSIONS

_SI_UNITS = {dimension: si for dimension, (si, _) in DIMENSIONS.items()} | {"ratio": "1"}
Estimates = Mapping[str, tuple[float, float, str]]  # parameter -> value, standard error, SI unit


@dataclass(frozen=True, eq=False)
class Finding(Encoded):
    """One cause with its size.

    Args:
        estimate: parameter -> (value, standard error, SI unit); the total with what the file has, ``stated``.
        p_value: family-wise, of the data without this cause.
        gain: relative drop of the RMS of held-out rows by it, all else fitted again without it; ``interval`` 95 %.
        determined: whether the data determine the size, whatever else is chosen beside it; else it is stated nowhere.
        place: of an effect among those of the model; ``stated_parts`` those of its parts that the cause is of, and
            ``open_part`` the rest, lines that the data do not determine beside others.
        refuted_sigma: of a statement of the file that the data refute, its σ [SI], 0 where it was exact; it is found
            before the search: the arm has it, and the model fits no size of it.
        would_need: what would have to be true for a size beyond ``plausible_range``; else empty.
        parts: of its joint that turn as often as it repeats.
    """

    cause: Cause
    estimate: Estimates
    p_value: float
    gain: float
    confounded_with: tuple[Cause, ...] = ()
    interval: tuple[float, float] | None = None
    determined: bool = True
    place: int | None = None
    stated_parts: tuple[int, ...] = (0,)
    open_part: Effect | None = None
    stated: Effect | None = None
    refuted_sigma: float | None = None
    plausible_range: PlausibleRange | None = None
    would_need: str = ""
    parts: tuple[RotatingPart, ...] = ()
    fitted: FittedSizes | None = None

    @classmethod
    def independent(
        cls, cause: Cause, estimate: Estimates, p_value: float, gain: float, confounded_with: tuple[Cause, ...]
    ) -> Finding:
        sizes = ((np.array([value]), np.array([[std**2]])) for value, std, _ in estimate.values())
        determined = all(is_determined(*size) for size in sizes)
        return cls(cause, estimate, p_value, gain, confounded_with, determined=determined)

    @property
    def sizes(self) -> FittedSizes:
        return self.fitted or FittedSizes(self.estimate)

    @property
    def label(self) -> str:
        return self.cause.labelled(self.sizes)

    @property
    def size_text(self) -> str:
        return self.cause.headline(self.sizes) if self.determined else ""

    @property
    def leads(self) -> bool:
        """Whether it is lost motion by which the joint goes beyond its command."""
        return isinstance(self.cause, LostMotion) and self.cause.leads(self.sizes)

    @property
    def plausible(self) -> bool:
        return not self.would_need

    @property
    def kind(self) -> str:
        return self.cause.kind

    @property
    def target(self) -> str:
        return self.cause.target

    @property
    def effect(self) -> Effect | None:
        """The cause, if it moves the tool point beyond the geometry, by a size that the model fits."""
        return self.cause if isinstance(self.cause, Effect) and self.refuted_sigma is None else None

    @property
    def noise(self) -> NoiseEffect | None:
        """The cause, if it spreads the tool point or its measurements."""
        return self.cause if isinstance(self.cause, NoiseEffect) else None

    def inspect(self, robot: Robot) -> str:
        return self.cause.inspect_fitted(robot, self.sizes)

    def fields_json(self) -> dict[str, object]:
        stated = {name: {"stated": value} for name, value in _named_values(self.stated).items()}

        def alias(rival: Cause) -> bool:
            same = (rival.kind, rival.target) == (self.kind, self.target)
            return same and rival.qualifier != self.cause.qualifier

        return {
            **encoded(self, "kind target"),
            "status": "determined" if self.determined else "size_undetermined",
            "estimate": {
                n: {"value": v, "std": s, "unit": u, **stated.get(n, {})}
                for n, (v, s, u) in self.estimate.items()
                if self.determined
            },
            **encoded(self, "p_value gain gain_interval95=interval?"),
            "confounded_with": [
                encoded(c, "kind target qualifier" if alias(c) else "kind target") for c in self.confounded_with
            ],
            **encoded(self, "refuted_sigma? plausible"),
            "would_need": self.would_need or None,
            **encoded(self, "plausible_range?"),
            **({"rotating_parts": self.parts} if self.parts else {}),
            **({} if self.open_part is None else {"undetermined_lines": self.open_part.spectral_lines}),
        }


def effect_findings(
    found: SearchResult,
    predictive: PredictiveModel,
    model: Fit,
    groups: Codes,
    unrefuted: Mapping[int, tuple[Effect, ...]],
) -> list[Finding]:
    """The named effects of a search with their fitted sizes, and what held-out rows lose without each, most first."""
    left = predictive.left_out
    findings = []
    for place, i in enumerate(i for i, s in enumerate(found.chosen) if s.named):
        gain = Gain.of(left.whole, left.without[place], groups)
        effect, sure = model.effects[place], stated_parts(model, place)
        parts = sure or tuple(range(len(effect.size_parts)))
        finding = Finding(
            effect.of_parts(parts),
            _estimates_of(model, place, parts),
            found.p_values[i],
            gain.value,
            (*(r.what for r in found.rivals[i]), *unrefuted.get(i, ())),
            (gain.low, gain.high),
            determined=bool(sure),
            place=place,
            stated_parts=parts,
            open_part=effect.without_parts(parts),
            stated=_stated_effect(model, place),
        )
        findings.append(finding)
    return sorted(findings, key=lambda finding: -finding.gain)


def _stated_effect(model: Fit, place: int) -> Effect | None:
    name = model.residuals.parameters[model.slices[place].start].name
    own = next(e for e in model.residuals.arm.effects if name in e.parameter_names)
    return own if any(own.values) else None


def _named_values(effect: Effect | None) -> dict[str, float]:
    """Parameter of an effect -> its value [SI]; nothing of no effect."""
    return {} if effect is None else {name: v for (name, _), v in zip(effect.dimensions, effect.values, strict=True)}


def _estimates_of(model: Fit, place: int, parts: Sequence[int] = (0,)) -> dict[str, tuple[float, float, str]]:
    """Parameter, or shape, -> (value, standard error, SI unit), with what the file states of it."""
    effect, own = model.effects[place].of_parts(parts), _stated_effect(model, place)
    known, part = _named_values(own), places_of_parts(model, place, parts)
    rows = zip(effect.dimensions, model.x[part], model.std[part], strict=True)
    estimate = {n: (known.get(n, 0.0) + float(v), float(s), _SI_UNITS[dimension]) for (n, dimension), v, s in rows}
    for name in effect.shape:
        value = float(getattr(effect, name))
        fitted = place in model.shapes and name == effect.smooth_shape
        error = float(model.std[model.shapes[place]]) if fitted else math.nan
        unit = effect.shape_units.get(name, "1")
        unit = ROWS if unit == "s" and model.residuals.data.time is None else unit
        estimate[name] = (value, value * error if effect.relative_shape else error, unit)
    return estimate


def tool_shifts(model: Fit, finding: Finding) -> tuple[Array, Array]:
    """(N,) how far a cause moves the tool point in each row [m], and the part of it that geometry cannot imitate."""
    assert finding.place is not None
    residuals = model.residuals
    own = places_of_parts(model, finding.place, finding.stated_parts)
    moved = model.jacobian[:, own] @ model.x[own]
    U = model.imitating
    both = (v.reshape(-1, residuals.block)[:, : len(residuals.axes)] for v in (moved, moved - U @ (U.T @ moved)))
    alone, beyond = (np.linalg.norm(residuals.metres(v), axis=1) for v in both)
    return np.asarray(alone), np.asarray(beyond)


def noise_finding(cause: NoiseCause) -> Finding:
    return Finding.independent(cause.effect, cause.estimate, cause.p_value, 0.0, cause.confounded_with)


def contradiction_findings(calibration: Calibration) -> list[Finding]:
    refuted = (c for c in calibration.contradictions if c.gain > 0)
    return [Finding(c.cause, c.estimate, c.p_value, c.gain, refuted_sigma=c.sigma) for c in refuted]


def unknowable_causes(residuals: Residuals) -> tuple[Limit, ...]:
    """Causes that are not identifiable from data of this kind, whatever their size."""
    lengths = [p.name for p in residuals.parameters if p.group == "geometry" and p.unit == "m" and abs(p.nominal) > 0]
    evidence = Evidence(residuals.data.kind.fixes_size, tuple(lengths))
    return tuple(limit for kind in CATALOGUE if (limit := kind.unknowable(evidence)) is not None)


def missing_inputs(residuals: Residuals) -> dict[str, tuple[str, str, tuple[str, ...]]]:
    """Input that the files lack -> what it is, how to supply it, and the kinds of effects that need it."""
    excitation = case_of(residuals.data, residuals.robot)
    have = set(excitation.inputs)
    if any(np.isfinite(j.gear_ratio) for j in residuals.robot.joints):
        have.add("gear_ratio")
    missing: dict[str, list[str]] = {}
    for kind in EFFECTS:
        for lacking in sorted(kind.needs - have):
            missing.setdefault(lacking, []).append(kind.kind_name())
    return {key: (needed.words, needed.hint, tuple(missing[key])) for key, needed in INPUTS.items() if key in missing}


def with_plausibility(findings: Sequence[Finding], model: Fit, robot: Robot) -> list[Finding]:
    """Effects of a fit with their range, what they would need beyond it, and the parts that repeat.

    A cause beyond its range has competed with all others and stays: the data look like it.
    """
    kinds = [finding.kind for finding in findings]
    found = []
    for k, finding in enumerate(findings):
        effect = finding.effect
        assert effect is not None
        sizes = _sizes_of(model, finding)
        rank, count, most = kinds[: k + 1].count(effect.kind), kinds.count(effect.kind), effect.most_in_session
        need = _would_need(effect, finding, sizes, model, robot)
        # One collision may move a joint and the tool; more than two things at once are another arm or session.
        if most is not None and (rank > most or count > 2):
            rare = f"{count} of them in one session, where more than {most} is rare"
            need = f"{rare}: rather other arms or sessions, or a drift"
        found.append(
            replace(
                finding,
                plausible_range=effect.plausible(robot),
                would_need=need,
                parts=effect.rotating_parts(robot),
                fitted=sizes,
            )
        )
    return found


def _sizes_of(model: Fit, finding: Finding) -> FittedSizes:
    """Estimate, covariance, turn, range and resolution of the joint that a finding moves [rad]; 0 if none."""
    place, data = finding.place, model.residuals.data
    assert place is not None
    part = places_of_parts(model, place, finding.stated_parts)
    turned = turns_of(model, place)[:, :, [k - model.slices[place].start for k in part]] @ model.x[part]
    if len(turned) > 1:  # the parts of a tilt vary one by one
        turned = np.linalg.norm(turned, axis=0)
    moved = finding.cause.moved_joint
    q = data.q[:, data.joint_names.index(moved)] if moved in data.joint_names else None
    seen = (0.0, 0.0) if q is None else (float(np.ptp(q)), resolution(q))
    rms = turn_about_mean(model, place, finding.stated_parts)
    turn = float(turned.min()), float(turned.max())
    return FittedSizes(finding.estimate, model.covariance[np.ix_(part, part)], turn, rms, *seen)


def _would_need(effect: Effect, finding: Finding, sizes: FittedSizes, model: Fit, robot: Robot) -> str:
    """What would have to be true for a cause to be what it looks like; empty if it can be."""
    known = effect.plausible(robot)
    if known is None or not finding.determined:
        return ""
    assert finding.place is not None
    against = bool(np.all(model.x[model.slices[finding.place]] < 0))
    if isinstance(effect, GravityLoaded) and effect.unstated_loads and against:
        return "gravity compensation, in the controller or by springs, that does too much: it rises against its load"
    value, std = effect.plausible_size(sizes)
    return "" if known.holds(value, std) else known.would_need(value)
