"""A picture of every effect that moves the tool point: its error over what causes it, computed by its own class."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import posture_opt as po
from posture_opt.model.arm_state import ArmState, Inputs

Array = np.ndarray[Any, Any]
ROWS = 361
LINK = {"alpha": "0 deg", "limits": ["-180 deg", "180 deg"], "mass": "6 kg", "com": ["-0.2 m", "0 m", "0 m"]}
ROBOT = {
    "kind": "dh",
    "gravity": [0, -9.81, 0],
    "joints": [{"name": "shoulder", "a": "0.5 m", "gear_ratio": 101, **LINK}, {"name": "elbow", "a": "0.4 m", **LINK}],
}


class Sweep:
    """What is varied along the x axis: joints [rad], inputs, the values that are shown with their label."""

    def __init__(
        self, x: Array, label: str, *, shoulder: Array | float = 0.0, elbow: Array | float = 0.0, **inputs: Any
    ) -> None:
        self.x, self.label = x, label
        fixed = {"payload": 5.0, "approach_length": [np.full(ROWS, 1.0)] * 2, **inputs}
        self.joints = [np.broadcast_to(value, ROWS).astype(float) for value in (shoulder, elbow)]
        self.inputs = fixed

    def state(self, robot: Any, side: float) -> ArmState:
        """The arm along the sweep, its joints reached from one side."""
        arrays = {k: np.broadcast_to(v, ROWS) if np.isscalar(v) else v for k, v in self.inputs.items()}
        return ArmState(robot, self.joints, Inputs(approach=[np.full(ROWS, side)] * 2, **arrays))


def over_joint(low: float = -180, high: float = 180, label: str = "joint value [deg]") -> Sweep:
    degrees = np.linspace(low, high, ROWS)
    return Sweep(degrees, label, shoulder=np.radians(degrees))


def over_move() -> Sweep:
    degrees = np.linspace(0, 90, ROWS)
    return Sweep(degrees, "length of the last move [deg]", approach_length=[np.radians(degrees)] * 2)


def over_input(name: str, most: float, label: str, shown: float = 1.0, zero: float = 0.0) -> Sweep:
    values = np.linspace(0, most, ROWS)
    return Sweep(zero + values * shown, label, **{name: values})


def over_load() -> Sweep:
    return over_input("payload", 10, "payload [kg]")


def over_temperature() -> Sweep:
    return over_input("temperature", 15, "temperature [°C]", zero=20)


def over_time() -> Sweep:
    return over_input("time", 7200, "time [h]", 1 / 3600)


def over_speed() -> Sweep:
    degrees = np.linspace(0, 60, ROWS)
    return Sweep(degrees, "speed of the joint [deg/s]", speed=[np.radians(degrees), np.zeros(ROWS)])


def over_place() -> Sweep:
    angle = np.linspace(0, np.pi, ROWS)
    return Sweep(0.9 * np.cos(angle), "coordinate x of the tool point [m]", shoulder=angle)


def over_distance() -> Sweep:
    angle = np.linspace(np.pi, 0, ROWS)
    distance = np.sqrt(0.5**2 + 0.4**2 + 2 * 0.5 * 0.4 * np.cos(angle))
    return Sweep(distance, "distance from the instrument [m]", elbow=angle)


SHOULDER = {"joint": "shoulder"}
SHIFT = {"x": "0.1 mm", "y": "0 mm", "z": "0 mm"}
EXAMPLES: dict[str, tuple[dict[str, Any], Callable[[], Sweep]]] = {
    "joint_scale": ({**SHOULDER, "estimate": {"scale": 1e-4}}, over_joint),
    "gear_eccentricity": ({**SHOULDER, "estimate": {"sin": "0.1 mrad", "cos": "0.15 mrad"}}, over_joint),
    "gear_second_harmonic": ({**SHOULDER, "estimate": {"sin": "0.1 mrad", "cos": "0 mrad"}}, over_joint),
    "gear_ripple": (
        {**SHOULDER, "ratio": 101, "harmonic": 1, "estimate": {"sin": "0.1 mrad", "cos": "0 mrad"}},
        lambda: over_joint(0, 15),
    ),
    "cyclic_error": ({**SHOULDER, "cycles": 5, "estimate": {"sin": "0.1 mrad", "cos": "0 mrad"}}, over_joint),
    "joint_compliance": ({**SHOULDER, "estimate": {"compliance": "8 urad/(N m)"}}, over_joint),
    "link_bending": ({**SHOULDER, "estimate": {"compliance": "2 urad/(N m)"}}, over_joint),
    "base_compliance": ({"estimate": {"compliance": "2 urad/(N m)"}}, over_joint),
    "backlash": ({**SHOULDER, "estimate": {"width": "0.2 mrad"}}, over_joint),
    "hysteresis": ({**SHOULDER, "travel": "20 deg", "estimate": {"height": "0.2 mrad"}}, over_move),
    "load_backlash": ({**SHOULDER, "estimate": {"height": "3 urad/(N m)"}}, over_joint),
    "joint_coupling": (
        {"joint": "elbow", "follows": "shoulder", "estimate": {"ratio": 2e-4}},
        lambda: over_joint(label="value of the joint that is followed [deg]"),
    ),
    "payload_error": ({"estimate": {"sag": "2 urad/(N m)"}}, over_load),
    "thermal_growth": ({"length": "shoulder.a", "estimate": {"expansion": "12e-6 / K"}}, over_temperature),
    "thermal_offset": ({**SHOULDER, "estimate": {"rate": "10 urad/K"}}, over_temperature),
    "drift": ({"course": "exponential", "constant": "2400 s", "estimate": SHIFT}, over_time),
    "slip": ({"of": "shoulder", "moment": "4200 s", "estimate": {"step": "0.2 mrad"}}, over_time),
    "instrument_scale": ({"estimate": {"scale": "10 um/m"}}, over_distance),
    "instrument_field": (
        {"estimate": {f"{a}_{p}": "0 / m" for a in "xyz" for p in ("xx", "xy", "xz", "yy", "yz", "zz")}},
        over_place,
    ),
    "late_reading": ({"estimate": {"delay": "0.4 ms"}}, over_speed),
    "tool_shift": ({"estimate": SHIFT}, over_load),
    "quantisation": ({**SHOULDER, "lsb": "0.1 deg", "estimate": {"share": 1.0}}, lambda: over_joint(0, 0.5)),
}
EXAMPLES["instrument_field"][0]["estimate"] |= {"x_xx": "40e-6 / m", "y_xy": "60e-6 / m"}


def draw_effect(kind: str, folder: Path) -> None:
    """Write ``effect_KIND.png``: solid where the joint value was increasing on arrival, dashed where decreasing."""
    keys, sweep_of = EXAMPLES[kind]
    document = {"robot": ROBOT, "effects": [{"kind": kind, **keys}]}
    problem = po.problem_from_dict(document)
    sweep = sweep_of()
    figure = Figure(figsize=(4.2, 2.2), layout="constrained")
    axes = figure.subplots()
    unit = _draw_sides(axes, problem, sweep)
    axes.set_xlabel(sweep.label)
    axes.set_ylabel(unit)
    axes.grid(alpha=0.3)
    figure.savefig(folder / f"effect_{kind}.png", dpi=110)


def _draw_sides(axes: Axes, problem: po.Problem, sweep: Sweep) -> str:
    """One curve a side, two where they differ; the label of the y axis comes back."""
    (effect,) = problem.effects
    found = [_error(effect, sweep.state(problem.robot, side)) for side in (1.0, -1.0)]
    axes.plot(sweep.x, found[0][0], "-", color="C0")
    if not np.allclose(found[0][0], found[1][0]):
        axes.plot(sweep.x, found[1][0], "--", color="C0")
    return found[0][1]


def _error(effect: Any, state: ArmState) -> tuple[Array, str]:
    """(N,) what the effect does: to its joint [mrad], to a length [mm], or to the tool point [mm]."""
    total, label = np.zeros((3, ROWS)), ""
    for one, size in zip(effect.sensitivities(state), effect.values, strict=True):
        if one.joints:
            total[0], label = total[0] + 1e3 * size * next(iter(one.joints.values())), "joint error [mrad]"
        elif one.lengths:
            total[0], label = total[0] + 1e3 * size * next(iter(one.lengths.values())), "length error [mm]"
        else:
            shift = np.array([np.broadcast_to(part, ROWS) for part in one.twist[0]], dtype=float)
            total, label = total + 1e3 * size * shift, "shift of tool [mm]"
    along = total[0] if not total[1:].any() else np.linalg.norm(total, axis=0)
    return along, label
