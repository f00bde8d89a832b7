"""Unnamed components: flexible terms that compete with the named effects, so that none wins for lack of rivals.

Their grids: halved or doubled as a whole, no kind changes a decision (ablation B of ``docs/concepts/ablation.md``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, combinations, product
from typing import ClassVar

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.diagnosis.scores import levels
from posture_opt.model.effects import Cause, Excitation
from posture_opt.numerics import Array, stacked_rows

_PHRASES = {
    "curve": "a smooth curve over {target}",
    "dent": "a local deviation in the range of {target}",
    "square wave": "a square wave over {target}",
    "product": "an interaction of two joints ({target})",
    "side and posture": "the side of approach of {target}, by posture",
    "side and load": "the side of approach by the load of another joint ({target})",
    "foreign side": "the side of approach of another joint ({target})",
    "field": "a wave over the workspace",
    "course": "a change with time",
}
_PHASES = 8  # of a square wave


@dataclass(frozen=True)
class UnnamedComponent(Cause):
    """A flexible term of no physical cause: something is there, and where; it wins where no effect explains as much.

    Args:
        shape: index of its grid; between two of them once it is refined.
    """

    kind: str
    target: str
    shape: float = 0.0
    family: ClassVar[str] = levels.UNNAMED_FAMILY
    limits: ClassVar[tuple[float, float]] = (-np.inf, np.inf)
    for_planning: ClassVar[bool] = False
    less_likely: ClassVar[bool] = False

    @property
    def of_side(self) -> bool:
        """Whether the error depends on the side from which a joint arrived."""
        return "side" in self.kind

    @property
    def words(self) -> str:
        return _PHRASES[self.kind].format(target=self.target)

    @property
    def title_or_words(self) -> str:
        return self.words


Features = Iterator[tuple[UnnamedComponent, int, Array]]  # component, its joint, and the joint's error (N, k)


def unnamed_components(
    sensitivities: EffectSensitivities, excitation: Excitation
) -> Iterator[tuple[UnnamedComponent, Array]]:
    """Every unnamed component with its columns (m, k), in nine families."""
    moving = [i for i, span in enumerate(excitation.span) if span > 1e-6]  # rad or m: more than rounding
    names, q = excitation.robot.joint_names, sensitivities.residuals.data.q
    revolute = [j for j in moving if excitation.robot.joints[j].type == "revolute"]
    of_joints = chain(
        ((UnnamedComponent("curve", names[j]), j, radial_bases(q[:, j], 8)) for j in moving),
        *(_dents(names[j], j, q[:, j]) for j in moving),
        *(_square_waves(names[j], j, q[:, j]) for j in revolute),
        _products(names, moving, q),
        _side_interactions(sensitivities, excitation, moving) if "approach" in excitation.inputs else (),
    )
    for component, joint, features in of_joints:
        yield component, sensitivities.of_joint(joint, features)
    yield from _workspace_waves(sensitivities, excitation)


def _dents(name: str, joint: int, q: Array) -> Features:
    """One Gaussian bump somewhere in the range of a joint, as a damaged tooth or a dent in a rail makes."""
    shape = 0
    for width in (0.15, 0.35):  # rad
        count = int(np.clip(np.ptp(q) / (1.5 * width), 4, 24))
        for centre in np.linspace(q.min(), q.max(), count):
            bump = np.exp(-0.5 * ((q - centre) / width) ** 2)
            if (bump > 0.3).sum() >= 4:  # rows where it is
                yield UnnamedComponent("dent", name, shape), joint, bump[:, None]
                shape += 1


def _square_waves(name: str, joint: int, q: Array) -> Features:
    """Square waves of one to six periods a turn, as of an encoder's tracks; those that hardly change sign left out."""
    for shape in range(6 * _PHASES):
        wave = _square_wave(q, shape)
        if np.abs(wave.mean()) < 0.95:
            yield UnnamedComponent("square wave", name, shape), joint, wave


def _square_wave(q: Array, shape: int, more: float = 0.0) -> Array:
    """(N, 1) square wave over joint values q [rad]; ``more`` of the phase than the grid's, in its steps."""
    periods, phase = divmod(shape, _PHASES)
    return np.asarray(np.sign(np.sin((periods + 1) * q + np.pi * (phase + more) / _PHASES)))[:, None]


def finer_phases(
    sensitivities: EffectSensitivities, component: UnnamedComponent
) -> Iterator[tuple[UnnamedComponent, Array]]:
    """Square waves with phases up to half way to the neighbours on the grid, with columns (m, 1); of others nothing."""
    if component.kind != "square wave":
        return
    joint = sensitivities.residuals.data.joint_names.index(component.target)
    q, shape = sensitivities.residuals.data.q[:, joint], component.shape
    for part in np.arange(-4, 5) / 8:
        wave = _square_wave(q, int(shape), shape - int(shape) + part)
        yield UnnamedComponent(component.kind, component.target, shape + part), sensitivities.of_joint(joint, wave)


def radial_bases(q: Array, count: int) -> Array:
    """Gaussian radial bases (N, count), evenly spaced over the range of q (N,), 0.7 of their distance wide."""
    centres = np.linspace(q.min(), q.max(), count)
    width = max(float(centres[1] - centres[0]), 1e-9)
    return np.exp(-0.5 * ((q[:, None] - centres) / (0.7 * width)) ** 2)


def _harmonic(q: Array) -> Array:
    return np.stack([np.sin(q), np.cos(q)], axis=1)


def _products(names: tuple[str, ...], moving: list[int], q: Array) -> Features:
    """The error of one joint as a product of first harmonics of it and another: four parameters an ordered pair."""
    pairs = list(combinations(moving, 2))
    for a, b in [*pairs, *((b, a) for a, b in pairs)]:
        features = _harmonic(q[:, a])[:, :, None] * _harmonic(q[:, b])[:, None, :]
        yield UnnamedComponent("product", f"{names[a]} x {names[b]}"), a, features.reshape(len(q), -1)


def _side_interactions(sensitivities: EffectSensitivities, excitation: Excitation, moving: list[int]) -> Features:
    """The side of approach in interactions that no named effect has: posture, load, another joint."""
    names, data, state = excitation.robot.joint_names, sensitivities.residuals.data, sensitivities.state
    for joint in moving:
        side, q = data.approach[:, joint], data.q[:, joint]
        yield UnnamedComponent("side and posture", names[joint]), joint, side[:, None] * _harmonic(q)
        for other in moving:
            pair = f"{names[joint]} x {names[other]}"
            if other != joint and "masses" in excitation.inputs:
                torque = np.abs(np.broadcast_to(np.asarray(state.torque(other), dtype=float), (len(q),)))
                yield UnnamedComponent("side and load", pair), joint, (side * torque)[:, None]
            if other != joint:
                yield UnnamedComponent("foreign side", pair), joint, data.approach[:, other][:, None]


def tool_points(sensitivities: EffectSensitivities) -> Array:
    """(N, 3) tool points of the rows [m], world frame."""
    return stacked_rows(sensitivities.walk.position, len(sensitivities.residuals.data))


def _workspace_waves(
    sensitivities: EffectSensitivities, excitation: Excitation
) -> Iterator[tuple[UnnamedComponent, Array]]:
    """Plane waves over the workspace in 13 directions and three wavelengths, and radial bases over time."""
    p = tool_points(sensitivities)
    size = float(np.linalg.norm(np.ptp(p, axis=0)))
    axes = np.ptp(p, axis=0) > 1e-6
    half = np.array([d for d in product((-1, 0, 1), repeat=3) if d > (0, 0, 0)], dtype=float)
    directions = [d for d in half if not np.any(d[~axes])]
    for shape, (direction, share) in enumerate(product(directions, (0.2, 0.3, 0.45))):  # wavelengths in sizes
        phase = 2 * np.pi / (share * max(size, 1e-9)) * (p @ (direction / np.linalg.norm(direction)))
        yield UnnamedComponent("field", "tool point", shape), sensitivities.of_point(_harmonic(phase))
    if "time" in excitation.inputs:
        t = np.asarray(sensitivities.state.inputs.time, dtype=float)
        yield UnnamedComponent("course", "time"), sensitivities.of_point(radial_bases(t, 5))
