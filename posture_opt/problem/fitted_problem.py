"""What measurements found, to be planned with and written: problems of one arm, the section of a batch."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from posture_opt.batch.batch_calibration import Batch
from posture_opt.batch.batch_covariance import stated_correlations
from posture_opt.calibration.calibration import Calibration
from posture_opt.diagnosis.diagnosis import Diagnosis
from posture_opt.model.effects import CatalogueEntry, NoiseEffect
from posture_opt.numerics import Array
from posture_opt.problem.effects_section import of_a_type
from posture_opt.problem.fitting import WORKPIECE_KEYS
from posture_opt.problem.problem import Problem
from posture_opt.problem.yaml_source import Plain, Section, dump_yaml
from posture_opt.robot.robot import Factor
from posture_opt.selection.problem_data import ProblemData
from posture_opt.validation.prediction import joint_errors

_KEPT_KEYS = ("scatter", "repeatability", "weights", "measurement", *WORKPIECE_KEYS)


def calibrated_problem(problem: Problem, calibration: Calibration) -> Problem:
    """The problem with the calibrated arm: its parameters, what is still uncertain of them, and its scatter.

    The arm is the one that fits the measurements: every deviation of ``calibration.x`` counts, those too that are
    determined together only. Frames that were found are numbers and no longer free; of several targets the first is
    the tool point. The covariance is the estimate's, under the scatter of repeats that the calibration leaves; that
    scatter is added to it. :meth:`Problem.files` writes it as a complete problem file with its covariance next to it.

    Args:
        problem: the problem that was calibrated.
        calibration: of its robot.

    Returns:
        ``Problem``: with corrections [m, rad] and their covariance; ``to_yaml()`` is its file.

    Raises:
        InputError: the calibration is one of another robot.

    Example:
        >>> import posture_opt as po
        >>> problem = po.load_problem("insert_planar_2r_measured")
        >>> calibration = po.calibrate(problem, po.read_measurements("problems/planar_2r_measured.csv", problem))
        >>> calibrated = po.calibrated_problem(problem, calibration)
        >>> list(calibrated.files("calibrated"))
        ['calibrated.yaml', 'calibrated_covariance.csv']
        >>> f"{1e3 * po.select_posture(calibrated).sigma_max:.2g} mm"
        '0.056 mm'
    """
    return problem.with_fit(calibration)


def extended_problem(problem: Problem, diagnosis: Diagnosis) -> Problem:
    """The problem with the arm that the diagnosis fitted: geometry, effects, and what is uncertain of both together.

    Effects that change with time are left out: they belong to the session that was measured. So is noise of the
    instrument or of the data; that of a joint is an effect of the arm.

    Args:
        problem: the problem that was diagnosed.
        diagnosis: of its robot.

    Returns:
        ``Problem``: with corrections, effects and their covariance (SI units, radians); ``to_yaml()`` is its
        file.

    Raises:
        InputError: the diagnosis is one of another robot.

    Example:
        >>> import posture_opt as po
        >>> problem = po.load_problem("insert_planar_2r_measured")
        >>> data = po.read_measurements("problems/planar_2r_measured.csv", problem)
        >>> extended = po.extended_problem(problem, po.diagnose(problem, data, plan=False))
        >>> po.calibrate(extended, data).nominal.rms < po.calibrate(problem, data).nominal.rms
        True
    """
    return problem.with_fit(diagnosis)


def batch_uncertainty(problem: ProblemData, batch: Batch) -> Section:
    """The section ``uncertainty``: σ's across the batch and its significant correlations."""
    problem = problem.without_noise()
    parameters, former = problem.robot.parameters, problem.to_dict().get("uncertainty") or {}
    sigma = {
        name: float(s)
        for name, s, (low, _) in zip(batch.names, batch.spread.sigma, batch.spread.interval, strict=True)
        if low > 0
    }
    rho = {(p.a, p.b): p.correlation for p in batch.pairs if p.significant and p.a in sigma and p.b in sigma}
    others = {name: s for name, s in _stated(problem).items() if name not in sigma}
    rho |= {
        pair: r for pair, r in stated_correlations(problem.sources).items() if pair[0] in others and pair[1] in others
    }
    sigma |= others
    texts = {name: _text(s, parameters[name]) for name, s in sigma.items()}
    pairs = [[a, b, r] for (a, b), r in _definite(list(sigma), rho).items()]
    kept = {key: former[key] for key in _KEPT_KEYS if former.get(key) is not None}
    if "repeatability" in kept and set(sigma) & set(joint_errors(problem.robot)):
        # With a σ of a joint's value the file takes scatter in place of a repeatability: the same, joint by joint.
        rest = ("measurement", *WORKPIECE_KEYS)
        variances = np.diag(problem.sources.scatter)
        scatter = {
            name: _text(math.sqrt(v), parameters[name])
            for name, v in zip(problem.sources.names, variances, strict=True)
            if v > 0
        }
        kept = {"scatter": scatter} | {key: kept[key] for key in rest if key in kept}
    return {"sigma": texts, **({"correlation": pairs} if pairs else {}), **kept}


def batch_effects(
    problem: ProblemData, correlation: Sequence[Sequence[Plain]], named: Sequence[NoiseEffect]
) -> list[Section]:
    """The section ``effects`` with the noise that a batch ``named``, without lengths that ``correlation`` has."""
    correlated = {frozenset(pair[:2]) for pair in correlation}
    section: dict[str, tuple[CatalogueEntry, Section]] = {
        effect.name: (effect, entry)
        for effect, entry in zip(problem.effects, problem.to_dict().get("effects") or [], strict=True)
        if not (of_a_type(effect) and {frozenset(pair[:2]) for pair in effect.correlation} & correlated)
    }
    for noise in named:
        stated = section[noise.name][0] if noise.name in section else None
        total = stated.joined(noise) if isinstance(stated, NoiseEffect) else noise
        section[noise.name] = total, total.to_dict()
    return [entry for _, entry in section.values()]


def batch_yaml(problem: ProblemData, batch: Batch, named: Sequence[NoiseEffect] = ()) -> str:
    """The section as a file of its own, with what it holds in a comment, and that of the effects if it changes."""
    robots = f"{len(batch.robots)} robots"
    uncertainty = batch_uncertainty(problem, batch)
    effects = batch_effects(problem, uncertainty.get("correlation", ()), named)
    changed = {} if effects == (problem.to_dict().get("effects") or []) else {"effects": effects}
    lines = [
        f"# How the geometry of this type varies from one robot to the next, from measurements of {robots}.",
        f"# Paste it over the section{'s' if changed else ''} of the same name in the problem file.",
        *(f"# {line}" for line in (*mean_lines(problem, batch), *_doubts(problem, batch))),
    ]
    return "\n".join(lines) + "\n" + dump_yaml({"uncertainty": uncertainty, **changed})


def mean_lines(problem: ProblemData, batch: Batch) -> list[str]:
    """The mean robot, where it is not the file's: corrections for the section ``robot``."""
    from scipy.special import stdtrit

    sure = float(stdtrit(len(batch.robots) - 1, 0.975))
    parameters = problem.robot.parameters
    off = [
        f"{name}: {_text(float(mean), parameters[name])}"
        for name, mean, std in zip(batch.names, batch.spread.mean, batch.spread.mean_std, strict=True)
        if abs(mean) > sure * std
    ]
    if not off:
        return []
    return [
        "The mean robot is not the one of the file; to plan with it, add under robot:",
        f"  corrections: {{{', '.join(off)}}}",
    ]


def _doubts(problem: ProblemData, batch: Batch) -> list[str]:
    stated, own = _stated(problem), joint_errors(problem.robot)
    written = [n for n, (low, _) in zip(batch.names, batch.spread.interval, strict=True) if low > 0 and n in stated]
    replaced = [f"{n}: {_text(stated[n], problem.robot.parameters[n])}" for n in written if n in own]
    if not replaced:
        return []
    return [
        f"The file stated {', '.join(replaced)}. If that is scatter from repeat to repeat,",
        "it belongs under scatter, beside what is written here under sigma.",
    ]


def _stated(problem: ProblemData) -> dict[str, float]:
    """Standard deviation [rad or m] of every source that the file states as constant."""
    sources = problem.sources
    variances = np.diag(sources.constant)
    return {name: math.sqrt(v) for name, v in zip(sources.names, variances, strict=True) if v > 0}


def _definite(names: list[str], rho: dict[tuple[str, str], float]) -> dict[tuple[str, str], float]:
    share = 1.0
    while True:
        rounded = {pair: round(share * r, 3) for pair, r in rho.items()}
        matrix: Array = np.eye(len(names))
        for (a, b), r in rounded.items():
            i, j = names.index(a), names.index(b)
            matrix[i, j] = matrix[j, i] = r
        # Rounded to three digits, correlations with eigenvalues of a thousandth stay positive definite.
        if not names or np.linalg.eigvalsh(matrix)[0] >= 1e-3:
            return rounded
        share *= 0.98


def _text(value: float, factor: Factor) -> str:
    number, unit = (math.degrees(value), "deg") if factor.kind == "rotate" else (value * 1e3, "mm")
    digits = max(3 - math.floor(math.log10(abs(number))), 0) if number else 0
    return f"{number:.{digits}f} {unit}"
