"""Diagnosis of several robots of one type: lengths that vary together from robot to robot, and which joint is noisy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from posture_opt.batch.batch_calibration import Batch, batch_findings, calibrate_batch
from posture_opt.batch.batch_covariance import CorrelatedPair
from posture_opt.calibration.estimation.error_statistics import By
from posture_opt.diagnosis.causes.causes import Finding, noise_finding
from posture_opt.diagnosis.diagnosis import Outcome
from posture_opt.diagnosis.diagnosis_statements import uneven_statements
from posture_opt.diagnosis.noise.noise_causes import noise_samples
from posture_opt.diagnosis.noise.uneven_noise import NoiseCause, NoiseSample, UnevenErrors, find_uneven_noise
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import linearise_calibration
from posture_opt.interrupts import interruptible
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import CorrelatedLengths
from posture_opt.numerics import Json, Progress
from posture_opt.result import Result
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Statement, state


@dataclass(frozen=True, eq=False, repr=False)
class BatchDiagnosis(Result):
    """The causes that a batch shows and no single robot can: correlated lengths; and the noise that all share.

    Args:
        batch: the calibrations that were diagnosed.
        effects: correlated lengths that the file does not state, then noise; each with size and p-value.
        by: the groups that each calibration's cross-validation left out together.
        uneven: errors that grow with a joint, and that repeats do not show to be scatter.
    """

    batch: Batch
    effects: tuple[Finding, ...]
    by: By
    uneven: tuple[UnevenErrors, ...] = ()

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """The causes; errors that only look like noise; what the batch itself has to say."""
        if self.effects:
            first = state("batch.causes", causes=[f.cause.label for f in self.effects])
        else:
            first = state("batch.unidentified") if self.uneven else state("batch.explained")
        return (first, *uneven_statements(self.uneven), *batch_findings(self.batch))

    @property
    def verdict(self) -> Outcome:
        """``unexplained`` where errors are uneven and repeats do not show why."""
        return "unexplained" if self.uneven else "effects_found" if self.effects else "none_found"

    def fields_json(self) -> dict[str, Json]:
        """The document ``diagnosis.json`` of a batch."""
        rms = {"nominal": self.batch.nominal.rms, "calibrated": self.batch.calibrated.rms}
        shares = {name: share for name, (share, _) in self.batch.coverage.items()}
        calibrated = shares.get("calibrated")
        return {
            "verdict": self.verdict,
            "effects": [finding.to_json() for finding in self.effects],
            "unexplained": {
                "p_value": min((u.p_value for u in self.uneven), default=1.0),
                "place": [u.effect.target for u in self.uneven],
            },
            "residual_rms": {**rms, "extended": self.batch.calibrated.rms},
            "coverage95": {**shares, "extended": calibrated},
            "cross_validation": self.by,
            "candidates": [
                {"kind": found.kind, "target": found.target, "p_value": found.p_value, "gain": 0.0}
                for found in map(_correlation_finding, self.batch.pairs)
            ],
            "notes": list(self.batch.notes),
            **self.batch.thinned_json,
            "batch": self.batch.fields_json()["batch"],
        }


@interruptible()
def diagnose_batch(
    problem: ProblemData,
    data: Measurements,
    *,
    folds: int = 5,
    by: By | None = None,
    seed: int | None = None,
    most_rows: int = levels.MAX_SEARCHED_ROWS,
    progress: Progress | None = None,
) -> BatchDiagnosis:
    """What measurements of several robots of one type say that those of one cannot.

    The p-values of the pairs are adjusted by Holm's (1979) rule over all pairs; a pair whose stated correlation lies in
    its 95 % interval is no finding.

    Every robot is calibrated by itself. Lengths that are long or short together in one robot after the other are
    named ``correlated_lengths``; noise is judged over the residuals of all robots.

    Args:
        problem, data, folds, by, progress: as of `calibrate_batch`.
        seed: of the null distribution; 0 by default.
        most_rows: data with more are thinned to so many, as many of each robot, see `thin`.

    Returns:
        ``BatchDiagnosis``: the causes that all robots share, how much the others vary, with p-values; SI units,
        radians.

    Raises:
        InputError, InsufficientDataError: as `calibrate_batch`.

    Example:
        >>> import posture_opt as po
        >>> problem = po.load_problem("insert_planar_2r_correlated_lengths")
        >>> data = po.read_measurements("problems/planar_2r_batch.csv", problem)
        >>> diagnosis = po.diagnose_batch(problem, data)  # the correlation of this type is the one of the file
        >>> [finding.kind for finding in diagnosis.effects]
        []
    """
    batch = calibrate_batch(problem, data, folds=folds, by=by, most_rows=most_rows, progress=progress)
    units = {p.name: p.unit for p in batch.parameters}
    lengths = [
        _correlation_finding(pair)
        for pair in batch.pairs
        if pair.significant and units[pair.a] == units[pair.b] == "m" and not _as_stated(pair.stated, pair.interval)
    ]
    noise, uneven = _batch_noise(problem, batch, seed or 0)
    findings = (*lengths, *map(noise_finding, noise))
    return BatchDiagnosis(batch, findings, batch.calibrations[0].by, tuple(uneven))


def _correlation_finding(pair: CorrelatedPair) -> Finding:
    effect = CorrelatedLengths(lengths=(pair.a, pair.b), rho=pair.correlation)
    size = {"correlation": (pair.correlation, (pair.interval[1] - pair.interval[0]) / 3.92, "1")}
    return Finding(effect, size, pair.p_value, 0.0)


def _as_stated(stated: float, interval: tuple[float, float]) -> bool:
    return stated != 0 and interval[0] <= stated <= interval[1]


def _batch_noise(
    problem: ProblemData, batch: Batch, seed: int
) -> tuple[list[NoiseCause], list[UnevenErrors]]:  # fmt: skip
    samples = []
    for calibration in batch.calibrations:
        linearised = linearise_calibration(calibration, 0, seed)
        sensitivities = linearised.sensitivities
        samples.append(noise_samples(problem, sensitivities.residuals, linearised.baseline(), sensitivities.joints))
    every = [[s.everything for s in samples], [s.repeats for s in samples], [s.readings for s in samples]]
    everything, repeats, readings = map(NoiseSample.together, every)
    return find_uneven_noise(everything, repeats, seed, readings=readings)
