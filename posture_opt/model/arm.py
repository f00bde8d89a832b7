"""``Arm``: the symbolic forward model ``pose = fk(q, p)`` that everything else is derived from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import casadi as ca
import numpy as np

from posture_opt.model.chain import Walk, stack
from posture_opt.model.derivatives import twist_column
from posture_opt.model.extension import extension_twists, forward
from posture_opt.robot.robot import Robot


class HasRobot(Protocol):
    """Anything that names a robot, such as a ``Problem``."""

    @property
    def robot(self) -> Robot: ...


@dataclass(frozen=True)
class Arm:
    """The forward model of a robot: commanded joints ``q`` and named model parameters ``p`` in, tool pose out.

    ``parameters`` fixes the order of ``p``; every parameter is an error, zero in the nominal model.
    All methods take CasADi expressions, or numbers, and return the like.
    """

    robot: Robot

    @classmethod
    def from_problem(cls, problem: HasRobot) -> Arm:
        """The arm of a problem."""
        return cls(problem.robot)

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the model parameters, from the base to the tool, and those of the effects."""
        extension = self.robot.extension
        return (*self.robot.parameters, *(extension.names if extension is not None else ()))

    @cached_property
    def q(self) -> ca.SX:
        """(n,) joint symbols [rad or m]."""
        return ca.SX.sym("q", self.robot.n)

    def walk(self, q: Any, p: Any = None) -> Walk:
        """The walk along the chain at ``q`` (n,) and ``p`` (k,): pose and screws as scalars."""
        robot = self.robot
        joints = split(q, robot.n, "posture")
        named: dict[str, Any] = {}
        if p is not None:
            named = dict(zip(self.parameters, split(p, len(self.parameters), "parameters"), strict=True))
        return forward(robot, joints, named)[0]

    def pose(self, q: Any, p: Any = None) -> Any:
        """``T_world_tool`` (4, 4) [m], a CasADi expression where ``q`` or ``p`` is one, else an array."""
        reached = self.walk(q, p)
        (r0, r1, r2), x = reached.columns, reached.position
        return stack([(r0[k], r1[k], r2[k], x[k]) for k in range(3)] + [(0.0, 0.0, 0.0, 1.0)])

    def position(self, q: Any, p: Any = None) -> Any:
        """The tool point (3,) in the world [m]."""
        return stack(self.walk(q, p).position)

    def jacobian(self, q: Any, p: Any = None) -> Any:
        """The geometric Jacobian (6, n) of the tool point, rows ``(v, ω)``, world-aligned axes."""
        reached = self.walk(q, p)
        columns = [twist_column(reached, i) for i in self.robot.driven]
        return stack(list(zip(*columns, strict=True)))

    def parameter_jacobian(self, q: Any, p: Any = None) -> Any:
        """``∂(x, φ)/∂p`` (6, k): tool-point shift and small rotation per parameter, world-aligned axes."""
        reached = self.walk(q, p)
        columns = [twist_column(reached, i) for i, factor in enumerate(self.robot.factors) if factor.parameter]
        joints = split(q, self.robot.n, "posture")
        columns += [(*shift, *turn) for shift, turn in extension_twists(self.robot, joints, reached)[0]]
        return stack(list(zip(*columns, strict=True)))


def split(values: Any, size: int, what: str) -> Sequence[Any]:
    """The ``size`` entries of a vector: of an SX, a sequence, or an array whose last axis has that size."""
    if isinstance(values, ca.SX | ca.MX | ca.DM):
        entries: Sequence[Any] = ca.vertsplit(ca.vec(values))
        if isinstance(values, ca.DM):
            entries = [float(entry) for entry in entries]
    elif isinstance(values, list | tuple) and any(isinstance(v, ca.SX | ca.MX) for v in values):
        entries = values
    else:
        array = np.asarray(values, dtype=float)
        entries = [float(v) for v in array] if array.ndim == 1 else [array[..., k] for k in range(array.shape[-1])]
    if len(entries) != size:
        raise ValueError(f"{what}: {len(entries)} values given, {size} expected")
    return entries
