"""What is delivered: the fitted arm without effects of its session, the rest fitted for them to be absent."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.cross_validation import Folds, HeldOut
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.causes.determined_sizes import (
    determined_parts,
    determines_all,
    places_of_parts,
    stated_parts,
)
from posture_opt.diagnosis.causes.mass_errors import with_mass_errors
from posture_opt.diagnosis.causes.predictive_effects import PredictiveModel
from posture_opt.diagnosis.causes.selected_sizes import with_choice_errors
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Json

Judge = Callable[[Fit, Sequence[Effect]], HeldOut]
"""An arm, and the effects that were left out of it -> its errors on held-out rows."""

DeliveredAs = Literal["delivered", "together", "session", "size_undetermined", "no_gain"]
"""``together``: with the rest of the delivered arm alone; the last three: left out, and why."""


@dataclass(frozen=True, eq=False)
class Delivery:
    """The arm to plan with.

    Args:
        fit: geometry and the effects that are delivered; ``held`` its errors on rows held out from the fit.
        kept: the places of these effects in the model of all effects.
        session: the places of those that belong to their session: fitted for them to be absent.
        vague: the places of those whose size the data do not determine: fitted for them to be absent, too.
        dropped: the places of the others: compared with the calibrated arm, or without those above, held-out rows are
            predicted no worse without them.
        together: those of ``kept`` that are sure, or some lines of which are, beside the rest of this very arm only:
            what they do together predicts held-out rows; beside other effects each would have another size.
        nominal: whether no effect is delivered, and the geometry of the calibration neither.
    """

    fit: Fit
    held: HeldOut
    kept: tuple[int, ...]
    session: tuple[int, ...] = ()
    vague: tuple[int, ...] = ()
    dropped: tuple[int, ...] = ()
    together: tuple[int, ...] = ()
    nominal: bool = False

    @property
    def model(self) -> Literal["extended", "without_session", "calibrated", "nominal"]:
        """Which arm it is: with all effects, without those of the session, or with none of them."""
        if not self.kept:
            return "nominal" if self.nominal else "calibrated"
        return "without_session" if self.session else "extended"

    def status(self, place: int) -> DeliveredAs:
        """How the effect at a place of the model is delivered, or why it is not."""
        if place in self.kept:
            return "together" if place in self.together else "delivered"
        if place in self.session:
            return "session"
        return "size_undetermined" if place in self.vague else "no_gain"

    def to_json(self, effects: Sequence[Effect]) -> dict[str, Json]:
        """The part ``delivered`` of ``diagnosis.json``; ``effects`` are those of the model."""
        reasons = {"session": self.session, "size_undetermined": self.vague, "no_gain": self.dropped}
        left = [(effects[i], reason) for reason, places in reasons.items() for i in places]
        return {
            "model": self.model,
            "left_out": [{"kind": e.kind, "target": e.target, "reason": r} for e, r in left],
            "together": [{"kind": effects[i].kind, "target": effects[i].target} for i in self.together],
        }


def deliver_arm(
    calibration: Calibration, model: Fit, deviations: Array, held: Mapping[str, HeldOut], parts: Folds, judge: Judge, *,
    with_time: bool = False,
) -> Delivery:  # fmt: skip
    """What is delivered of a model: an arm that predicts held-out rows better than the calibrated one, or that one.

    Effects of the session are still in its data when they are left out of the arm. All else is fitted again for them
    to be absent, so that the arm does to these data what is said of it; a frame or a joint that moved is where it was
    on average. So it is with effects whose size the data do not determine. Others that held-out rows do not need any
    more are left out, too.

    Args:
        model: the arm with all effects; ``held`` its errors and those of the calibrated arm on held-out rows.
        judge: errors of an arm that lacks some effects, chosen in each fold as those of ``held`` are.
        with_time: keep effects of time.
    """
    stays = [i for i, effect in enumerate(model.effects) if outlasts_session(effect, with_time)]
    session = tuple(i for i in range(len(model.effects)) if i not in stays)
    sure = {i: _sure_parts(model, i) for i in stays}
    vague = tuple(i for i in stays if not sure[i])
    stays = [i for i in stays if sure[i]]
    rests = (model.effects[i].without_parts(sure[i]) for i in stays)
    gone = [*(model.effects[i] for i in (*session, *vague)), *(rest for rest in rests if rest is not None)]
    fit, errors, kept = model, held["extended"], stays
    if gone:
        effects = [model.effects[i].of_parts(sure[i]) for i in stays]
        needed = PredictiveModel.of(calibration, effects, parts, determined=True)
        fit, kept = needed.fit, [stays[k] for k in needed.kept]
        errors = judge(fit, gone)
    least = min(held["calibrated"].rms, held["nominal"].rms)
    nominal = errors.rms >= least and calibration.keeps_nominal
    if errors.rms >= least:
        fit, errors, kept = calibration.fit, held["nominal" if nominal else "calibrated"], []
    if kept:
        own = _of_kept(model, deviations, fit, {i: sure[i] for i in kept})
        fit = with_mass_errors(with_choice_errors(fit, own))
    together = tuple(i for k, i in enumerate(kept) if len(stated_parts(fit, k)) < len(fit.effects[k].size_parts))
    dropped = tuple(i for i in stays if i not in kept)
    return Delivery(fit, errors, tuple(kept), session, vague, dropped, together, nominal)


def _sure_parts(model: Fit, place: int) -> tuple[int, ...]:
    """The parts of an effect that are delivered: all, if its size as a whole is determined, else the sure ones."""
    if determines_all(model, place):
        return tuple(range(len(model.effects[place].size_parts)))
    return determined_parts(model, place)


def _of_kept(model: Fit, deviations: Array, fit: Fit, parts: Mapping[int, Sequence[int]]) -> Array:
    """Deviations (S, K, k) of the parameters of a fit that has some parts of effects of a model, from the model's.

    The cycles of a line that is all that is left of several were not fitted there: they have none.

    Args:
        parts: place of an effect in the model -> those of its parts that the fit has.
    """
    found = np.zeros((*deviations.shape[:-1], len(fit.x)))
    geometry = model.places_of([])
    found[..., : len(geometry)] = deviations[..., geometry]
    for place, i in enumerate(parts):
        own = fit.slices[place]
        found[..., own] = deviations[..., places_of_parts(model, i, parts[i])]
        if place in fit.shapes and i in model.shapes:
            found[..., fit.shapes[place]] = deviations[..., model.shapes[i]]
    return found


def nearer_to(effect: Effect, gone: Sequence[Effect], kept: Sequence[Effect]) -> bool:
    """Whether an effect that a fold chose is one of those that are gone; a line, of the lines next to it."""
    among = [[o for o in some if (o.kind, o.target) == (effect.kind, effect.target)] for some in (gone, kept)]
    far = [[abs(k - own) for o in some for k in o.spectral_lines for own in effect.spectral_lines] for some in among]
    return bool(among[0]) and (not among[1] or min(far[0], default=0.0) <= min(far[1], default=0.0))


def outlasts_session(effect: Effect, with_time: bool = False) -> bool:
    """Whether an effect is of the arm and not of the session in which it was measured."""
    return effect.for_planning or (with_time and "time" in effect.needs)


def covariance_at_shapes(fit: Fit) -> Array:
    """Covariance (k, k) of an estimate whose effects have their shapes held where they were found.

    The covariance of the estimate lets the shapes vary: the errors of sine and cosine are then correlated with that of
    the cycles, and larger than the error of their sum in the data. With the shape held it is ``A C Aᵀ``, ``A = [I,
    B⁺D]``: what an error of the shape does to the data, D, as far as the columns B of the effect can express it.
    """
    A = np.eye(len(fit.x))
    for i, shape in fit.shapes.items():
        B, D = fit.effect_columns(i), fit.jacobian[:, shape]
        A[shape, shape] = 0.0
        if np.any(D):
            A[fit.slices[i], shape] = np.linalg.lstsq(B, D, rcond=None)[0]
    return np.asarray(A @ fit.covariance @ A.T)
