"""The arm that a diagnosis delivers: the effects that held-out rows need and that outlast the session, and its file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.cross_validation import Folds, HeldOut, LeftOut, LinearModel, leave_out
from posture_opt.calibration.estimation.error_statistics import Statistics
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.fit_request import nearest_semidefinite, persistent_sources, places_in_robot
from posture_opt.calibration.estimation.residuals import gravity_of
from posture_opt.diagnosis.causes.determined_sizes import (
    determined_parts,
    determines_all,
    places_of_parts,
    stated_parts,
    undetermined,
    with_choice_errors,
    with_mass_errors,
)
from posture_opt.encoding import encoded
from posture_opt.model.effects import Effect, NoiseEffect
from posture_opt.numerics import Array, Codes, Json, rms
from posture_opt.selection.problem_data import FittedArm, ProblemData
from posture_opt.uncertainty.sources import Sources
from posture_opt.validation.calibrated_arm import NOMINAL_KEPT, second_arms
from posture_opt.validation.residual_scatter import residual_scatter


@dataclass(frozen=True, eq=False)
class PredictiveModel:
    calibration: Calibration
    fit: Fit
    kept: tuple[int, ...]
    folds: Folds

    @classmethod
    def of(
        cls, calibration: Calibration, effects: Sequence[Effect], folds: Folds, *, determined: bool = False
    ) -> PredictiveModel:
        """Backward elimination by the RMS on held-out rows: what they are predicted no worse without goes first."""
        kept = tuple(range(len(effects)))
        while True:
            fit = _fitted(calibration, [effects[i] for i in kept])
            model = cls(calibration, fit, kept, folds)
            gone = (undetermined(fit) if determined else []) or model._unneeded()
            if not gone:
                return model
            kept = tuple(i for k, i in enumerate(kept) if k not in gone)

    @cached_property
    def left_out(self) -> LeftOut:
        """Errors on held-out rows, whole and without each effect, everything else fitted again."""
        (linear, columns), fit = self._linear, self.fit
        found = leave_out(fit.residuals, linear, self.folds, columns)
        for i in range(len(columns)):
            m, x = fit.residuals.measured, fit.x + linear.refitted(i)
            x[fit.slices[i]] = 0.0
            expected, left = rms(linear.left_without(i)[:m]), rms(fit.residuals.whitened(x)[:m])
            # Gains are stated to 1 %: there a refit to first order is no refit, and all else is fitted anew.
            if abs(left - expected) > 3e-3 * expected:
                again = _fitted(self.calibration, [effect for k, effect in enumerate(self.fit.effects) if k != i])
                found.without[i] = leave_out(again.residuals, LinearModel.of(again), self.folds, []).whole
        return found

    @cached_property
    def _linear(self) -> tuple[LinearModel, list[Codes]]:
        """The arm to first order about the fit, and the columns of each effect in it."""
        linear = LinearModel.of(self.fit)
        return linear, [np.flatnonzero(linear.owner == i) for i in range(len(self.fit.effects))]

    def _unneeded(self) -> list[int]:
        """The effects that held-out rows need none of, worst first: each judged without those before it."""
        gone: list[int] = []
        linear, columns = self._linear
        if np.all(self.left_out.gains > 0):
            return gone
        held: Codes = np.zeros(0, dtype=np.intp)
        while len(gone) < len(columns):
            left = [i for i in range(len(columns)) if i not in gone]
            together = [held, *(np.union1d(held, columns[i]) for i in left)]
            now, *losses = (rms(e) for e in leave_out(self.fit.residuals, linear, self.folds, together).without)
            worst = int(np.argmin(losses))
            if losses[worst] > now:
                break
            gone.append(left[worst])
            held = together[1 + worst]
        return gone or [int(np.argmin(self.left_out.gains))]


def _fitted(calibration: Calibration, effects: Sequence[Effect]) -> Fit:
    return calibration.fit_effects(calibration.residuals.take(calibration.kept_rows), effects)


# An arm, and the effects that were left out of it -> its errors on held-out rows.
Judge = Callable[[Fit, Sequence[Effect]], HeldOut]

# ``together``: with the rest of the delivered arm alone; the last three: left out, and why.
DeliveredAs = Literal["delivered", "together", "session", "size_undetermined", "no_gain"]


@dataclass(frozen=True, eq=False)
class Delivery:
    """The arm to plan with, by places of effects in the model of all effects.

    Args:
        session: of the session, ``vague`` of undetermined size: all else is fitted for both to be absent.
        dropped: held-out rows are predicted no worse without them.
        together: those of ``kept`` that are sure beside the rest of this very arm only.
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
        if not self.kept:
            return "nominal" if self.nominal else "calibrated"
        return "without_session" if self.session else "extended"

    def status(self, place: int) -> DeliveredAs:
        if place in self.kept:
            return "together" if place in self.together else "delivered"
        if place in self.session:
            return "session"
        return "size_undetermined" if place in self.vague else "no_gain"

    def to_json(self, effects: Sequence[Effect]) -> dict[str, Json]:
        reasons = {"session": self.session, "size_undetermined": self.vague, "no_gain": self.dropped}
        left = [(effects[i], reason) for reason, places in reasons.items() for i in places]
        return {
            "model": self.model,
            "left_out": [{**encoded(e, "kind target"), "reason": r} for e, r in left],
            "together": [encoded(effects[i], "kind target") for i in self.together],
        }


def deliver_arm(
    calibration: Calibration, model: Fit, deviations: Array, held: Mapping[str, HeldOut], parts: Folds, judge: Judge, *,
    with_time: bool = False,
) -> Delivery:  # fmt: skip
    """What is delivered of a model: an arm that predicts held-out rows better than the calibrated one, or that one."""
    stays = [i for i, effect in enumerate(model.effects) if outlasts_session(effect, with_time)]
    session = tuple(i for i in range(len(model.effects)) if i not in stays)
    whole = {i: tuple(range(len(model.effects[i].size_parts))) for i in stays}
    sure = {i: whole[i] if determines_all(model, i) else determined_parts(model, i) for i in stays}
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
        fit = with_mass_errors(with_choice_errors(fit, own), of_payload=False)
    together = tuple(i for k, i in enumerate(kept) if len(stated_parts(fit, k)) < len(fit.effects[k].size_parts))
    dropped = tuple(i for i in stays if i not in kept)
    return Delivery(fit, errors, tuple(kept), session, vague, dropped, together, nominal)


def _of_kept(model: Fit, deviations: Array, fit: Fit, parts: Mapping[int, Sequence[int]]) -> Array:
    """Deviations (S, K, k) of the parameters of a fit that has some parts of effects of a model, from the model's."""
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


def extended_arm(
    problem: ProblemData, calibration: Calibration, model: Fit, delivery: Delivery,
    noises: Sequence[NoiseEffect], statistics: Mapping[str, Statistics],
) -> FittedArm:  # fmt: skip
    """The arm with its fitted geometry and effects, the noise of its joints, and what is uncertain of all together.

    Scatter is what the residuals of the delivered arm leave, split as in `residual_scatter`; gravity is that of the
    base where the fit found it.
    """
    delivered, former = delivery.fit, calibration.fit
    # The calibration with the geometry of the extended arm, and the held-out errors that it leaves. Sums over blocks
    # hold what each row makes of the estimate, and no model of single rows may replace them.
    before = calibration.held["calibrated"]
    errors, kept = before.errors.copy(), calibration.kept_rows
    errors[kept] = calibration.errors[kept] if delivery.nominal else delivery.held.errors
    design = max(calibration.design, delivered.design)
    fit = replace(delivered.keeping([]), residuals=former.residuals, kept=former.kept, design=design)
    fitted = replace(calibration, fit=fit, held={**calibration.held, "calibrated": replace(before, errors=errors)})
    of_arm = [noise for noise in noises if noise.of_arm]
    rows = delivered.whitened.reshape(-1, delivered.residuals.block)[:, : len(delivered.residuals.axes)]
    rows = delivered.residuals.metres(rows)
    if len(rows) == len(calibration.residuals.data):  # where no effect is delivered, outliers are among them
        rows = rows[kept]
    scatter = residual_scatter(problem, fitted, of_arm, rows)
    places = places_in_robot(calibration.parameters)
    x = calibration.x_nominal if delivery.nominal else delivered.x[: len(calibration.x)]
    shift = delivered.x[: len(x)] - x
    covariance = fitted.covariance + np.outer(shift, shift)
    deviations = {name: float(x[i]) for name, i in places.items()}
    base = {name: value for name, value in deviations.items() if name.rpartition(".")[0] == "base"}
    gravity = gravity_of(problem.robot, base)
    header = _file_header(calibration, model, delivery, noises, statistics, scatter.note)
    return FittedArm(
        label="extended",
        deviations=deviations,
        known=_extended_sources(problem, fitted, covariance, delivery).plus(scatter.errors),
        scatter=scatter.without_effects,
        effects=tuple(effect for effect, _ in _written_effects(delivery)),
        noises=tuple(of_arm),
        gravity=None if gravity == problem.robot.gravity else gravity,
        header=header,
        second_arms=second_arms(calibration, x, covariance, "extended", header[:2]),
    )


def _written_effects(delivery: Delivery) -> Iterator[tuple[Effect, list[int]]]:
    """The effects of the file, each with the places of its parameters among those of the fit.

    Marked are those that hold together with the rest of the file only; lines that are sure have their own entry then.
    """
    fit = delivery.fit
    for i, place in enumerate(delivery.kept):
        effect, residuals = fit.effects[i], fit.residuals
        if effect.target in residuals.robot.joint_names:  # with the values of its joint that it was found from
            q = residuals.data.q[:, residuals.robot.joint_names.index(effect.target)]
            effect = effect.measured_over(float(q.min()), float(q.max()))
        every = tuple(range(len(effect.size_parts)))
        sure = every
        if place in delivery.together:
            sure = parts if (parts := stated_parts(fit, i)) != every else ()
        for parts, marked in ((sure, None), (tuple(k for k in every if k not in sure), True)):
            if parts:
                written = effect.of_parts(parts).model_copy(update={"size_undetermined": marked})
                yield written, places_of_parts(fit, i, parts)


def _extended_sources(
    problem: ProblemData, calibration: Calibration, covariance: Array, delivery: Delivery
) -> Sources:  # fmt: skip
    places = places_in_robot(calibration.parameters)
    own = list(places.values())
    written = list(_written_effects(delivery))
    names = tuple(name for effect, _ in written for name in effect.parameter_names)
    sizes = [place for _, own in written for place in own]
    geometry = persistent_sources(problem.robot, problem.sources, list(places), covariance[np.ix_(own, own)]).without(
        names
    )
    together = covariance_at_shapes(delivery.fit)
    k, e = len(geometry.names), len(names)
    cross = together[:, sizes]
    both = np.zeros((k + e, k + e))
    both[:k, :k] = geometry.covariance
    for row, name in enumerate(geometry.names):
        if name in places:
            both[row, k:] = both[k:, row] = cross[places[name]]
    both[k:, k:] = together[np.ix_(sizes, sizes)]
    return Sources((*geometry.names, *names), nearest_semidefinite(both)) if k + e else Sources()


def _file_header(
    calibration: Calibration, model: Fit, delivery: Delivery, noises: Sequence[NoiseEffect],
    statistics: Mapping[str, Statistics], scatter: str,
) -> tuple[str, ...]:  # fmt: skip
    data, effects = calibration.residuals.data, model.effects
    before, middle, after = (f"{statistics[n].rms * 1e3:.3g} mm" for n in ("nominal", "calibrated", "delivered"))
    named = [*(effects[i] for i in delivery.kept), *(noise for noise in noises if noise.of_arm)]
    last = f", {after} with effects" if delivery.kept else ""
    lines = [
        f"Extended by what {Path(data.file).name or 'a table'} ({len(data)} rows) says of the arm: "
        f"{', '.join(f'{cause.kind} of {cause.target}' for cause in named) or 'no effect'}.",
        f"RMS position error on held-out rows: {before} before calibration, {middle} calibrated{last}.",
        *([NOMINAL_KEPT] if delivery.nominal else []),
        "What is still uncertain of its parameters is in extended_covariance.csv, in mm, mrad and SI units.",
        f"{scatter[:1].upper()}{scatter[1:]}.",
    ]
    for places, why in (
        (delivery.session, "it belongs to its session; all else was fitted for it to be absent"),
        (delivery.vague, "the data do not determine its size; all else was fitted for it to be absent"),
        (delivery.dropped, "held-out rows are predicted no worse without it"),
    ):
        if places:
            lines.append(f"Left out, as {why}: {', '.join(effects[i].name for i in places)}.")
    if delivery.together:
        names = ", ".join(effect.name for effect, _ in _written_effects(delivery) if effect.size_undetermined)
        lines.append(f"Sure beside all else in this file only, and no size of a cause (size_undetermined): {names}.")
    read = [noise.name for noise in noises if not noise.of_arm]
    if read:
        lines.append(f"Left out, as it is of the measurement and not of the arm: {', '.join(read)}.")
    return tuple(lines)
