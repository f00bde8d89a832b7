"""Other postures for a task: the configuration each is in, its spread, and the most manipulable one.

Postures of one configuration are joined by motions that pass no singular posture of this kind; they differ by the spin
of the tool, or by what a redundant arm has over. The signs are those of the factors that vanish there: for six turning
joints (D. Pieper 1968; R. Paul, B. Shimano, G. Mayer, IEEE Trans. SMC 11 (1981) 449, for arms with a spherical wrist)
the distance of the wrist from the first axis, the bend of the elbow, and the sine of the fifth joint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from posture_opt.encoding import Encoded
from posture_opt.model.chain import Vector, factor_values, fixed_pose, stack, walk
from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array, Mask
from posture_opt.robot.posture import Posture
from posture_opt.robot.robot import Robot
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.solvers import Solver
from posture_opt.selection.terms.dexterity import Manipulability
from posture_opt.uncertainty.clearance import Critical
from posture_opt.uncertainty.peg_spread import peg_spread
from posture_opt.uncertainty.regions import deviation

_PARALLEL = 0.02  # sine [1] up to which axes are parallel, cosine up to which they are perpendicular; corrections lean
_ROUNDING = 1e-12  # m² or 1: a sign of less is that of a singular posture, which counts as not positive


def configurations(robot: Robot, Q: Array) -> list[tuple[str, ...]]:
    """Names of the configuration of each posture of Q (N, n) [rad or m]; empty for arms that have none."""
    low, high = (np.clip(np.array(ends), -1.0, 1.0) for ends in (robot.lower, robot.upper))
    regular = low + (high - low) * np.linspace(0.31, 0.73, robot.n)  # off all singular postures
    every = _Axes.at(robot, np.vstack([regular, *Q]))
    # Axes that pass each other within 0.5 % of the arm's length meet
    named = _structure(every.rows(slice(0, 1)), 5e-3 * robot.length)
    return [()] * len(Q) if named is None else list(zip(*named(every.rows(slice(1, None))), strict=True))


@dataclass(frozen=True)
class _Axes:
    """The turning axes of an arm at N postures: directions z (k, N, 3), points on them o (k, N, 3) [m]; directions of
    slides (s, N, 3), and the tool point (N, 3) [m]; up the z axis of the base (3,)."""

    z: Array
    o: Array
    slides: Array
    tool: Array
    up: Array

    @classmethod
    def at(cls, robot: Robot, Q: Array) -> _Axes:
        """The axes at Q (N, n) of the chain without effects."""
        reached = walk(robot.factors, factor_values(robot.factors, list(Q.T)))
        screws = [reached.screws[i] for i in robot.driven]

        def stacked(vectors: list[Vector]) -> Array:
            rows = [np.broadcast_to(stack(vector), (len(Q), 3)) for vector in vectors]
            return np.array(rows).reshape(-1, len(Q), 3)

        z, o = ([getattr(screw, name) for screw in screws if screw.rotates] for name in ("axis", "origin"))
        slides = [screw.axis for screw in screws if not screw.rotates]
        return cls(
            stacked(z), stacked(o), stacked(slides), stacked([reached.position])[0], fixed_pose(robot.base)[:3, 2]
        )

    def rows(self, chosen: slice) -> _Axes:
        return _Axes(self.z[:, chosen], self.o[:, chosen], self.slides[:, chosen], self.tool[chosen], self.up)

    def parallel(self, i: int, j: int) -> bool:
        return bool(np.all(np.linalg.norm(np.cross(self.z[i], self.z[j]), axis=1) < _PARALLEL))

    def perpendicular(self, i: int, j: int) -> bool:
        return bool(np.all(np.abs(_dot(self.z[i], self.z[j])) < _PARALLEL))

    def meeting(self, i: int, j: int) -> Array:
        """(N, 3) the point of axis i that is nearest to axis j, which is not parallel to it."""
        across = np.cross(self.z[i], self.z[j])
        along = _dot(np.cross(self.o[j] - self.o[i], self.z[j]), across) / _dot(across, across)
        return np.asarray(self.o[i] + along[:, None] * self.z[i])

    def passes(self, point: Array, i: int, distance: float) -> bool:
        """Whether axis i passes points (N, 3) within a distance [m]."""
        return bool(np.all(np.linalg.norm(np.cross(point - self.o[i], self.z[i]), axis=1) <= distance))

    def triple(self, i: int, j: int, k: int) -> Array:
        """(N,) ``(z_i × z_k) · z_j``: the sine of joint j where the axes are perpendicular in turn."""
        return _dot(np.cross(self.z[i], self.z[k]), self.z[j])


Names = tuple[list[str], ...]  # of each posture a name for each sign


def _dot(u: Array, v: Array) -> Array:
    """(N,) products of the rows of two arrays (N, 3)."""
    return np.asarray(np.sum(u * v, axis=1))


def _either(holds: Mask, yes: str, no: str) -> list[str]:
    """(N,) one name where something holds, else the other."""
    return [yes if one else no for one in holds]


def _structure(at: _Axes, near: float) -> Callable[[_Axes], Names] | None:
    """The names of an arm's configurations, from one regular posture; axes within ``near`` [m] meet."""
    turning, slides = len(at.z), len(at.slides)
    if turning in (2, 3) and all(at.parallel(0, k) for k in range(turning)):
        return _planar if np.all(np.linalg.norm(np.cross(at.slides, at.z[0]), axis=2) < _PARALLEL) else None
    if turning == 7 and not slides and all(at.perpendicular(k, k + 1) for k in range(6)):
        return _seven
    if turning != 6 or slides or not at.perpendicular(0, 1) or not at.parallel(1, 2) or at.parallel(4, 5):
        return None
    wrist = at.meeting(4, 5)
    if not at.passes(wrist, 5, near):
        return None
    if at.passes(wrist, 3, near) and not at.parallel(2, 3):
        return _spherical
    return _parallel_wrist if at.parallel(2, 3) else None


def _planar(at: _Axes) -> Names:
    end = at.o[2] if len(at.z) == 3 else at.tool
    left = _dot(np.cross(end - at.o[0], at.o[1] - at.o[0]), at.z[0]) > _ROUNDING
    return (_either(left, "elbow left", "elbow right"),)


def _spherical(at: _Axes) -> Names:
    return _shoulder_elbow_wrist(at, at.meeting(4, 5), at.meeting(4, 5))


def _parallel_wrist(at: _Axes) -> Names:
    return _shoulder_elbow_wrist(at, at.meeting(4, 5), at.o[3])


def _shoulder_elbow_wrist(at: _Axes, wrist: Array, forearm: Array) -> Names:
    """Signs by the ends (N, 3) of wrist and forearm [m]: the side of the second axis, the elbow above or below the line
    from shoulder to forearm end (base upright), and the fifth joint's sine.
    """
    across = np.cross(at.z[0], at.z[1])
    right = _dot(across, wrist - at.o[0]) > _ROUNDING
    line, bend = forearm - at.o[1], at.o[2] - at.o[1]
    ahead = np.where(right, 1.0, -1.0)[:, None] * across
    up = _dot(line, ahead) * (bend @ at.up) - (line @ at.up) * _dot(bend, ahead) > _ROUNDING
    return (
        _either(right, "shoulder right", "shoulder left"),
        _either(up, "elbow up", "elbow down"),
        _either(at.triple(3, 4, 5) > _ROUNDING, "wrist not flipped", "wrist flipped"),
    )


def _seven(at: _Axes) -> Names:
    named = zip(("shoulder", "elbow", "wrist"), (0, 2, 4), strict=True)
    return tuple(
        _either(at.triple(k, k + 1, k + 2) > _ROUNDING, f"{name} not flipped", f"{name} flipped") for name, k in named
    )


@dataclass(frozen=True)
class EndMoments:
    """At N postures the tool point, and the moments of the end that counts."""

    position: Array  # (N, 3) nominal tool point, world [m]
    covariance: Array  # (N, 3, 3) [m²]
    bias: Array  # (N, 3) mean shift [m]
    sigma: Array  # (N,) σ_max [m]


def end_moments(problem: OptimisationProblem, Q: Array, basis: Array, lever: Array) -> EndMoments:
    """Moments at postures Q (N, n) [rad or m] in the ``basis`` (3, m); of a peg those of the worse end."""
    tip, part = problem.tool_point.seen_from(lever.tolist()), problem.task.part
    columns = [np.ascontiguousarray(column) for column in Q.T]
    ends = []
    for point in [tip] if part is None else [tip, part.behind(tip)]:
        moments = point.moments(columns)
        C = np.broadcast_to(moments.covariance, (len(Q), 3, 3))
        sigma = [deviation(float(np.linalg.eigvalsh(basis.T @ c @ basis)[-1]), c) for c in C]
        bias = np.broadcast_to(moments.mean - moments.position, (len(Q), 3))
        ends.append(EndMoments(np.broadcast_to(moments.position, (len(Q), 3)), C, bias, np.array(sigma)))
    if len(ends) == 1:
        return ends[0]
    worse = ends[1].sigma > ends[0].sigma
    C, bias = (
        np.where(worse.reshape(-1, *[1] * (a.ndim - 1)), b, a)
        for a, b in ((ends[0].covariance, ends[1].covariance), (ends[0].bias, ends[1].bias))
    )
    return EndMoments(ends[0].position, C, bias, np.maximum(ends[0].sigma, ends[1].sigma))


def success_with_peg(problem: OptimisationProblem, q: Array, basis: Array, target: TaskTarget) -> float | None:
    """The probability that both ends of the task's peg stay within the clearance; None without a peg or a clearance."""
    part = problem.task.part
    if part is None:
        return None
    point = problem.tool_point.seen_from(target.lever.tolist())
    moments = point.moments(q.tolist())
    C, bias = (np.asarray(v, dtype=float) for v in (moments.covariance, moments.mean - moments.position))
    tip = Critical.of(problem.task.within, basis, C, bias)
    return peg_spread(part, point, tuple(q.tolist()), (tip, basis), target.clearance).success


@dataclass(frozen=True)
class ManipulablePosture(Encoded, json="posture manipulability sigma_max"):
    """A posture (joint name -> rad or m), its manipulability [m/rad] and its σ_max [m]."""

    posture: Posture
    manipulability: float
    sigma_max: float


def most_manipulable(
    problem: OptimisationProblem, target: TaskTarget, solver: Solver, Q: Array
) -> ManipulablePosture | None:
    """The best from feasible postures Q (N, n): rows hold, the spread plays no part; None without any."""
    if not len(Q) or not problem.quantities.jacobian.shape[0]:
        return None
    nlp, term = problem.nlp, Manipulability(kind="manipulability")
    cost = term.cost(problem.quantities)
    asked = replace(nlp, objective=cost, terms=((term.kind, cost),))
    measured = BatchFunction(
        ca.Function("manipulability", [nlp.x, nlp.p], [term.quantity(problem.quantities), nlp.variance]), compiled=False
    )
    sizes, _ = measured(Q, target.parameters)
    starts = Q[np.argsort(-sizes[:, 0], kind="stable")[:4]]
    if problem.freedom:
        polish = solver.build(asked)
        ends = asked.ends(target.parameters)
        starts = np.vstack([starts, *_met(asked, target, [polish(q, target.parameters, ends).x for q in starts])])
    sizes, variances = (column[:, 0] for column in measured(starts, target.parameters))
    # Of equally good ones the one that scatters least
    best = min(np.flatnonzero(sizes >= (1 - 1e-4) * sizes.max()), key=lambda k: float(variances[k]))
    posture = Posture(problem.robot, starts[best])
    return ManipulablePosture(posture, float(sizes[best]), float(np.sqrt(max(variances[best], 0.0))))


def _met(nlp: Any, target: TaskTarget, found: Sequence[Array]) -> list[Array]:
    """Postures (n,) that meet every row."""
    screen = BatchFunction(nlp.screen, compiled=False)
    return [q for q in found if np.all(np.isfinite(q)) and screen(q[None], target.parameters)[1][0, 0] <= ROW_TOLERANCE]
