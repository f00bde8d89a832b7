"""Findings: each cause that a diagnosis names, with its size and gain; and causes that the data cannot show."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.effect_sensitivities import case_of
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.diagnosis.causes.determined_sizes import is_determined, places_of_parts, stated_parts
from posture_opt.diagnosis.causes.geometry_causes import GeometryCause
from posture_opt.diagnosis.causes.predictive_effects import PredictiveModel
from posture_opt.diagnosis.causes.sessions import Gain
from posture_opt.diagnosis.noise.uneven_noise import NoiseCause
from posture_opt.diagnosis.search.search import SearchResult
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
from posture_opt.model.effects.base.lost_motion import LostMotion
from posture_opt.model.effects.base.plausible_range import PlausibleRange
from posture_opt.model.effects.base.rotating_parts import RotatingPart
from posture_opt.numerics import Array, Codes, Json
from posture_opt.robot.robot import Robot
from posture_opt.units import DIMENSIONS


@dataclass(frozen=True, eq=False)
class Finding:
    """One cause with its size.

    Args:
        cause: what it is; an effect or a kind of noise as in a problem file.
        estimate: parameter -> (value, standard error, SI unit).
        p_value: family-wise, of the data without this cause.
        gain: relative drop of the RMS of held-out rows by it, everything else fitted again without it.
        confounded_with: causes that could replace it.
        interval: of the gain, 95 %, by bootstrap over the groups of the cross-validation; of effects alone.
        determined: whether the data determine the size, whatever else is chosen beside it; else it is stated nowhere.
        place: of an effect among those of the model; ``stated_parts`` those of its parts that the cause is of.
        open_part: the rest of that effect: lines that the data do not determine beside others; it is stated nowhere.
        stated: the effect as the problem file has it; ``estimate`` is its total then.
        refuted_sigma: of a statement of the file that the data refute, its σ [SI], 0 where it was exact; else None. It
            is found before the search: the arm has it, and the model fits no size of it.
        plausible_range: the sizes that such a cause can have on this arm; None where none is known to be impossible.
        would_need: what would have to be true for it to be this cause, where its size is beyond that range; else empty.
        parts: of its joint that turn as often as it repeats.
        fitted: what the fit says of its size, with what the data are like; None of what is no effect.
    """

    cause: Cause
    estimate: Mapping[str, tuple[float, float, str]]
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

    @property
    def sizes(self) -> FittedSizes:
        """Its size as words and inspections need it."""
        return self.fitted or FittedSizes(self.estimate)

    @property
    def label(self) -> str:
        """Kind and target, as its size has them."""
        return self.cause.labelled(self.sizes)

    @property
    def size_text(self) -> str:
        """The size that is shown with its words; empty where no single number says it, or no data."""
        return self.cause.headline(self.sizes) if self.determined else ""

    @property
    def leads(self) -> bool:
        """Whether it is lost motion by which the joint goes beyond its command."""
        return isinstance(self.cause, LostMotion) and self.cause.leads(self.sizes)

    @property
    def plausible(self) -> bool:
        """Whether an arm can have this cause in this size, by what is published."""
        return not self.would_need

    @property
    def status(self) -> Literal["determined", "size_undetermined"]:
        """Whether the data determine the size, in a word of the document."""
        return "determined" if self.determined else "size_undetermined"

    @property
    def kind(self) -> str:
        """The name of the cause in files."""
        return self.cause.kind

    @property
    def target(self) -> str:
        """What the cause is of, as in files."""
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
        """What to look at on the arm, in one line."""
        return self.cause.inspect_fitted(robot, self.sizes)

    def _rival_json(self, rival: Cause) -> dict[str, str]:
        """Kind and target; of an alias, which has both in common with this cause, what distinguishes it."""
        named = {"kind": rival.kind, "target": rival.target}
        alias = (rival.kind, rival.target) == (self.kind, self.target) and rival.qualifier != self.cause.qualifier
        return {**named, "qualifier": rival.qualifier} if alias else named

    def to_json(self) -> dict[str, Json]:
        """The entry of ``effects`` in ``diagnosis.json``."""
        interval = {} if self.interval is None else {"gain_interval95": list(self.interval)}
        of_file = {} if self.stated is None else _named_values(self.stated)
        stated = {name: {"stated": value} for name, value in of_file.items()}
        return {
            "kind": self.kind,
            "target": self.target,
            "status": self.status,
            "estimate": {
                n: {"value": v, "std": s, "unit": u, **stated.get(n, {})}
                for n, (v, s, u) in self.estimate.items()
                if self.determined
            },
            "p_value": self.p_value,
            "gain": self.gain,
            **interval,
            "confounded_with": [self._rival_json(c) for c in self.confounded_with],
            **({} if self.refuted_sigma is None else {"refuted_sigma": self.refuted_sigma}),
            "plausible": self.plausible,
            "would_need": self.would_need or None,
            **({} if self.plausible_range is None else {"plausible_range": self.plausible_range.to_json()}),
            **({"rotating_parts": [part.to_json() for part in self.parts]} if self.parts else {}),
            **({} if self.open_part is None else {"undetermined_lines": list(self.open_part.spectral_lines)}),
        }


def effect_findings(
    found: SearchResult,
    predictive: PredictiveModel,
    model: Fit,
    groups: Codes,
    unrefuted: Mapping[int, tuple[Effect, ...]],
) -> list[Finding]:
    """The named effects of a search with their fitted sizes, and what held-out rows lose without each, most first.

    Args:
        predictive: the arm with these effects; ``model`` the same with the standard errors of the choice, too.
        groups: what its folds leave out together.
        unrefuted: by place among the chosen, further effects that could replace it.
    """
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
    """The effect in the file that a fitted one adds to."""
    name = model.residuals.parameters[model.slices[place].start].name
    own = next(e for e in model.residuals.arm.effects if name in e.parameter_names)
    return own if any(own.values) else None


def _named_values(effect: Effect) -> dict[str, float]:
    """Parameter of an effect -> its value [SI]."""
    names = (name for name, _ in effect.dimensions)
    return dict(zip(names, effect.values, strict=True))


def _estimates_of(model: Fit, place: int, parts: Sequence[int] = (0,)) -> dict[str, tuple[float, float, str]]:
    """Parameter, or shape, -> (value, standard error, SI unit), with what the file states of it.

    Args:
        parts: those of the effect that are stated.
    """
    effect, own = model.effects[place].of_parts(parts), _stated_effect(model, place)
    known, part = {} if own is None else _named_values(own), places_of_parts(model, place, parts)
    rows = zip(effect.dimensions, model.x[part], model.std[part], strict=True)
    estimate = {n: (known.get(n, 0.0) + float(v), float(s), _si_unit(dimension)) for (n, dimension), v, s in rows}
    for name in effect.shape:
        value = float(getattr(effect, name))
        fitted = place in model.shapes and name == effect.smooth_shape
        error = float(model.std[model.shapes[place]]) if fitted else math.nan
        unit = effect.shape_units.get(name, "1")
        unit = ROWS if unit == "s" and model.residuals.data.time is None else unit
        estimate[name] = (value, value * error if effect.relative_shape else error, unit)
    return estimate


def tool_shifts(model: Fit, finding: Finding) -> tuple[Array, Array]:
    """(N,) how far a cause moves the tool point in each row [m], and the part of it that geometry cannot imitate.

    Args:
        finding: of an effect of the model.
    """
    assert finding.place is not None
    residuals = model.residuals
    own = places_of_parts(model, finding.place, finding.stated_parts)
    moved = model.jacobian[:, own] @ model.x[own]
    U = model.imitating
    both = (v.reshape(-1, residuals.block)[:, : len(residuals.axes)] for v in (moved, moved - U @ (U.T @ moved)))
    alone, beyond = (np.linalg.norm(residuals.metres(v), axis=1) for v in both)
    return np.asarray(alone), np.asarray(beyond)


def _si_unit(dimension: str) -> str:
    """The SI unit of a dimension of parameters; 1 of a ratio."""
    return "1" if dimension == "ratio" else DIMENSIONS[dimension][0]


def noise_finding(cause: NoiseCause) -> Finding:
    """A kind of noise as a finding: it brings nothing to the errors themselves."""
    clear = _all_determined(cause.estimate)
    return Finding(cause.effect, cause.estimate, cause.p_value, 0.0, cause.confounded_with, determined=clear)


def contradiction_findings(calibration: Calibration) -> list[Finding]:
    """What the file states as known and the data refute, as findings; the gain is that of setting it aside.

    They are found before the search: the model has no size of them to fit.
    """
    return [
        Finding(c.cause, c.estimate, c.p_value, c.gain, refuted_sigma=c.sigma)
        for c in calibration.contradictions
        if c.gain > 0
    ]


def geometry_finding(cause: GeometryCause) -> Finding:
    """A geometric cause as a finding."""
    clear = _all_determined(cause.estimate)
    return Finding(cause.deviation, cause.estimate, cause.p_value, cause.gain, cause.confounded_with, determined=clear)


def _all_determined(estimate: Mapping[str, tuple[float, float, str]]) -> bool:
    """Whether each of independent estimates is determined."""
    return all(is_determined(np.array([value]), np.array([[std**2]])) for value, std, _ in estimate.values())


def unknowable_causes(residuals: Residuals) -> tuple[Limit, ...]:
    """Causes that are not identifiable from data of this kind, whatever their size.

    Returns:
        One limit for each kind of cause that says so of these data, as the scale of an instrument of an arm with free
            lengths.
    """
    lengths = [p.name for p in residuals.parameters if p.group == "geometry" and p.unit == "m" and abs(p.nominal) > 0]
    evidence = Evidence(residuals.data.kind.fixes_size, tuple(lengths))
    return tuple(limit for kind in CATALOGUE if (limit := kind.unknowable(evidence)) is not None)


def missing_inputs(residuals: Residuals) -> dict[str, tuple[str, str, tuple[str, ...]]]:
    """Input that the files lack -> what it is, how to supply it, and the kinds of effects that need it.

    Compliances are searched for without the masses of the links too: they are unknowns then.
    """
    excitation = case_of(residuals.data, residuals.robot)
    have = set(excitation.inputs)
    if any(np.isfinite(j.gear_ratio) for j in residuals.robot.joints):
        have.add("gear_ratio")
    missing: dict[str, list[str]] = {}
    for kind in EFFECTS:
        for lacking in sorted(kind.needs - have):
            missing.setdefault(lacking, []).append(kind.kind_name())
    return {key: (needed.words, needed.hint, tuple(missing[key])) for key, needed in INPUTS.items() if key in missing}
