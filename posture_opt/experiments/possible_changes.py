"""What may have changed on a calibrated arm, and what postures tell of such changes as the unknowns of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import case_of
from posture_opt.calibration.estimation.parameters import Parameter, effect_parameters
from posture_opt.experiments.information import (
    OF_PLACES,
    GivenInformation,
    MeasurementModel,
    PriorInformation,
    nothing_measured,
)
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import Backlash, Effect, JointCompliance
from posture_opt.numerics import Array
from posture_opt.robot.robot import Factor, Robot
from posture_opt.selection.problem_data import ProblemData

_SHARES = {"tool_frame": 0.30, "base_frame": 0.20, "joint_offset": 0.20, "link": 0.15}
"""Probability of each kind, given that one thing changed: tools are knocked and exchanged more often than links bend.

An assumption and no count. A factor of two in it moves a verdict only where the data say next to nothing.
"""
_EFFECTS: tuple[tuple[type[Effect], float], ...] = ((Backlash, 0.075), (JointCompliance, 0.075))
"""Effects that joints come to have, with the probability of their kind."""
FRAME_PARTS = ("x", "y", "z", "roll", "pitch", "yaw")
_LENGTHS = ("a", "d", "x", "y", "z")


def change_name(kind: str, target: str) -> str:
    """The name of a change: "zero of elbow", "twist elbow.alpha"."""
    part = "length" if target.rpartition(".")[2] in _LENGTHS else "twist"
    names = {
        "tool_frame": "tool",
        "base_frame": "base",
        "joint_offset": f"zero of {target}",
        "link": f"{part} {target}",
    }
    return names.get(kind, f"{kind.replace('_', ' ')} of {target}")


@dataclass(frozen=True)
class PossibleChange:
    """One thing that may have changed, and the parameters that would deviate from the file then."""

    kind: str  # ``tool_frame``, ``base_frame``, ``joint_offset``, ``link``, ``backlash`` or ``joint_compliance``
    target: str  # ``tool``, ``base``, the joint, or the parameter of the link, a length or a twist: ``elbow.a``
    share: float  # probability of the kind, given that one thing changed
    parameters: tuple[Parameter, ...]  # (p,) what deviates
    effect: Effect | None = None  # whose parameters they are; None of geometry
    alike: tuple[str, ...] = ()  # further targets that act as this one does in the rows

    @property
    def names(self) -> tuple[str, ...]:
        """(p,) names of the parameters in the arm."""
        return tuple(p.source for p in self.parameters)

    @property
    def forms(self) -> tuple[tuple[int, ...], ...]:
        """Places of the parameters that deviate, in each form of the change."""
        every = tuple(range(len(self.parameters)))
        return ((0, 1, 2), (0, 1, 5), every) if len(every) == len(FRAME_PARTS) else (every,)


def possible_changes(robot: Robot, data: Measurements) -> tuple[PossibleChange, ...]:
    """Everything that may have changed, whether or not these rows can show it, from the tool to effects of joints."""
    found, known = [], robot.parameters
    for name, free in (("tool", robot.tool_free), ("base", robot.base_free)):
        own = [known[f"{name}.{part}"] for part in FRAME_PARTS if f"{name}.{part}" in known]
        if not free:
            found.append(_geometric(f"{name}_frame", name, tuple(_parameter(factor, name) for factor in own)))
    driven = set(robot.driven)
    for joint, index in zip(robot.joint_names, robot.driven, strict=True):
        factor = robot.factors[index]
        if factor.parameter:
            found.append(_geometric("joint_offset", joint, (_parameter(factor, "geometry"),)))
    for index, factor in enumerate(robot.factors):
        owner = factor.parameter.rpartition(".")[0]
        if owner in robot.joint_names and index not in driven:
            found.append(_geometric("link", factor.parameter, (_parameter(factor, "geometry"),)))
    case = case_of(data, robot)
    for kind, share in _EFFECTS:
        found += [
            PossibleChange(e.kind, e.target, share, tuple(effect_parameters(e)), e) for e in kind.candidates(case)
        ]
    return tuple(found)


def _geometric(kind: str, target: str, parameters: tuple[Parameter, ...]) -> PossibleChange:
    return PossibleChange(kind, target, _SHARES[kind], parameters)


def _parameter(factor: Factor, group: str) -> Parameter:
    unit = "rad" if factor.kind == "rotate" else "m"
    return Parameter(factor.parameter, group, unit, factor.nominal, factor.parameter)


def effects_of(changes: Sequence[PossibleChange]) -> list[Effect]:
    """The effects among the changes."""
    return [change.effect for change in changes if change.effect is not None]


def change_model(problem: ProblemData, measuring: MeasurementModel, pool: Array) -> MeasurementModel:
    """Measurements with everything that may have changed, or is uncertain, as unknowns.

    pool (N, n) postures [rad or m]; a parameter that moves the tool in none of them is left out.
    """
    residuals, sources = measuring.residuals, problem.sources
    places = {p.name: p for p in residuals.parameters if p.group in OF_PLACES}
    changes = possible_changes(residuals.robot, residuals.data)
    zeros = np.zeros(len(residuals.parameters))
    wide = residuals.with_effects(effects_of(changes), zeros)
    factors, of_effects = residuals.robot.parameters, set(wide.arm.effect_parameters)
    found = {p.name: p for change in changes for p in change.parameters}
    for name in sources.names:
        if name in factors:
            unit = "rad" if factors[name].kind == "rotate" else "m"
            found.setdefault(name, Parameter(name, "geometry", unit, factors[name].nominal, name))
        elif name in of_effects:
            found.setdefault(name, Parameter(name, "effect", "1", 0.0, name))
    found |= places
    model = replace(measuring, residuals=replace(wide, parameters=tuple(found.values())))
    motion = _motion(model.blocks(pool, model.start))
    # 1e-6 of the largest motion of any parameter: less shows nothing
    kept = tuple(p for p, m in zip(found.values(), motion, strict=True) if m > 1e-6 * motion.max())
    return replace(measuring, residuals=replace(wide, parameters=kept))


def change_prior(problem: ProblemData, model: MeasurementModel, J: Array) -> PriorInformation:
    """``C + s² diag(1/m²)``: what the file leaves uncertain, and a change that moves the tool by s, 0.3e-3.

    J (N, b, k) whitened derivatives at the candidates; m is the root mean square motion by a unit.
    """
    names = tuple(p.name for p in model.parameters)
    motion = _motion(J) * model.residuals.sigma / np.sqrt(model.repeats)
    sources = problem.sources
    place = {name: i for i, name in enumerate(names)}
    rows = [i for i, name in enumerate(sources.names) if name in place]
    at = [place[sources.names[i]] for i in rows]
    # 0.3e-3 root mean square motion of the tool by a change that a plan is made to tell from others [m].
    # 30e-3 the same of what is found anew, as the places of an instrument: next to nothing is known of it [m].
    size = np.where([p.group in OF_PLACES for p in model.parameters], 30e-3, 0.3e-3)
    C = np.diag((size / motion) ** 2)
    C[np.ix_(at, at)] += sources.constant[np.ix_(rows, rows)]
    scale = np.sqrt(np.diag(C))
    W = np.linalg.inv(np.linalg.cholesky(C / np.outer(scale, scale))) / scale
    return PriorInformation(names, scale, np.ones(len(names), dtype=bool), W, W)


def change_information(model: MeasurementModel, data: Measurements | None, variance: float) -> GivenInformation:
    """What rows that were measured already tell of the same unknowns, at the arm of the file."""
    if data is None:
        return nothing_measured(len(model.parameters), variance)
    _, J = model.residuals.of_data(data).residuals_and_jacobian(model.start)
    return GivenInformation(J, model.start, variance, len(data), len(J))


def _motion(J: Array) -> Array:
    """(k,) root mean square motion by a unit of each unknown, in standard deviations, from derivatives (N, b, k)."""
    return np.asarray(np.sqrt(np.mean(np.sum(J**2, axis=1), axis=0)))
