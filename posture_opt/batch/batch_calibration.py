"""``calibrate_batch``: several robots of one type, and how their geometry varies from one to the next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.batch.batch_covariance import (
    BatchCovariance,
    CorrelatedPair,
    covariance_between_robots,
    pairs_of,
    stated_sigmas,
)
from posture_opt.calibration.calibrate import MAX_FITTED_ROWS, calibrate
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.data_checks import state_a_distance
from posture_opt.calibration.estimation.error_statistics import By, Statistics
from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.errors import InputError, InsufficientDataError, Issue
from posture_opt.interrupts import interruptible
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import thin_each_robot
from posture_opt.numerics import Array, Codes, Json, Mask, Progress
from posture_opt.result import Result
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.regions import coverage_factor
from posture_opt.uncertainty.sources import Sources
from posture_opt.validation.coverage import REGION_PROBABILITY, share_interval, squared_distances
from posture_opt.validation.spread_check import held_out_predictions

_ROBOTS_FOR_CORRELATIONS = 10  # robots: with fewer, a correlation is hardly determined
MIN_ROBOTS = 3  # robots: with two, a standard deviation is known to within a factor of thirty


@dataclass(frozen=True, eq=False, repr=False)
class Batch(Result):
    """What measurements of several robots of one type say of the type.

    Args:
        problem: the type as it is stated; ``data`` the measurements of all robots.
        robots: their names; ``calibrations`` one of each.
        rows: for each robot, its rows in the data.
        parameters: (k,) geometric parameters that the data of every robot determine.
        estimates: (R, k) deviations from nominal [rad, m]; ``spread`` how they vary across the batch.
        stated: (k,) standard deviations that the problem states for them, 0 where none.
        pairs: of parameters, the most certain first; ``significant`` at 5 %, all correlations tested together.
        undetermined: geometric parameters that some robot's data leave open.
        nominal, calibrated: cross-validated position errors of all robots.
        coverage: share of all rows in the 95 % regions of the arm as stated and calibrated, with its interval,
            robots being what is drawn at random.
        notes: sentences for the report.
        total: how many rows there were before very many were thinned.
    """

    problem: ProblemData
    data: Measurements
    robots: tuple[str, ...]
    calibrations: tuple[Calibration, ...]
    rows: tuple[Codes, ...]
    parameters: tuple[Parameter, ...]
    estimates: Array
    spread: BatchCovariance
    stated: Array
    pairs: tuple[CorrelatedPair, ...]
    undetermined: tuple[str, ...]
    nominal: Statistics
    calibrated: Statistics
    coverage: dict[str, tuple[float, tuple[float, float]]]
    notes: tuple[str, ...] = ()
    total: int = 0

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """The strongest correlation; what the data refute; errors, variation, what is open, what to do next."""
        return (_answer(self), *batch_findings(self))

    @property
    def off_nominal(self) -> Mask:
        """(k,) whether the mean over the robots exceeds t(0.975, robots − 1) of its standard errors."""
        from scipy.special import stdtrit

        sure = float(stdtrit(len(self.robots) - 1, 0.975))
        return np.asarray(np.abs(self.spread.mean) > sure * self.spread.mean_std)

    @property
    def known_pairs(self) -> tuple[CorrelatedPair, ...]:
        """Pairs that are significant, stated, or known to within an interval shorter than 1; else the first."""
        known = tuple(p for p in self.pairs if p.significant or p.stated or np.ptp(p.interval) < 1)
        return known or self.pairs[:1]

    @property
    def worst(self) -> int:
        """The robot with the largest error when calibrated."""
        return int(np.argmax([c.calibrated.rms for c in self.calibrations]))

    @property
    def names(self) -> tuple[str, ...]:
        """(k,) of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    def fields_json(self) -> dict[str, Json]:
        """The document ``calibration.json`` of a batch: the type as a whole, and every robot under ``batch``."""
        first, worst = self.calibrations[0], min(self.calibrations, key=lambda c: c.identifiability.rank)
        gone = [int(rows[i]) for rows, c in zip(self.rows, self.calibrations, strict=True) for i in c.outliers]
        place = {name: k for k, name in enumerate(self.names)}
        return {
            "residual_rms": {"nominal": self.nominal.rms, "calibrated": self.calibrated.rms},
            "residuals": {"nominal": self.nominal.to_json(), "calibrated": self.calibrated.to_json()},
            "coverage95": {name: share for name, (share, _) in self.coverage.items()},
            "cross_validation": first.by,
            "parameters": [self._parameter(p, place.get(p.name)) for p in first.parameters if p.group == "geometry"],
            "rank": worst.identifiability.rank,
            "observability": dict(worst.identifiability.observability),
            "outliers": sorted(gone),
            "notes": list(self.notes),
            **self.thinned_json,
            "batch": {
                "robots": [self._robot(k) for k in range(len(self.robots))],
                "parameters": list(self.names),
                "mean": self.spread.mean.tolist(),
                "mean_std": self.spread.mean_std.tolist(),
                "covariance": self.spread.covariance.tolist(),
                "sigma": self.spread.sigma.tolist(),
                "sigma_interval95": [[e if np.isfinite(e) else None for e in ends] for ends in self.spread.interval],
                "sigma_stated": [float(s) or None for s in self.stated],
                "correlation": self.spread.correlation.tolist(),
                "pairs": [pair.to_json() for pair in self.pairs],
                "not_told": list(self.undetermined),
                "coverage95_interval95": {name: list(ends) for name, (_, ends) in self.coverage.items()},
            },
        }

    @property
    def thinned_json(self) -> dict[str, Json]:
        """The part ``thinned`` of a document: how many rows there were and are; empty where all were used."""
        used = len(self.data)
        return {"thinned": {"rows": self.total, "rows_used": used}} if self.total > used else {}

    def _parameter(self, p: Parameter, k: int | None) -> dict[str, Json]:
        known = k is not None
        mean, std = (float(self.spread.mean[k]), float(self.spread.mean_std[k])) if k is not None else (0.0, None)
        return {
            "name": p.name, "estimate": p.nominal + mean, "std": std, "nominal": p.nominal, "unit": p.unit,
            "determined": known,
        }  # fmt: skip

    def _robot(self, k: int) -> dict[str, Json]:
        found = self.calibrations[k]
        return {
            "robot": self.robots[k],
            "rows": len(self.rows[k]),
            "residual_rms": {"nominal": found.nominal.rms, "calibrated": found.calibrated.rms},
            "deviations": self.estimates[k].tolist(),
            "outliers": [int(self.rows[k][i]) for i in found.outliers],
        }


def _answer(found: Batch) -> Statement:
    robots, first = len(found.robots), next((pair for pair in found.pairs if pair.significant), None)
    if first is None:
        return state("batch.uncorrelated", robots=robots)
    (low, high), rho = first.interval, first.correlation
    return state("batch.correlated", robots=robots, a=first.a, b=first.b, correlation=rho, low=low, high=high)


def batch_findings(found: Batch) -> Iterator[Statement]:
    """What the data of the robots refute; their errors, what varies, what is open, what to do next."""
    robots = len(found.robots)
    causes = (contradiction.cause for c in found.calibrations for contradiction in c.contradictions)
    for (target, what), count in Counter((cause.target, cause.words) for cause in causes).items():
        yield state("batch.refuted", target, robots=count, all=robots, what=what)
    yield state("batch.errors", before=Quantity(found.nominal.rms), after=Quantity(found.calibrated.rms))
    largest = Quantity(found.calibrations[found.worst].calibrated.rms)
    yield state("batch.worst-robot", found.robots[found.worst], error=largest)
    varying = [
        f"{p.name} {Quantity(float(sigma), 'angle' if p.unit == 'rad' else 'length')}"
        for p, sigma, (low, _) in zip(found.parameters, found.spread.sigma, found.spread.interval, strict=True)
        if low > 0
    ]
    yield state("batch.varying", parameters=_first(varying)) if varying else state("batch.constant")
    if found.undetermined:
        yield state("batch.undetermined", parameters=_first(found.undetermined))
    few = robots < _ROBOTS_FOR_CORRELATIONS
    yield state("batch.measure-more-robots", robots=_ROBOTS_FOR_CORRELATIONS) if few else state("batch.plan-for-type")
    significant = sum(pair.significant for pair in found.pairs)
    pairs = state("batch.significant-pairs", significant=significant, pairs=len(found.pairs))
    yield pairs if found.pairs else state("batch.one-parameter")


def _first(names: Sequence[str]) -> list[str]:
    more = len(names) - 4
    return [*names[:4], f"{more} more"] if more > 1 else [*names]


@interruptible()
def calibrate_batch(
    problem: ProblemData,
    data: Measurements,
    *,
    folds: int = 5,
    by: By | None = None,
    most_rows: int = MAX_FITTED_ROWS,
    progress: Progress | None = None,
) -> Batch:
    """Calibrate every robot of a type by itself, and estimate how their geometry varies from one to the next.

    With estimates ``x_r`` of R robots and their covariances ``S_r`` the model is ``x_r ~ N(μ, Ω + S_r)``. Only
    parameters that the data of every robot determine are in it. The cost is one `calibrate` a robot.

    Each robot has its own free base and tool. Stated σ's of geometry are no priors here: they would pull all robots to
    the nominal one and hide what is asked for. The covariance across the batch is that of the estimates less what their
    own errors make of it (:func:`posture_opt.batch.batch_covariance.covariance_between_robots`).

    Args:
        problem: the type's arm, with the instrument.
        data: the measurements, of at least three robots.
        folds, by: of the cross-validation, as in `calibrate`.
        most_rows: data with more are thinned to so many, as many of each robot, see `thin`.
        progress: receives (done, total) robots.

    Returns:
        ``Batch``: a calibration of each robot, and σ's and correlations of the type [m, rad]; ``save(folder)``
        writes ``uncertainty.yaml``.

    Raises:
        InputError: the data are of one robot.
        InsufficientDataError: fewer than three robots, or too little of one of them.

    Example:
        >>> import posture_opt as po
        >>> problem = po.load_problem("insert_planar_2r_correlated_lengths")
        >>> data = po.read_measurements("problems/planar_2r_batch.csv", problem)
        >>> batch = po.calibrate_batch(problem, data)
        >>> len(batch.robots), batch.names
        (12, ('joint1.theta', 'joint1.a', 'joint2.theta', 'joint2.a'))
        >>> print(f"{1e3 * batch.spread.sigma[1]:.2f} mm")  # how far the first link varies from robot to robot
        0.36 mm
    """
    _check_batch(problem, data)
    total, data = len(data), thin_each_robot(data, most_rows)
    rows = tuple(np.flatnonzero(data.robot == code) for code in range(len(data.robot_names)))
    bare, found = _without_geometry(problem), list[Calibration]()
    for mine, name in zip(rows, data.robot_names, strict=True):
        own = replace(data.take(mine), robot=np.zeros(len(mine), dtype=np.intp), robot_names=(name,))
        found.append(_calibrate_one(bare, own, folds, by))
        if progress is not None:
            progress(len(found), len(rows))
    calibrations = tuple(found)
    parameters, undetermined = _determined_by_all(calibrations)
    index = {p.name: i for i, p in enumerate(calibrations[0].parameters)}
    columns = [index[p.name] for p in parameters]
    estimates = np.array([c.x[columns] for c in calibrations])
    errors = np.array([c.covariance[np.ix_(columns, columns)] for c in calibrations])
    spread = covariance_between_robots(estimates, errors)
    robots = np.repeat(np.arange(len(rows)), [len(c.kept_rows) for c in calibrations])
    thinned = f"{len(data)} of {total} rows were fitted, as many of each robot: --rows takes more"
    notes = [*[thinned] * (len(data) < total), *(note for c in calibrations for note in c.notes)]
    return Batch(
        problem=problem,
        data=data,
        robots=data.robot_names,
        calibrations=calibrations,
        rows=rows,
        parameters=parameters,
        estimates=estimates,
        spread=spread,
        stated=stated_sigmas(parameters, problem),
        pairs=pairs_of(parameters, spread, problem),
        undetermined=undetermined,
        nominal=Statistics.of(_kept_errors(calibrations, [c.errors_nominal for c in calibrations]), robots),
        calibrated=Statistics.of(_kept_errors(calibrations, [c.errors for c in calibrations]), robots),
        coverage=_batch_coverage(problem, calibrations, folds),
        notes=tuple(dict.fromkeys(notes)),
        total=total,
    )


def _kept_errors(calibrations: tuple[Calibration, ...], errors: list[Array]) -> Array:
    """Errors (M, 3) [m] of the rows of all robots that are no outliers, robot after robot."""
    return np.concatenate([e[c.kept_rows] for c, e in zip(calibrations, errors, strict=True)])


def _check_batch(problem: ProblemData, data: Measurements) -> None:
    names = data.robot_names
    if len(names) < 2:
        hint = "measure several robots of the type and name them in a column 'robot'"
        raise InputError(Issue("the data are of one robot: how a batch varies cannot be known from it", hint=hint))
    if len(names) < MIN_ROBOTS:
        raise InsufficientDataError(
            f"{len(names)} robots ({', '.join(names)}) do not show how the type varies: measure {MIN_ROBOTS} robots or "
            "more, ten or more for correlations, each in some 20 postures; for one robot alone, keep its rows only"
        )
    if not data.kind.fixes_size and not problem.data.distances:
        add = state_a_distance(data) if data.touches else "measure positions or distances"
        raise InsufficientDataError(
            f"{data.kind.noun} alone do not determine the size of a robot, nor how sizes vary from one to the next: "
            f"{add}"
        )


def _calibrate_one(problem: ProblemData, own: Measurements, folds: int, by: By | None) -> Calibration:
    (name,) = own.robot_names
    try:
        return calibrate(problem, own, folds=folds, by=by)
    except InsufficientDataError as error:
        raise InsufficientDataError(f"robot {name}: {error}") from None
    except InputError as error:
        raise InputError([replace(issue, message=f"robot {name}: {issue.message}") for issue in error.issues]) from None


def _without_geometry(problem: ProblemData) -> ProblemData:
    """The problem without σ's of geometry, which would pull every robot to the nominal one."""
    # σ's of frames that are not free stay knowledge, and so does all scatter
    sources = problem.sources
    frame = np.array([name.rpartition(".")[0] in ("base", "tool") for name in sources.names], dtype=bool)
    constant = np.where(np.outer(frame, frame), sources.constant, 0.0)
    bare = Sources(sources.names, constant + sources.scatter, sources.notes, sources.scatter)
    return replace(problem, sources=bare)


def _determined_by_all(calibrations: tuple[Calibration, ...]) -> tuple[tuple[Parameter, ...], tuple[str, ...]]:
    fixed = np.all([c.fixed & (np.diag(c.covariance) > 0) for c in calibrations], axis=0)
    geometry = [(p, bool(known)) for p, known in zip(calibrations[0].parameters, fixed, strict=True)]
    determined = tuple(p for p, known in geometry if known and p.group == "geometry")
    if not determined:
        raise InsufficientDataError(
            "no geometric parameter is determined by the data of every robot: measure postures spread over the whole "
            "workspace of each"
        )
    return determined, tuple(p.name for p, known in geometry if not known and p.group == "geometry")


def _batch_coverage(
    problem: ProblemData, calibrations: tuple[Calibration, ...], folds: int
) -> dict[str, tuple[float, tuple[float, float]]]:
    inside: dict[str, list[Mask]] = {}
    for calibration in calibrations:
        for name, (errors, predicted, _) in held_out_predictions(problem, calibration, folds).items():
            radius = coverage_factor(REGION_PROBABILITY, errors.shape[1])
            inside.setdefault(name, []).append(squared_distances(errors, predicted.covariance) <= radius**2)
    found = {}
    for name, parts in inside.items():
        robots = np.concatenate([np.full(len(part), k) for k, part in enumerate(parts)])
        every = np.concatenate(parts)
        found[name] = float(every.mean()), share_interval(every, robots)
    return found
