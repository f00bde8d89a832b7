"""Diagnosis: what the simulation gets wrong, its cause by name, and what the extended model gains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from posture_opt.calibration.assumptions.contradictions import GeometricDeviation
from posture_opt.calibration.calibrate import stated_errors
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.cross_validation import HeldOut
from posture_opt.calibration.doubts import Doubt
from posture_opt.calibration.estimation.error_statistics import By, Statistics
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.fit_request import FitRequest
from posture_opt.calibration.second_file import LargeFile
from posture_opt.calibration.start_up import ScatterChange, StartUp, scatter_change, start_up
from posture_opt.calibration.weights import Reading
from posture_opt.diagnosis.cause_statements import CauseAction, cause_actions
from posture_opt.diagnosis.causes.causes import Finding, tool_shifts, unknowable_causes
from posture_opt.diagnosis.causes.delivered_arm import Delivery, extended_arm
from posture_opt.diagnosis.causes.geometry_causes import Correction, determined_corrections
from posture_opt.diagnosis.causes.sessions import Gain, SecondSession
from posture_opt.diagnosis.diagnosis_statements import statements_of
from posture_opt.diagnosis.discrimination_plan import DiscriminationPlan, plan_discrimination
from posture_opt.diagnosis.measured_goals import MeasuredGoals, measured_goals
from posture_opt.diagnosis.noise.noise_causes import NoiseFloor, known_sides, sided_joints
from posture_opt.diagnosis.noise.uneven_noise import RepeatPlan, UnevenErrors, plan_repeats
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate, LinearisedData, linearise_calibration
from posture_opt.diagnosis.scores.lack_of_fit import Adequacy
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.diagnosis.search.search import SearchResult
from posture_opt.encoding import encoded
from posture_opt.measurements.repeats import Contrasts, repeat_groups
from posture_opt.model.effects import StatedSigma
from posture_opt.numerics import Codes, rms, rms_length
from posture_opt.result import Result
from posture_opt.selection.comparison.comparison import Comparison
from posture_opt.selection.problem_data import FittedArm, ProblemData
from posture_opt.statements import Statement
from posture_opt.validation.calibrated_arm import calibrated_models, compare_models
from posture_opt.validation.prediction import prismatic_joints

Outcome = Literal["effects_found", "none_found", "unexplained", "insufficient_data"]


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Result):
    """What measurements say about the cause of an arm's errors.

    `diagnose` makes it. Errors are position errors [m] of rows that the model in question has not seen; ``extended``
    has all effects that were found, ``delivered`` those only that outlast the session and that held-out rows need.

    Args:
        verdict: in a word; ``insufficient_data`` is an exception instead.
        effects: the causes that were found, non-geometric causes first, the largest contribution first.
        request: the arm as stated, the measurements, and what else was asked.
        errors: cross-validated position errors [m] of the arm before calibration (``nominal``), ``calibrated``, and
            with the effects (``extended``), and ``delivered``.
        held: those errors row by row, by model.
        model: the fitted arm with its effects; ``delivery`` the one to plan with, without those of the session.
        unexplained: unnamed components that the residuals need in addition to the effects.
        adequacy: the tests for anything left unexplained.
        uneven: errors that look like a noisy joint, and that repeats do not show to be one.
        groups: (N,) what the cross-validation left out together, of the rows that are no outliers.
        rivals: by the place of an effect in ``model``, the candidates that could replace it.
        test: another file predicted by what this one taught.
        large: what a file of very many rows was thinned to, ``request`` with it; None where all rows were used.
        doubts: what can hardly be as the file of measurements says; copies of rows count once.
        weights: the direction of gravity, and the further mass, that explain the sag of the joints where the file was
            taken to say another; its masses then count as unknown.
    """

    verdict: Outcome
    effects: tuple[Finding, ...]
    request: FitRequest
    calibration: Calibration
    errors: Mapping[str, Statistics]
    held: Mapping[str, HeldOut]
    model: Fit
    delivery: Delivery
    search: SearchResult
    unexplained: tuple[UnnamedComponent, ...]
    adequacy: Adequacy
    uneven: tuple[UnevenErrors, ...]
    by: By
    groups: Codes
    rivals: Mapping[int, Sequence[Candidate]]
    test: SecondSession | None = None
    large: LargeFile | None = None
    weights: tuple[Reading, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def questioned(self) -> bool:
        """Whether the file is hardly as it was read: then nothing that follows from it is for the arm."""
        return self.request.data.better_reading is not None or any(doubt.id != "copies" for doubt in self.doubts)

    @property
    def problem(self) -> ProblemData:
        """What was diagnosed."""
        return self.request.problem

    @cached_property
    def extended(self) -> ProblemData:
        """The ``Problem`` with the arm that was fitted, to be planned with: calibrated, and with its effects.

        It plans and compares like any other problem: effects are parameters of its arm, their errors among its sources.
        """
        return self.problem.with_fit(self.fitted_arm)

    @cached_property
    def fitted_arm(self) -> FittedArm:
        """The arm that is delivered, as a problem takes it over."""
        noises = [f.noise for f in self.effects if f.noise is not None]
        return extended_arm(self.problem, self.calibration, self.model, self.delivery, noises, self.errors)

    @cached_property
    def delivered(self) -> tuple[float, int]:
        """Root mean square [m] of the position errors of ``extended``, as its file has it.

        Its outliers do not count; their number is the second value. Nothing is fitted again but
        touched points and the offsets of several targets, which no file states.
        """
        errors, kept = stated_errors(self.extended, self.request.data, folds=self.request.folds, by=self.by)
        return rms_length(errors[kept]), int(np.count_nonzero(~kept))

    @cached_property
    def models(self) -> dict[str, ProblemData]:
        """The problem before calibration, calibrated and extended, each where the measurements saw base and tool."""
        return {**calibrated_models(self.problem, self.calibration), "extended": self.extended}

    @cached_property
    def comparison(self) -> Comparison | None:
        """The task planned with every model; None where there is no task, or nobody asked."""
        request = self.request
        if not request.plan or self.extended.task is None:
            return None
        return compare_models(self.problem.robot, self.models, seed=request.seed, measured=request.data.q)

    @cached_property
    def goals(self) -> MeasuredGoals | None:
        """What each model would have chosen of the postures measured; None without a comparison, or without such."""
        return None if self.comparison is None else measured_goals(self.model.residuals.data, self.held, self.models)

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """What it has to say, the errors first."""
        return tuple(statements_of(self))

    @property
    def fitted_effects(self) -> tuple[tuple[int, Finding], ...]:
        """(place among the effects of the model, finding) of every named effect."""
        return tuple((f.place, f) for f in self.effects if f.place is not None)

    @property
    def periodic_joints(self) -> list[int]:
        """Joints of which a line of the periodogram is named, largest contribution first."""
        names = list(self.model.residuals.data.joint_names)
        effects = [f.effect for f in self.effects if f.effect is not None and f.effect.spectral_lines]
        return [names.index(joint) for joint in dict.fromkeys(effect.moved_joint for effect in effects)]

    @cached_property
    def actions(self) -> tuple[CauseAction, ...]:
        """What is to be done about each cause, in the order of ``effects``."""
        return cause_actions(self.effects, self.test, self.request.data.touches)

    @property
    def overfitted(self) -> bool:
        """Whether causes are found, and yet every fit predicts unseen rows worse than the arm of the file does."""
        fitted = min(self.errors[name].rms for name in ("calibrated", "extended"))
        return bool(self.effects) and fitted > self.errors["nominal"].rms

    @cached_property
    def corrections(self) -> tuple[Correction, ...]:
        """The geometric parameters of the arm with its effects that the data determine."""
        return determined_corrections(self.calibration, self.model)

    @property
    def unbuildable(self) -> Correction | None:
        """The largest certain correction, where the geometry is a cause and no arm is built with it."""
        sure = (c for c in self.corrections if c.certain)
        largest = max(sure, key=lambda c: c.excess, default=None)
        frames = ("base_frame", "tool_frame")
        geometric = any(isinstance(f.cause, GeometricDeviation) and f.kind not in frames for f in self.effects)
        return largest if largest is not None and largest.excess > 1 and geometric else None

    @cached_property
    def noise_floor(self) -> NoiseFloor:
        """The error that no model can explain."""
        return NoiseFloor.of(self.problem, self.model, self.contrasts)

    @property
    def rounds(self) -> int:
        """Rounds of the cross-validation."""
        return min(self.request.folds, len(np.unique(self.groups)))

    @property
    def held_out_noise(self) -> float:
        """RMS error [m] of held-out rows by noise alone, with what it costs to fit the parameters."""
        return self.noise_floor.held_out(self.model, self.rounds)

    @property
    def like_noise(self) -> bool:
        """Whether the residual error is about as large as noise: nothing more than that is left on average."""
        return self.noise_floor.rms > 0 and self.held_out_noise >= self.errors["extended"].interval[0]

    @property
    def repeats_decide(self) -> bool:
        """Whether repeats of postures are all that is missing to separate scatter from structure."""
        structured = self.unexplained or self.adequacy.p_value < levels.LACK_OF_FIT_LEVEL
        return 0 < len(self.repeat_plans) <= 2 and not structured  # joints that scatter at once

    def shift_at_tool(self, finding: Finding) -> float | None:
        """RMS shift [m] of the tool point in the data that geometry could not imitate; of scatter, its largest σ.

        None of causes that move nothing, or by an open size. ``σ max |J_j|`` of a joint that scatters.
        """
        if not finding.determined:
            return None
        if finding.noise is None or not finding.noise.moved_joint:
            return None if finding.place is None else rms(tool_shifts(self.model, finding)[1])
        residuals = self.model.residuals
        (sigma,) = finding.noise.scatter(residuals.robot).values()
        joint = residuals.robot.joint_names.index(finding.noise.moved_joint)
        moved = residuals.metres(self.linearised.sensitivities.joints[joint][:, : len(residuals.axes)])
        return sigma * float(np.linalg.norm(moved, axis=1).max())

    def fields_json(self) -> dict[str, object]:
        """The document ``diagnosis.json``: SI units and radians; the task planned again included.

        P-values are family-wise; ``unexplained.p_value`` is the least of all tests of what is left.
        """
        names, search = ("nominal", "calibrated", "extended"), self.search
        unnamed = (p for candidate, p in zip(search.chosen, search.p_values, strict=True) if not candidate.named)
        p = min(self.adequacy.p_value, *unnamed, *(errors.p_value for errors in self.uneven), 1.0)
        rivals = {s.what: others for s, others in zip(search.chosen, search.rivals, strict=True) if not s.named}
        planned = self.comparison
        return {
            "verdict": self.verdict,
            "effects": [self._effect_json(finding, i) for i, finding in enumerate(self.effects)],
            "unexplained": {
                "p_value": p,
                "place": self.unexplained_places,
                "tests": encoded(self.adequacy, "lack_of_fit structure"),
                "times_allowed": self.times_allowed,
                "components": [
                    {
                        **encoded(one, "kind target"),
                        "confounded_with": [encoded(s, "kind target") for s in rivals.get(one, ())],
                    }
                    for one in self.unexplained
                ],
                **({"repeat": self.repeat_plans} if self.repeat_plans else {}),
            },
            "residual_rms": {
                **{name: self.errors[name].rms for name in names},
                "delivered": self.delivered[0],
                "delivered_heldout": self.errors["delivered"].rms,
            },
            "delivered": {**self.delivery.to_json(self.model.effects), "outliers": self.delivered[1]},
            "residuals": {name: self.errors[name] for name in names},
            "coverage95": {name: float(self.held[name].inside.mean()) for name in names},
            **encoded(self, "cross_validation=by gain test? thinned=large?"),
            **encoded(self.calibration, "better_than_nominal?"),
            **{reading.key: reading for reading in self.weights},
            **encoded(self, "other_preset=calibration.other_preset? start_up? scatter_change?"),
            "candidates": [
                {
                    **encoded(j, "kind=candidate.kind target=candidate.target p_value"),
                    "gain": 1 - float(np.sqrt(max(1 - j.share, 0.0))),
                    **encoded(j, "surviving_share=rho named=candidate.named"),
                }
                for j in search.scored
            ],
            "absorbed": [{**encoded(s, "kind target"), "surviving_share": rho} for s, rho in search.absorbed],
            "unknowable": unknowable_causes(self.model.residuals),
            **encoded(self, "doubts notes"),
            **({} if planned is None else {"posture": encoded(self, "goals?") | planned.fields_json()}),
        }

    @cached_property
    def start_up(self) -> StartUp | None:
        """First rows that are farther off than the rest, predicted by the arm with its effects.

        Rows to which a joint with play came from an unknown side, as to the first one, err by half of it, warm or not.
        """
        data = self.model.residuals.data
        known = np.flatnonzero(known_sides(self.model, data))
        return start_up(self.held["extended"].errors[known], data.take(known))

    @property
    def unsided_lines(self) -> tuple[int, ...]:
        """Lines that are left out as they are off, and that a joint with play came to from an unknown side."""
        calibration = self.calibration
        data = calibration.residuals.data
        return tuple(int(k) for k in data.line[~calibration.fit.kept & ~known_sides(self.model, data)])

    @cached_property
    def scatter_change(self) -> ScatterChange | None:
        """Where the errors that the arm with its effects leaves are of another size from some row on."""
        residuals = self.model.residuals
        if residuals.data.part is not None:  # instruments of several kinds are of different accuracy
            return None
        left = self.model.whitened.reshape(-1, residuals.block)[:, : len(residuals.axes)]
        return scatter_change(residuals.metres(left), residuals.data)

    @cached_property
    def contrasts(self) -> Contrasts:
        """The differences between repeats of one posture and target, of the rows that are no outliers.

        Where repeats that the arm returned to are few, those of rows that follow each other.
        """
        residuals = self.model.residuals
        found = Contrasts.of(residuals.data, prismatic_joints(residuals), sided_joints(self.model))
        enough = len(found) * residuals.block >= levels.MIN_REPEAT_FREEDOM
        return found if enough else Contrasts.of_readings(residuals.data)

    @cached_property
    def repeat_plans(self) -> tuple[RepeatPlan, ...]:
        """The postures to repeat where errors grow with a joint and too few repeats say whether it scatters."""
        residuals = self.model.residuals
        return plan_repeats(residuals.data, repeat_groups(residuals.data, prismatic_joints(residuals)), self.uneven)

    @property
    def times_allowed(self) -> float | None:
        """So many times what readings, the stated instrument and joints allow the errors are; None where no more."""
        factors = [errors.effect.factor for errors in self.uneven if isinstance(errors.effect, StatedSigma)]
        return max(factors, default=None)

    @property
    def unexplained_places(self) -> tuple[str, ...]:
        """Along what the unexplained is seen: unnamed components, else a variable; and joints that errors grow with."""
        places = [f"{u.kind}: {u.target}" for u in self.unexplained]
        grows = [errors.effect.target for errors in self.uneven]
        if not places and not (grows and 2 * self.adequacy.structure >= levels.LACK_OF_FIT_LEVEL):
            places = [self.adequacy.place]
        return tuple(dict.fromkeys([*places, *grows]))

    @cached_property
    def split(self) -> DiscriminationPlan | None:
        """The measurements that would discriminate the named effects from their rivals; None where they have none."""
        if not self.rivals:
            return None
        return plan_discrimination(self.problem, self.linearised, self.model, self.rivals)

    @cached_property
    def linearised(self) -> LinearisedData:
        """What the search saw, without its null.

        Made again on demand: the null distribution would be most of its memory.
        """
        return linearise_calibration(self.calibration, flips=0)

    @property
    def gain(self) -> Gain:
        """Of all effects together over the calibrated arm, cross-validated.

        ``1 − RMS_extended / RMS_calibrated`` on held-out rows, with a bootstrap interval over the groups.
        """
        return Gain.of(self.held["extended"].errors, self.held["calibrated"].errors, self.groups)

    def test_gain(self, finding: int) -> Gain | None:
        """What an effect brings on the other file; None where there is none, or where it is not asked."""
        place = self.effects[finding].place
        return None if self.test is None or place is None else self.test.gains[place]

    def _effect_json(self, finding: Finding, i: int) -> dict[str, object]:
        """The entry of finding i with the gain on the other file, the tool shift [m] and its discrimination."""
        place, split, gain = finding.place, self.split, self.test_gain(i)
        document = {
            **finding.fields_json(),
            **({} if gain is None else {"test_gain": gain}),
            "inspect": finding.inspect(self.problem.robot),
            "action": self.actions[i].action,
            "reason": self.actions[i].reason or None,
        }
        if place is None:
            return document
        document["delivered"] = self.delivery.status(place)
        if finding.determined:
            alone, beyond = (rms(v) for v in tool_shifts(self.model, finding))
            document["tool_shift_rms"] = {"alone": alone, "beyond_geometry": beyond}
        if split is not None and place in split.pairs:
            document["split"] = split.to_json(place)
        return document
