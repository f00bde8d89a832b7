"""``propagate``: where the tool point scatters at one posture, without sampling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from posture_opt.encoding import encoded
from posture_opt.errors import InputError, Issue
from posture_opt.model.arm import HasArm
from posture_opt.model.chain import Scalar, Walk
from posture_opt.numerics import Array
from posture_opt.result import Result
from posture_opt.robot.posture import Posture, PostureLike, beyond_limits, read_posture
from posture_opt.robot.robot import Robot
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.budget import Share, ShareGroup, budgets, share_groups
from posture_opt.uncertainty.integration import Integration
from posture_opt.uncertainty.pose_covariance import (
    POSE_FRAME,
    PoseCovariance,
    Validity,
    pose_covariance,
    second_order,
)
from posture_opt.uncertainty.regions import Ellipsoid
from posture_opt.uncertainty.sources import Sources, of_workpiece
from posture_opt.uncertainty.task_spread import HasDirection, TaskSpread, task_spread
from posture_opt.uncertainty.tool_point import ToolPoint


class HasSources(HasArm, Protocol):
    """Anything that names an arm, its sources of error and perhaps its task, such as a ``Problem``. ``task_sources``,
    which only a task asks for, are those of the arm and of the workpiece."""

    @property
    def sources(self) -> Sources: ...
    @property
    def task_sources(self) -> Sources: ...
    @property
    def task(self) -> HasDirection | None: ...


@dataclass(frozen=True, eq=False, repr=False)
class Spread(Result):
    """Moments of the tool pose at a posture; everything in the world frame unless stated.

    Args:
        problem: what was asked about; ``tool_point`` its robot and sources, as `budget` takes them.
        sources: whose errors these are: those of the arm, or of arm and workpiece where the moments are those of the
            tool relative to the workpiece.
        q: (n,) joint values [rad or m].
        position: (3,) nominal tool point [m].
        quaternion_wxyz: (4,) nominal orientation, w ≥ 0.
        covariance: (3, 3) of the tool point by ``method``, exact wherever a closed form exists [m²].
        covariance_first_order: (3, 3) ``J Σ Jᵀ`` [m²].
        bias: (3,) mean minus nominal tool point [m].
        integration: how a mean over factors that correlated errors share was taken, None in closed form.
        basis: (2, 3) or (3, 3) rows spanning the space of the ellipse: the plane of a planar arm, else all of it.
        source_notes: sentences on where the sources come from.

    Example:
        >>> from posture_opt import load_problem
        >>> spread = propagate(load_problem("insert_planar_2r"), {"joint1": "90 deg", "joint2": "-90 deg"})
        >>> spread.region(0.95).round(3).tolist()  # semi-axes [m]
        [0.047, 0.138]
        >>> spread.budget[0].parameter
        'joint2.theta'
    """

    problem: HasSources
    sources: Sources
    tool_point: ToolPoint
    q: tuple[float, ...]
    position: Array
    quaternion_wxyz: Array
    covariance: Array
    covariance_first_order: Array
    bias: Array
    basis: Array
    integration: Integration | None = None
    source_notes: tuple[str, ...] = field(default=())

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """The largest standard deviation, for the task where there is one; what limits it."""
        seen = self.for_task
        sigma = Quantity(float(self.ellipse.semi_axes[-1]))
        first = (state("uncertainty.deviation", sigma=sigma),) if seen is None else seen.statements(self.taught)
        return (*first, *self.limits, self.validity.statement)

    @property
    def limits(self) -> tuple[Statement, ...]:
        """A target elsewhere, and joints outside their limits."""
        task, found = self.problem.task, []
        if task is not None and task.position is not None:
            off = float(np.linalg.norm(self.position - np.array(task.position)))
            if off > 1e-4:  # m: at another place
                found.append(state("uncertainty.beside-target", distance=Quantity(off)))
        for joint, excess in beyond_limits(self.robot, self.q):
            style = "stated angle" if joint.type == "revolute" else "stated length"
            id, limit = ("above", joint.upper) if excess > 0 else ("below", joint.lower)
            beyond, stated = Quantity(abs(excess), style), Quantity(limit, style)
            found.append(state(f"uncertainty.{id}-limit", joint.name, excess=beyond, limit=stated))
        return tuple(found)

    @property
    def notes(self) -> tuple[str, ...]:
        """Where the sources come from, and which joints are outside their limits."""
        return (*self.source_notes, *(one.text for one in self.limits if one.about))

    @property
    def taught(self) -> bool:
        """Whether nothing errs but from repeat to repeat, as of a taught position."""
        return not np.any(self.seen.sources.constant)

    @property
    def robot(self) -> Robot:
        """The robot that ``q`` is a posture of."""
        return self.tool_point.robot

    @property
    def posture(self) -> Posture:
        """Joint name -> value [rad or m], printed in degrees."""
        return Posture(self.robot, self.q)

    @property
    def method(self) -> str:
        """How `covariance` was computed: ``exact``, ``exact, planar``, or at nodes whose error `integration` states."""
        return self.tool_point.method

    @cached_property
    def pose(self) -> PoseCovariance:
        """Covariance of the pose, and how it was found."""
        return pose_covariance(self.tool_point, self.q, self.covariance)

    @property
    def pose_covariance(self) -> Array:
        """(6, 6) of shift [m] and rotation vector ``log(R R₀ᵀ)`` [rad] from the nominal pose, world-aligned axes.

        Its block of the shift is `covariance`. Rotation vectors end at π: it holds while `pose` says
        ``within_half_turn``.
        """
        return self.pose.covariance

    @property
    def exact(self) -> Array:
        """The same as `covariance`."""
        return self.covariance

    @property
    def first_order(self) -> Array:
        """The same as `covariance_first_order`."""
        return self.covariance_first_order

    @cached_property
    def ellipse(self) -> Ellipsoid:
        """About the mean, in the coordinates of `basis`: two-dimensional for planar arms, else three."""
        return Ellipsoid(self.position + self.bias, self.covariance).project(self.basis)

    @property
    def axes(self) -> Array:
        """(m, 3) unit vectors along the axes of the ellipse in the world, one a row, the shortest axis first."""
        return np.asarray(self.ellipse.axes.T @ self.basis)

    @property
    def relative(self) -> bool:
        """Whether the moments are those of the tool relative to a workpiece that errs itself."""
        return any(map(of_workpiece, self.sources.names))

    @cached_property
    def seen(self) -> Spread:
        """The spread relative to the workpiece of the task, whose errors it adds; itself where none are stated.

        A workpiece whose place is free is taken in the middle of its ranges.
        """
        task = self.problem.task
        if task is None or self.relative or not any(map(of_workpiece, self.problem.task_sources.names)):
            return self
        x, y, z = map(float, self.position)
        return relative_spread(self.problem, self.q, task.lever_at((x, y, z)))

    @cached_property
    def for_task(self) -> TaskSpread | None:
        """The spread as the task of the problem sees it, errors of the workpiece included; None without a task."""
        task = self.problem.task
        if task is None:
            return None
        if self.seen is not self:
            return self.seen.for_task
        normal = np.cross(*self.basis) if len(self.basis) == 2 else None
        return task_spread(task, self.tool_point, self.q, (self.bias, self.covariance), normal)

    def region(self, p: float) -> Array:
        """(m,) semi-axes [m], ascending, of the region that holds the tool point with a probability.

        Args:
            p: that probability, between 0 and 1.
        """
        return self.ellipse.region(p)

    @cached_property
    def axis_budgets(self) -> tuple[tuple[Share, ...], ...]:
        """The error budget of every axis of the ellipse, in the order of `axes`."""
        return budgets(self.tool_point, self.q, self.axes)

    @property
    def budget(self) -> tuple[Share, ...]:
        """The error budget of the longest axis of the ellipse, the largest share first."""
        return self.axis_budgets[-1]

    @cached_property
    def budget_groups(self) -> tuple[ShareGroup, ...]:
        """The same budget, sources whose errors cancel taken together."""
        return share_groups(self.budget, self.tool_point, self.q, self.axes[-1])

    @cached_property
    def validity(self) -> Validity:
        """Whether the first-order ellipse may be trusted here."""
        reached, _ = self.tool_point.walk(self.q)
        return Validity.of(*second_order(reached, self.tool_point.indices, self.tool_point.covariance))

    def fields_json(self) -> dict[str, object]:
        """The document ``spread.json``: SI units, finite numbers only."""
        return {
            "posture": self.posture,
            "tool": encoded(self, "position quaternion_wxyz"),
            **encoded(self, "covariance covariance_first_order bias pose_covariance"),
            "pose_covariance_frame": POSE_FRAME,
            "pose_covariance_integration": self.pose.integration,
            "pose_covariance_within_half_turn": self.pose.within_half_turn,
            "ellipse": ellipse_json(self.ellipse, self.basis),
            **encoded(self, "method integration? budget budget_groups budget_of_axes=axis_budgets"),
            **task_json(self.for_task),
            **encoded(self, "validity notes"),
        }


def propagate(problem: HasSources, posture: PostureLike) -> Spread:
    """Mean and covariance of the tool pose at one posture, without sampling.

    With errors ``p ~ N(0, Σ)`` of the parameters the covariance of the tool point is ``C = Cov f(q, p)`` (3, 3) [m²],
    world: in closed form for independent errors and for planar arms; else exact given the factors that correlated
    errors share, and integrated over these until it has converged. It is positive semidefinite at any σ. Effects enter
    to first order; ``J Σ Jᵀ`` of everything is given next to C.

    Args:
        problem: names ``arm`` and ``sources``.
        posture: n joint values [rad or m], or joint name -> value. Limits are not enforced; a note says where
            they are exceeded.

    Returns:
        ``Spread``: ``position`` (3,) [m], ``covariance`` (3, 3) [m²], ``pose_covariance`` (6, 6), ``ellipse``,
        ``budget`` and ``validity``, world frame.

    Raises:
        InputError: a posture that is none, or a problem without sources of error.

    Example:
        >>> from posture_opt import load_problem
        >>> spread = propagate(load_problem("insert_planar_2r"), "90 deg, -90 deg")
        >>> spread.position.round(6).tolist(), spread.method
        ([1.0, 1.0, 0.0], 'exact')
    """
    q = read_posture(problem.arm.robot, posture)
    require_sources(problem.sources)
    return _spread_of(problem, problem.sources, ToolPoint.of(problem.arm, problem.sources), q)


def relative_spread(
    problem: HasSources, q: Sequence[float] | Array, lever: Sequence[float] | Array, sources: Sources | None = None
) -> Spread:
    """The spread at q (n,) relative to what the tool works on: `propagate` with the errors of the workpiece.

    The lever (3,) goes from its origin to the tool point [m], world; ``sources`` replace the ``task_sources``.
    """
    sources = problem.task_sources if sources is None else sources
    require_sources(sources)
    tool_point = ToolPoint.of(problem.arm, sources).seen_from([float(v) for v in lever])
    return _spread_of(problem, sources, tool_point, [float(v) for v in q])


def _spread_of(problem: HasSources, sources: Sources, tool_point: ToolPoint, q: Sequence[float]) -> Spread:
    """The spread of a tool point with these sources at a posture (n,)."""
    moments = tool_point.moments(q)
    covariance = _symmetric(moments.covariance)
    return Spread(
        problem=problem,
        sources=sources,
        tool_point=tool_point,
        q=tuple(q),
        position=moments.position,
        quaternion_wxyz=quaternion(moments.walk),
        covariance=covariance,
        covariance_first_order=_symmetric(moments.first_order),
        bias=moments.mean - moments.position,
        basis=ellipse_basis(tool_point, covariance),
        integration=moments.integration,
        source_notes=sources.notes,
    )


def require_sources(sources: Sources) -> None:
    """Refuse a problem in which nothing is uncertain."""
    if sources.empty:
        hint = "add for example uncertainty: {sigma: {joint1.theta: 0.02 deg}} or uncertainty: {repeatability: 0.05 mm}"
        raise InputError(Issue("nothing is uncertain, so nothing scatters", ("uncertainty",), hint=hint))


def ellipse_basis(tool_point: ToolPoint, covariance: Array) -> Array:
    """(2, 3) the plane of a planar arm whose tool point cannot leave it, else (3, 3) the world's axes."""
    plane = tool_point.plane
    if plane is None:
        return np.eye(3)
    normal = np.array(plane.normal)
    # Rounding of a plane that is tilted in the world leaves 1e-16 of the variance in its normal.
    if normal @ covariance @ normal > 1e-14 * np.trace(covariance):
        return np.eye(3)
    e1, e2 = np.array(plane.e1), np.array(plane.e2)
    # As one looks at it: what points up, or along a positive axis, is drawn upwards.
    return np.array([e1, e2 if e2[np.abs(e2).argmax()] > 0 else -e2])


def ellipse_json(ellipse: Ellipsoid, directions: Array) -> dict[str, object]:
    """Semi-axes of one σ [m] and their directions in the world; the ellipse is in coordinates along ``directions``."""
    return {
        "semi_axes_1sigma": ellipse.semi_axes,
        "axes": ellipse.axes.T @ directions,
        "coverage95_factor": ellipse.factor(0.95),
        "dimension": len(directions),
    }


def task_json(seen: TaskSpread | None) -> dict[str, object]:
    """What the task sees, and the budget of its worst axis; null without a task."""
    if seen is None:
        return dict.fromkeys(("task", "critical", "success_probability", "critical_budget", "critical_budget_groups"))
    budget = encoded(seen, "critical_budget=budget critical_budget_groups=budget_groups")
    return {"task": seen.kind, **seen.fields_json(), **budget}


def quaternion(reached: Walk) -> Array:
    """(4,) w, x, y, z with w ≥ 0 of the tool's orientation in the world."""
    R = np.array(reached.columns, dtype=float).T
    # The symmetric 4 x 4 matrix 4 q qᵀ: its largest column is the quaternion without cancellation.
    (a, b, c), (d, e, f), (g, h, i) = R
    K = np.array([
        [1 + a + e + i, h - f, c - g, d - b],
        [h - f, 1 + a - e - i, b + d, c + g],
        [c - g, b + d, 1 - a + e - i, f + h],
        [d - b, c + g, f + h, 1 - a - e + i],
    ])  # fmt: skip
    column = K[:, np.diag(K).argmax()]
    unit: Array = column / np.linalg.norm(column)
    return unit if unit[0] >= 0 else -unit


def _symmetric(matrix: Scalar) -> Array:
    """(m, m) the mean of a matrix and its transpose: rounding leaves them apart."""
    array = np.asarray(matrix, dtype=float)
    return np.asarray((array + array.T) / 2)
