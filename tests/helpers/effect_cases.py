"""Effects to try: simulated arms with their sessions, and instances of every listed kind."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

import posture_opt as po
from posture_opt.model.arm_state import Inputs
from posture_opt.model.effects import Effect, Excitation
from posture_opt.problem.schema import read_sections
from tests.hidden import effects as hidden
from tests.hidden.arms import ARMS
from tests.hidden.designs import REFERENCE, Plan, draw_session
from tests.hidden.draw import place
from tests.hidden.files import document

ALL_INPUTS = frozenset({"approach", "payload", "temperature", "time", "masses", "gear_ratio", "speed"})
SHAPES = ("ur10", "scara", "seven")
SCANNED = {"cyclic_error": {"cycles": 7.3}, "gear_ripple": {"ratio": 101.0, "harmonic": 2}}
"""Kinds without candidates, scanned by the diagnosis or in want of a gear ratio: the shape of one instance."""


@cache
def robots(tmp: Any) -> dict[str, Any]:
    """Simulated site, and the robot of its file with the inputs of its rows, of each arm."""
    found = {}
    for name in (*SHAPES, "planar"):
        rng = np.random.default_rng(11)
        arm = place(rng, ARMS[name]())
        session = draw_session(rng, arm, Plan(rows=40, repeated=0, logged=True, sides=name != "seven"))
        case = SimpleNamespace(nominal=arm, free=False, word=False, truth={"sigma": 5e-5}, priors={})
        if arm.urdf:
            (tmp / "arm.urdf").write_text(arm.urdf)
        robot = po.problem_from_dict(document(case), folder=tmp).robot
        inputs = Inputs(
            payload=session.payload,
            approach=list(session.side.T),
            approach_length=list(session.travel.T),
            temperature=session.temperature - REFERENCE,
            time=session.time,
            stated=robot.joint_names,
            speed=list(hidden.speeds(session).T),
        )
        found[name] = (hidden.Site(arm, session, {}), robot, inputs)
    return found


def excitation(site: hidden.Site, robot: Any) -> Excitation:
    """A session that knows every input."""
    span = tuple(np.ptp(site.session.q, axis=0).tolist())
    return Excitation(robot, ALL_INPUTS, span, float(site.session.time[-1]))


def instances(cls: type[Effect], site: hidden.Site, robot: Any) -> list[Effect]:
    """What the data could show of a kind, a handful."""
    case = excitation(site, robot)
    found = list(cls.candidates(case))
    if cls.kind_name() == "instrument_scale":
        return [cls()]
    if not found and cls.kind_name() in SCANNED:
        return [cls(joint=name, **SCANNED[cls.kind_name()]) for name in case.moving("revolute")]
    return found[:: max(1, len(found) // 6)]


def sized(effect: Effect, rng: np.random.Generator) -> Effect:
    """With an estimate at random, of the size that effects have."""
    size = {"ratio": 3e-4, "angle": 3e-4, "length": 3e-4, "angle per torque": 3e-6, "angle mass per torque": 3e-5,
            "per temperature": 1e-5, "angle per temperature": 1e-5, "per length": 3e-4,
            "length per length": 1e-5, "length per angle": 3e-4, "time": 3e-4}  # fmt: skip
    values = [size[dimension] * rng.uniform(0.3, 1.0) * rng.choice([-1, 1]) for _, dimension in effect.dimensions]
    return effect.with_estimate(values)


def with_effects(robot: Any, effects: tuple[Effect, ...], inputs: Inputs) -> po.Arm:
    return po.Arm(robot, effects, inputs)


def one_row(inputs: Inputs, row: int) -> Inputs:
    return Inputs(
        payload=float(inputs.payload[row]),
        approach=[float(side[row]) for side in inputs.approach],
        approach_length=[float(length[row]) for length in inputs.approach_length],
        temperature=float(inputs.temperature[row]),
        time=float(inputs.time[row]),
        stated=inputs.stated,
        speed=[float(speed[row]) for speed in inputs.speed],
    )


def read(entry: dict[str, Any]) -> Effect:
    """An entry of ``effects:`` as a problem file has it."""
    spec = read_sections({"robot": {"kind": "preset", "name": "ur10"}, "effects": [entry]})
    return spec.effects[0]
