"""Umbrellas: curves without a name that compete with the named effects, so that none wins for lack of rivals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.tangents import Tangents
from posture_opt.model.effects import Case

Array = NDArray[np.float64]

_BUMPS = 8
_WAVES = range(1, 7)  # periods a turn of a square wave
_PHASES = 8


@dataclass(frozen=True)
class Umbrella:
    """A curve without a name: what it hangs on, where, and which of its grid it is."""

    kind: str
    target: str
    shape: int = 0


def umbrellas(tangents: Tangents, case: Case) -> Iterator[tuple[Umbrella, Array]]:
    """Every umbrella with its columns (m, k)."""
    yield from _joint_curves(tangents, case)
    yield from _square_waves(tangents, case)
    yield from _products(tangents, case)
    if "approach" in case.inputs:
        yield from _sides(tangents, case)
    yield from _fields(tangents, case)


def _moving(case: Case) -> list[int]:
    return [i for i, span in enumerate(case.span) if span > 1e-6]


def _joint_curves(tangents: Tangents, case: Case) -> Iterator[tuple[Umbrella, Array]]:
    """Radial bases of one joint."""
    names = case.robot.joint_names
    for joint in _moving(case):
        q = tangents.residuals.data.q[:, joint]
        yield Umbrella("curve", names[joint]), tangents.of_joint(joint, bumps(q))


def bumps(q: Array, count: int = _BUMPS) -> Array:
    """(N, count) Gaussian bumps side by side over the range of q; between quantiles, so that each has data."""
    centres = np.linspace(q.min(), q.max(), count)
    width = max(float(centres[1] - centres[0]), 1e-9)
    return np.exp(-0.5 * ((q[:, None] - centres) / (0.7 * width)) ** 2)


def _square_waves(tangents: Tangents, case: Case) -> Iterator[tuple[Umbrella, Array]]:
    names = case.robot.joint_names
    for joint in _moving(case):
        if case.robot.joints[joint].type != "revolute":
            continue
        q = tangents.residuals.data.q[:, joint]
        for i, waves in enumerate(_WAVES):
            for phase in range(_PHASES):
                wave = np.sign(np.sin(waves * q + np.pi * phase / _PHASES))
                if np.abs(wave.mean()) < 0.95:
                    umbrella = Umbrella("square wave", names[joint], i * _PHASES + phase)
                    yield umbrella, tangents.of_joint(joint, wave[:, None])


def _products(tangents: Tangents, case: Case) -> Iterator[tuple[Umbrella, Array]]:
    """The error of one joint as a product of it and another."""
    names, q = case.robot.joint_names, tangents.residuals.data.q
    pairs = list(combinations(_moving(case), 2))
    for a, b in [*pairs, *((b, a) for a, b in pairs)]:
        waves = [np.stack([np.sin(q[:, j]), np.cos(q[:, j])], axis=1) for j in (a, b)]
        features = (waves[0][:, :, None] * waves[1][:, None, :]).reshape(len(q), -1)
        yield Umbrella("product", f"{names[a]} x {names[b]}"), tangents.of_joint(a, features)


def _sides(tangents: Tangents, case: Case) -> Iterator[tuple[Umbrella, Array]]:
    """The side of approach times something that no named effect has."""
    names, data, site = case.robot.joint_names, tangents.residuals.data, tangents.site
    for joint in _moving(case):
        side, q = data.approach[:, joint], data.q[:, joint]
        waves = side[:, None] * np.stack([np.sin(q), np.cos(q)], axis=1)
        yield Umbrella("side and posture", names[joint]), tangents.of_joint(joint, waves)
        for other in _moving(case):
            if other == joint:
                continue
            if "masses" in case.inputs:
                torque = np.abs(np.broadcast_to(np.asarray(site.torque(other), dtype=float), (len(q),)))
                yield (
                    Umbrella("side and load", f"{names[joint]} x {names[other]}"),
                    tangents.of_joint(joint, (side * torque)[:, None]),
                )
            foreign = data.approach[:, other][:, None]
            yield Umbrella("foreign side", f"{names[joint]} x {names[other]}"), tangents.of_joint(joint, foreign)


def _fields(tangents: Tangents, case: Case) -> Iterator[tuple[Umbrella, Array]]:
    """A smooth error over the workspace, and one over time."""
    p = np.stack([np.broadcast_to(np.asarray(v, dtype=float), (len(tangents.residuals.data),))
                  for v in tangents.walk.position], axis=1)  # fmt: skip
    p = (p - p.mean(axis=0)) / max(float(p.std()), 1e-9)
    axes = [i for i in range(3) if np.ptp(p[:, i]) > 1e-6]
    squares = [p[:, i] * p[:, j] for k, i in enumerate(axes) for j in axes[k:]]
    yield Umbrella("field", "tool point"), tangents.of_point(np.stack(squares, axis=1))
    if "time" in case.inputs:
        t = np.asarray(tangents.site.inputs.time, dtype=float)
        yield Umbrella("course", "time"), tangents.of_point(bumps(t, 5))
