"""``TaskSpread``: the part of a spread that a task depends on, its probability of success and its sources."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np

from posture_opt.encoding import Encoded, encoded
from posture_opt.numerics import Array
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.budget import Share, ShareGroup, budget, share_groups
from posture_opt.uncertainty.clearance import PARTS, Critical, Within, within_clearance
from posture_opt.uncertainty.peg_spread import HeldPart, PegSpread, YawSpread, peg_spread
from posture_opt.uncertainty.pose_covariance import pose_covariance
from posture_opt.uncertainty.regions import deviation
from posture_opt.uncertainty.tool_point import ToolPoint

Vector = tuple[float, float, float]


class HasDirection(Protocol):
    """What a spread needs to know of a task; ``direction`` and ``position`` [m] in the world, ``clearance`` [m]."""

    within: ClassVar[Within]

    @property
    def kind(self) -> str: ...
    @property
    def direction(self) -> Vector: ...
    @property
    def position(self) -> Vector | None: ...
    def direction_at(self, point: Vector) -> Vector: ...
    def lever_at(self, point: Vector) -> Vector: ...
    @property
    def clearance(self) -> float | None: ...
    @property
    def part(self) -> HeldPart | None: ...
    @property
    def yaw_lever(self) -> float: ...
    @property
    def uses_yaw(self) -> bool: ...
    @property
    def expansion(self) -> float | None: ...


@dataclass(frozen=True)
class TaskSpread(Encoded):
    """A spread as a task sees it."""

    kind: str  # of the task
    axes: Array  # (3, 3) two across the direction, then the direction, one a row, world
    clearance: float  # radial [m], NaN without one
    critical: Critical  # the part of the spread that counts
    sigma_along: float  # standard deviation along the direction [m]
    tool_point: ToolPoint  # whose budget it is
    q: tuple[float, ...]
    peg: PegSpread | None = None  # where the task has a peg, its two ends; critical is then that of the worse one
    yaw: YawSpread | None = None  # rotation about the direction, where the task depends on it
    expansion: float | None = None  # coverage factor of the expanded uncertainty, where one is asked for

    @property
    def direction(self) -> Array:
        """(3,) unit vector of the task, world."""
        return np.asarray(self.axes[2])

    @cached_property
    def success_probability(self) -> float | None:
        """Probability to stay within the clearance, mean shift included; None without a clearance."""
        if self.peg is not None:
            return self.peg.success
        return within_clearance(self.critical.covariance, self.clearance, self.critical.bias)

    @cached_property
    def budget(self) -> tuple[Share, ...]:
        """Share of each source in the variance along the worst axis, largest first."""
        return budget(self.tool_point, self.q, self.critical.worst_axis)

    @cached_property
    def budget_groups(self) -> tuple[ShareGroup, ...]:
        """Shares of sources, those whose errors cancel together."""
        return share_groups(self.budget, self.tool_point, self.q, self.critical.worst_axis)

    def statements(self, taught: bool) -> Iterator[Statement]:
        """The standard deviation in the part that counts, and the probability of success where there is a clearance."""
        part, sigma = PARTS[self.critical.within], Quantity(self.critical.sigma_max)
        if self.peg is None:
            yield state("uncertainty.deviation-for-task", part=part, sigma=sigma)
        else:
            end = "top end" if self.critical is self.peg.top else "tip"
            yield state("uncertainty.deviation-of-peg", end, part=part, sigma=sigma)
        yield from self.success_statement(taught)

    def success_statement(self, taught: bool) -> Iterator[Statement]:
        """The probability of success with its condition; nothing without a clearance."""
        if self.success_probability is not None:
            id = "uncertainty.success-taught" if taught else "uncertainty.success"
            p, clearance = Quantity(self.success_probability, "probability"), Quantity(self.clearance, "stated length")
            yield state(id, probability=p, clearance=clearance)

    def sampled(self, covariance: Array, bias: Array) -> TaskSpread:
        """With another covariance (3, 3) [m²] and mean shift (3,) [m], of a sample say."""
        critical = Critical.of(self.critical.within, self.critical.basis.T, covariance, bias)
        return replace(self, peg=None, yaw=None, critical=critical, sigma_along=sigma_along(self.direction, covariance))

    def hits(self, shift: Array, rotation: Array) -> int:
        """How many tool poses, by shifts (N, 3) [m] and rotation vectors (N, 3) [rad], world, are in the clearance."""
        ends = [shift] if self.peg is None else [shift, self.peg.top_shift(shift, rotation)]
        distances = [np.linalg.norm(end @ self.critical.basis.T, axis=1) for end in ends]
        return int(np.count_nonzero(np.max(distances, axis=0) <= self.clearance))

    @property
    def expanded(self) -> tuple[float, float] | None:
        """Expanded uncertainty ``U = k u`` [m] along the direction and in the worst one (JCGM 100:2008, 6.2.1)."""
        if self.expansion is None:
            return None
        return self.expansion * self.sigma_along, self.expansion * self.critical.sigma_max

    def of_task(self, task: HasDirection, basis: Array, covariance: Array) -> TaskSpread:
        """With yaw, expanded uncertainty and the worse end of a peg, as far as the task depends on them.

        The basis (3, m) is that of what counts, the covariance (3, 3) of the tool point [m²], world.
        """
        seen = replace(self, expansion=task.expansion)
        if task.uses_yaw:
            turning = pose_covariance(self.tool_point, self.q, covariance).covariance[3:, 3:]
            seen = replace(seen, yaw=YawSpread.of(turning, self.direction, task.yaw_lever, self.critical))
        if task.part is None:
            return seen
        seen = replace(seen, peg=peg_spread(task.part, self.tool_point, self.q, (self.critical, basis), self.clearance))
        assert seen.peg is not None
        if seen.peg.top.sigma_max <= seen.peg.tip.sigma_max:
            return seen
        return replace(seen, critical=seen.peg.top, tool_point=task.part.behind(self.tool_point))

    def fields_json(self) -> dict[str, object]:
        critical = self.critical.to_json() | {"sigma_along": self.sigma_along}
        found: dict[str, object] = {"critical": critical, **encoded(self, "success_probability peg? yaw?")}
        if self.expanded is not None:
            along, worst = self.expanded
            found["expanded_uncertainty"] = {"coverage_factor": self.expansion, "along": along, "worst": worst}
        return found


def task_spread(
    task: HasDirection, tool_point: ToolPoint, q: tuple[float, ...], moments: tuple[Array, Array], normal: Array | None
) -> TaskSpread:
    """The part of the spread at a posture that counts for a task, from mean shift (3,) [m] and covariance (3, 3) [m²].

    ``normal`` (3,) is that of the plane that the tool point never leaves, world; None for an arm in space.
    """
    bias, covariance = moments
    at = tool_point.walk([float(v) for v in q])[0].position
    direction = task.direction_at((float(at[0]), float(at[1]), float(at[2])))
    d = np.array(direction) / math.hypot(*direction)
    axes = np.vstack([across_basis(d, normal).T, d])
    basis = task_basis(task.within, d, normal)
    critical = Critical.of(task.within, basis, covariance, bias)
    clearance = math.nan if task.clearance is None else task.clearance
    seen = TaskSpread(task.kind, axes, clearance, critical, sigma_along(d, covariance), tool_point, q)
    return seen.of_task(task, basis, covariance)


def sigma_along(direction: Array, covariance: Array) -> float:
    """Standard deviation [m] of a covariance (3, 3) [m²] along a unit vector (3,); zero where it is rounding."""
    return deviation(float(direction @ covariance @ direction), covariance)


def task_basis(within: Within, direction: Array, normal: Array | None) -> Array:
    """(3, m) orthonormal basis of what counts, world; across a direction in the arm's plane it has one axis."""
    if within == "along":
        return direction[:, None]
    if within == "across":
        return across_basis(direction, normal)[:, : 1 if lies_in_plane(direction, normal) else 2]
    if normal is None:
        return np.eye(3)
    return across_basis(normal, None)


def lies_in_plane(direction: Array, normal: Array | None) -> bool:
    """Whether a unit vector (3,) lies in the plane with that normal (3,); not where there is no plane."""
    return normal is not None and abs(float(normal @ direction)) < 1e-9


def across_basis(direction: Array, normal: Array | None) -> Array:
    """(3, 2) orthonormal basis of the plane across a unit vector (3,); its first vector in the arm's plane if it can.
    Its sign is the one that people expect: the largest component positive."""
    d = direction
    if normal is not None and lies_in_plane(d, normal):
        b1 = np.cross(normal, d)
    else:
        helper = np.eye(3)[np.argmin(np.abs(d))]
        b1 = helper - d * (helper @ d)
    b1 = b1 / np.linalg.norm(b1)
    b1 = b1 * np.sign(b1[np.argmax(np.abs(b1))])
    return np.column_stack([b1, np.cross(d, b1)]) + 0.0
