"""Unnamed components: flexible terms that compete with the named effects, so that none wins for lack of rivals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.diagnosis.scores import levels
from posture_opt.model.effects import Cause, Excitation
from posture_opt.numerics import Array

_WAVE_DIRECTIONS = np.array([d for d in product((-1, 0, 1), repeat=3) if d > (0, 0, 0)], dtype=float)
"""Directions (13, 3) of waves over the workspace, one of each pair of opposites."""
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
_OF_SIDE = frozenset({"side and posture", "side and load", "foreign side"})


@dataclass(frozen=True)
class UnnamedComponent(Cause):
    """A flexible term of no physical cause.

    It says that something is there, and where; not what it is. A component wins only where no effect explains as much.

    Args:
        kind, target: what the error depends on, and where.
        shape: index of its grid; between two of them once it is refined.
    """

    kind: str
    target: str
    shape: float = 0.0

    @property
    def of_side(self) -> bool:
        """Whether the error depends on the side from which a joint arrived."""
        return self.kind in _OF_SIDE

    @property
    def words(self) -> str:
        """The component in words of a report."""
        return _PHRASES[self.kind].format(target=self.target)

    @property
    def title_or_words(self) -> str:
        """Its words: it has no name."""
        return self.words


def unnamed_components(
    sensitivities: EffectSensitivities, excitation: Excitation
) -> Iterator[tuple[UnnamedComponent, Array]]:
    """Every unnamed component with its columns (m, k), in nine families.

    A joint's error as a smooth curve, a dent or a square wave; products of first harmonics of two joints; the side of
    arrival by posture, by load, or of another joint; waves over the workspace; a course over time. Grids: `levels`.

    Args:
        sensitivities: what one unit of a joint or of the point does to every residual.
        excitation: which inputs the data vary.
    """
    yield from _joint_curves(sensitivities, excitation)
    yield from _joint_dents(sensitivities, excitation)
    yield from _square_waves(sensitivities, excitation)
    yield from _joint_products(sensitivities, excitation)
    if "approach" in excitation.inputs:
        yield from _side_interactions(sensitivities, excitation)
    yield from _workspace_waves(sensitivities, excitation)


def _moving_joints(excitation: Excitation) -> list[int]:
    """Joints that move in the data, to rounding [rad or m]."""
    return [i for i, span in enumerate(excitation.span) if span > 1e-6]


def _joint_curves(
    sensitivities: EffectSensitivities, excitation: Excitation
) -> Iterator[tuple[UnnamedComponent, Array]]:
    """Radial bases over the values of one joint: any smooth error of it, `levels.CURVE_BUMPS` parameters."""
    names = excitation.robot.joint_names
    for joint in _moving_joints(excitation):
        q = sensitivities.residuals.data.q[:, joint]
        yield (
            UnnamedComponent("curve", names[joint]),
            sensitivities.of_joint(joint, radial_bases(q, levels.CURVE_BUMPS)),
        )


def _joint_dents(
    sensitivities: EffectSensitivities, excitation: Excitation
) -> Iterator[tuple[UnnamedComponent, Array]]:
    """One Gaussian bump somewhere in the range of a joint: a damaged tooth, a dent in a rail; one parameter a place."""
    names = excitation.robot.joint_names
    for joint in _moving_joints(excitation):
        q = sensitivities.residuals.data.q[:, joint]
        shape = 0
        for width in levels.DENT_WIDTHS:
            count = int(np.clip(np.ptp(q) / (levels.DENT_SPACING * width), *levels.DENT_COUNT))
            for centre in np.linspace(q.min(), q.max(), count):
                bump = np.exp(-0.5 * ((q - centre) / width) ** 2)
                if (bump > 0.3).sum() >= levels.DENT_ROWS:
                    yield UnnamedComponent("dent", names[joint], shape), sensitivities.of_joint(joint, bump[:, None])
                    shape += 1


def finer_phases(
    sensitivities: EffectSensitivities, component: UnnamedComponent
) -> Iterator[tuple[UnnamedComponent, Array]]:
    """Square waves with phases between those of the grid, about one of it: a misplaced edge costs much evidence.

    Returns:
        Component and columns (m, 1) of each phase up to half way to the neighbours; nothing for other components.
    """
    if component.kind != "square wave":
        return
    joint = sensitivities.residuals.data.joint_names.index(component.target)
    q = sensitivities.residuals.data.q[:, joint]
    waves = levels.SQUARE_WAVES[int(component.shape) // levels.SQUARE_WAVE_PHASES]
    for part in np.arange(-levels.SQUARE_WAVE_FINER, levels.SQUARE_WAVE_FINER + 1) / (2 * levels.SQUARE_WAVE_FINER):
        wave = _square_wave(q, waves, component.shape % levels.SQUARE_WAVE_PHASES + part)
        yield (
            UnnamedComponent(component.kind, component.target, component.shape + part),
            sensitivities.of_joint(joint, wave[:, None]),
        )


def _square_wave(q: Array, waves: int, phase: float) -> Array:
    """A square wave (N,) of ``waves`` periods per revolution over joint values q [rad].

    Phases count in steps of the grid.
    """
    return np.asarray(np.sign(np.sin(waves * q + np.pi * phase / levels.SQUARE_WAVE_PHASES)))


def radial_bases(q: Array, count: int) -> Array:
    """Gaussian radial bases (N, count), evenly spaced over the range of q (N,); `levels.BUMP_WIDTH` wide."""
    centres = np.linspace(q.min(), q.max(), count)
    width = max(float(centres[1] - centres[0]), 1e-9)
    return np.exp(-0.5 * ((q[:, None] - centres) / (levels.BUMP_WIDTH * width)) ** 2)


def _square_waves(
    sensitivities: EffectSensitivities, excitation: Excitation
) -> Iterator[tuple[UnnamedComponent, Array]]:
    """Square waves of a revolute joint, as of an encoder's tracks.

    Those that hardly change sign in the data are left out.
    """
    names = excitation.robot.joint_names
    for joint in _moving_joints(excitation):
        if excitation.robot.joints[joint].type != "revolute":
            continue
        q = sensitivities.residuals.data.q[:, joint]
        for i, waves in enumerate(levels.SQUARE_WAVES):
            for phase in range(levels.SQUARE_WAVE_PHASES):
                wave = _square_wave(q, waves, phase)
                if np.abs(wave.mean()) < levels.CONSTANT_WAVE:
                    component = UnnamedComponent("square wave", names[joint], i * levels.SQUARE_WAVE_PHASES + phase)
                    yield component, sensitivities.of_joint(joint, wave[:, None])


def _joint_products(
    sensitivities: EffectSensitivities, excitation: Excitation
) -> Iterator[tuple[UnnamedComponent, Array]]:
    """The error of one joint as a product of first harmonics of it and another: four parameters an ordered pair."""
    names, q = excitation.robot.joint_names, sensitivities.residuals.data.q
    pairs = list(combinations(_moving_joints(excitation), 2))
    for a, b in [*pairs, *((b, a) for a, b in pairs)]:
        waves = [np.stack([np.sin(q[:, j]), np.cos(q[:, j])], axis=1) for j in (a, b)]
        features = (waves[0][:, :, None] * waves[1][:, None, :]).reshape(len(q), -1)
        yield UnnamedComponent("product", f"{names[a]} x {names[b]}"), sensitivities.of_joint(a, features)


def _side_interactions(
    sensitivities: EffectSensitivities, excitation: Excitation
) -> Iterator[tuple[UnnamedComponent, Array]]:
    """The side of approach in interactions that no named effect has: posture, load, another joint."""
    names, data, state = excitation.robot.joint_names, sensitivities.residuals.data, sensitivities.state
    for joint in _moving_joints(excitation):
        side, q = data.approach[:, joint], data.q[:, joint]
        waves = side[:, None] * np.stack([np.sin(q), np.cos(q)], axis=1)
        yield UnnamedComponent("side and posture", names[joint]), sensitivities.of_joint(joint, waves)
        for other in _moving_joints(excitation):
            if other == joint:
                continue
            if "masses" in excitation.inputs:
                torque = np.abs(np.broadcast_to(np.asarray(state.torque(other), dtype=float), (len(q),)))
                yield (
                    UnnamedComponent("side and load", f"{names[joint]} x {names[other]}"),
                    sensitivities.of_joint(joint, (side * torque)[:, None]),
                )
            foreign = data.approach[:, other][:, None]
            yield (
                UnnamedComponent("foreign side", f"{names[joint]} x {names[other]}"),
                sensitivities.of_joint(joint, foreign),
            )


def _workspace_waves(
    sensitivities: EffectSensitivities, excitation: Excitation
) -> Iterator[tuple[UnnamedComponent, Array]]:
    """Plane waves over the workspace in 13 directions and three wavelengths.

    And radial bases over time, if rows have one.
    """
    n = len(sensitivities.residuals.data)
    p = np.stack([np.broadcast_to(np.asarray(v, dtype=float), (n,)) for v in sensitivities.walk.position], axis=1)
    size = float(np.linalg.norm(np.ptp(p, axis=0)))
    axes = np.ptp(p, axis=0) > 1e-6
    directions = [d for d in _WAVE_DIRECTIONS if not np.any(d[~axes])]
    for shape, (direction, share) in enumerate((d, s) for d in directions for s in levels.FIELD_WAVELENGTHS):
        phase = 2 * np.pi / (share * max(size, 1e-9)) * (p @ (direction / np.linalg.norm(direction)))
        waves = np.stack([np.sin(phase), np.cos(phase)], axis=1)
        yield UnnamedComponent("field", "tool point", shape), sensitivities.of_point(waves)
    if "time" in excitation.inputs:
        t = np.asarray(sensitivities.state.inputs.time, dtype=float)
        yield UnnamedComponent("course", "time"), sensitivities.of_point(radial_bases(t, levels.COURSE_BUMPS))
