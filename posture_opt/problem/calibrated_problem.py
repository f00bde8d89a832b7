"""The problem of a calibrated arm: the file's, with what measurements said about it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.parameters import Parameter
from posture_opt.numerics import Array
from posture_opt.problem.effects_section import effects_section
from posture_opt.problem.noise_section import of_a_type
from posture_opt.problem.problem import Problem, build_problem
from posture_opt.problem.yaml_source import Document
from posture_opt.robot.robot import Factor
from posture_opt.selection.plan_comparison import Comparison, compare_plans
from posture_opt.uncertainty.covariance_file import covariance_text
from posture_opt.uncertainty.sources import Sources
from posture_opt.units import DIMENSIONS
from posture_opt.validation.residual_scatter import covariance_under, residual_scatter
from posture_opt.validation.stated_scatter import JointScatter

ELSEWHERE = (
    "the base is free, so the world is the frame of the instrument, and the place of the task is read in it: write "
    "position and direction in that frame"
)
_SUFFIX = ", calibrated"
COVARIANCE = "calibrated_covariance.csv"
_FINE = {"m": 1e-11, "rad": 1e-13}
"""Below, a deviation is rounding: [m], and [rad] at any reach of an arm."""
_POSE = ("x", "y", "z", "roll", "pitch", "yaw")


def calibrated_problem(problem: Problem, calibration: Calibration) -> Problem:
    """The problem with the calibrated arm: its parameters, what is still uncertain of them, and its scatter.

    The arm is the one that fits the measurements: every deviation of ``calibration.x`` counts, those too that are
    determined together only. Frames that were found are numbers and no longer free; of several targets the first is
    the tool point. The covariance is the estimate's, under the scatter from visit to visit that the calibration leaves;
    that scatter comes to it. :meth:`Problem.files` writes it as a complete problem file with its covariance beside it.

    Raises:
        InputError: the calibration is one of another robot.
    """
    scatter = residual_scatter(problem, calibration)
    x, covariance = of_first_target(calibration, covariance_under(calibration, scatter))
    known = known_sources(problem, calibration, x, covariance)
    document = {
        **problem.to_dict(),
        "name": f"{problem.name.removesuffix(_SUFFIX)}{_SUFFIX}",
        "robot": corrected_section(problem, x),
        "uncertainty": uncertainty_section(problem, scatter, COVARIANCE if known.names else ""),
        **known_effects(problem, known.names, COVARIANCE),
    }
    text = covariance_text(known.names, known.covariance, parameter_units(problem, known.names))
    attached = {COVARIANCE: text} if known.names else {}
    return build_problem(
        Document(document), problem.folder, problem.name, attached=attached, header=_header(calibration, scatter)
    )


def compare_calibrated(
    problem: Problem, calibration: Calibration, calibrated: Problem, *, seed: int | None = None, workers: int = 1
) -> Comparison | None:
    """The task planned with the nominal arm and with the calibrated one; None where the problem has no task.

    The nominal arm stands where the measurements saw it, if its frames are free.
    """
    models = {"nominal": arm_of_frames(problem, calibration), "calibrated": calibrated}
    return compare_plans(models, seed=seed, workers=workers, hint=ELSEWHERE if problem.robot.base_free else "")


def arm_of_frames(problem: Problem, calibration: Calibration) -> Problem:
    """The problem with the nominal arm where the measurements saw it: free frames are found, and nothing else."""
    x = {p.name: v for p, v in zip(calibration.parameters, calibration.x_nominal, strict=True)}
    found = {_name(p): x[p.name] for p in calibration.parameters if p.group in ("base", "tool") and p.code <= 0}
    document = {**problem.to_dict(), "robot": corrected_section(problem, found)}
    return build_problem(Document(document), problem.folder, problem.name, attached=problem.attached)


def _name(parameter: Parameter) -> str:
    """The name in the robot: that of a target's offset is the tool's."""
    return f"tool.{parameter.name.rpartition('.')[2]}" if parameter.group == "tool" else parameter.name


def of_first_target(calibration: Calibration, covariance: Array | None = None) -> tuple[dict[str, float], Array]:
    """Deviations of the robot's parameters by name, and their covariance; touched points and other targets left out.

    ``covariance`` (k, k) is that of the calibration unless another is given.
    """
    covariance = calibration.covariance if covariance is None else covariance
    own = [i for i, p in enumerate(calibration.parameters) if p.source and p.code <= 0]
    x = {_name(calibration.parameters[i]): float(calibration.x[i]) for i in own}
    return x, covariance[np.ix_(own, own)]


def known_sources(problem: Problem, calibration: Calibration, x: Mapping[str, float], covariance: Array) -> Sources:
    """What is still uncertain of errors that stay: the estimates, and stated σ's that the data had no part in."""
    names, units = list(x), {p: f.kind for p, f in problem.robot.parameters.items()}
    least = np.array([_FINE["rad" if units[name] == "rotate" else "m"] for name in names])
    kept = [i for i in range(len(names)) if covariance[i, i] > least[i] ** 2]
    found = Sources(tuple(names[i] for i in kept), semidefinite(covariance[np.ix_(kept, kept)]))
    sources = problem.sources
    moved = {name.rpartition(".")[0] for name in x if name.endswith(".roll")}
    others = [
        i
        for i, name in enumerate(sources.names)
        if name not in x
        and sources.constant[i, i] > 0
        # The value of a joint with an origin of six moves the tool as its origin does, which was fitted.
        and not (name.rpartition(".")[0] in moved and name.rpartition(".")[2] in ("theta", "d"))
    ]
    return found.plus(Sources(tuple(sources.names[i] for i in others), sources.constant[np.ix_(others, others)]))


def semidefinite(covariance: Array) -> Array:
    """The covariance without the rounding of its zeros; in correlations, which have no units."""
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0, sigma, 1.0)  # what moves nothing that was measured has no variance at all
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    found = (vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(sigma, sigma)
    return np.asarray((found + found.T) / 2)


def corrected_section(problem: Problem, x: Mapping[str, float]) -> dict[str, Any]:
    """The robot's section with deviations ``x`` [rad or m] added: frames as numbers, the rest as corrections."""
    section = dict(problem.to_dict()["robot"])
    nominal, parameters = problem.spec.robot.nominal(problem.folder).parameters, problem.robot.parameters
    offsets = {
        name: parameters[name].nominal - nominal[name].nominal + x.get(name, 0.0)
        for name in parameters
        if name in x or name in problem.spec.robot.corrections
    }
    for frame in ("base", "tool"):
        if any(name.startswith(f"{frame}.") for name in x):
            section[frame] = _frame(parameters, frame, x)
            offsets = {name: value for name, value in offsets.items() if not name.startswith(f"{frame}.")}
    corrections = {
        name: quantity(value, parameters[name])
        for name, value in offsets.items()
        if abs(value) > _FINE["rad" if parameters[name].kind == "rotate" else "m"]
    }
    section.pop("corrections", None)
    return {**section, **({"corrections": corrections} if corrections else {})}


def _frame(parameters: Mapping[str, Factor], frame: str, x: Mapping[str, float]) -> dict[str, Any]:
    texts = [
        quantity(factor.nominal + x.get(name, 0.0), factor)
        for name in (f"{frame}.{part}" for part in _POSE)
        for factor in [parameters[name]]
    ]
    return {"xyz": texts[:3], "rpy": texts[3:]}


def quantity(value: float, factor: Factor) -> str:
    """A value of a parameter as files have it, to 1e-11 m or rad: 12.3456789 mm, 0.0123456789 deg."""
    number = f"{math.degrees(value):.10f}" if factor.kind == "rotate" else f"{value * 1e3:.8f}"
    number = number.rstrip("0").rstrip(".")
    return f"{'0' if number == '-0' else number} {'deg' if factor.kind == 'rotate' else 'mm'}"


def uncertainty_section(problem: Problem, scatter: JointScatter, covariance: str) -> dict[str, Any]:
    """The section of a problem whose parameters' covariance stands in a file, beside the scatter of the joints.

    What effects say of that scatter is theirs to say.
    """
    former = problem.to_dict().get("uncertainty") or {}
    parameters = problem.robot.parameters
    sigma = {name: _rounded(value, parameters[name]) for name, value in scatter.beside.items()}
    kept = {key: former[key] for key in ("measurement",) if former.get(key) is not None}
    return {
        **({"covariance": covariance} if covariance else {}),
        **({"scatter": sigma} if sigma else {}),
        **kept,
    }


def known_effects(problem: Problem, names: Sequence[str], covariance: str) -> dict[str, Any]:
    """The section ``effects`` of a problem that has some, their covariance in the file of all sources."""
    entries = problem.to_dict().get("effects")
    if not entries:
        return {}
    own = [k for k, effect in enumerate(problem.effects) if not of_a_type(effect)]
    effects = [problem.effects[k] for k in own]
    return {"effects": effects_section([entries[k] for k in own], effects, names, covariance)}


def _rounded(sigma: float, factor: Factor) -> str:
    value, unit = (math.degrees(sigma), "deg") if factor.kind == "rotate" else (sigma * 1e3, "mm")
    return f"{float(f'{value:.4g}'):.12f}".rstrip("0").rstrip(".") + f" {unit}"


def parameter_units(problem: Problem, names: tuple[str, ...]) -> list[str]:
    """The unit of each source in a covariance file."""
    of_effects = problem.arm.dimensions
    kinds = {name: factor.kind for name, factor in problem.robot.parameters.items()}
    return [
        dimension_unit(of_effects[name]) if name in of_effects else "mrad" if kinds[name] == "rotate" else "mm"
        for name in names
    ]


def dimension_unit(dimension: str) -> str:
    """The SI unit of a parameter of an effect as covariance files have it."""
    return "1" if dimension == "ratio" else DIMENSIONS[dimension][0]


def _header(calibration: Calibration, scatter: JointScatter) -> tuple[str, ...]:
    """What the file says of itself in its first lines."""
    data = calibration.residuals.data
    file = Path(data.file).name or "a table"
    gone = f", {len(calibration.outliers)} of them left out as outliers" if calibration.outliers else ""
    before, after = (f"{s.rms * 1e3:.3g} mm" for s in (calibration.nominal, calibration.calibrated))
    targets = [p.name for p in calibration.parameters if p.group == "tool" and p.code > 0]
    several = (
        f"The tool point is the first of {len(data.target_names)} targets, {data.target_names[0]}." if targets else ""
    )
    lines = (
        f"Calibrated with {file}: {len(data)} rows{gone}.",
        f"Position errors where it had not seen the data: {before} RMS before, {after} after.",
        f"What is still uncertain of its parameters stands in {COVARIANCE}, in mm and mrad; combinations of them that",
        "move nothing that was measured have no variance there.",
        f"{scatter.note[:1].upper()}{scatter.note[1:]}.",
        several,
    )
    return tuple(line for line in lines if line)
