"""``Term``: one quantity to minimise beside the task's own, or to keep within bounds; ``Quantities``: its symbols.

A term is a `Spec` whose fields are its keys in the file and whose methods are its mathematics. It never sees numbers
of a posture: its expressions become part of the one program that all solvers share.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import casadi as ca
from pydantic import Field

from posture_opt.errors import BadValueError, InputError, Issue, did_you_mean
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Walk
from posture_opt.robot.robot import Robot
from posture_opt.selection.terms import criteria
from posture_opt.spec import Spec
from posture_opt.uncertainty.clearance import Within
from posture_opt.uncertainty.peg_spread import HeldPart
from posture_opt.uncertainty.tool_point import ToolPoint
from posture_opt.units import JointQuantity


@dataclass(frozen=True)
class Quantities:
    """Expressions in the joints ``q`` (n,) and in the target's parameters; the cached ones cost nothing unasked.

    Args:
        walk: along the chain at ``q``.
        position: (3,) nominal tool point in the world [m].
        axis: (3,) tool axis in the world.
        frames: (3, n) origins of the frames behind the joints, world [m].
        covariance: (3, 3) exact covariance of the tool point [m²], world frame.
        bias: (3,) exact mean minus nominal [m].
        jacobian: (r, n) Jacobian of the tool point in the r directions that the arm can move it in [m/rad].
        bases: (3, m) orthonormal bases, for each part of the spread that can be asked for.
        within: the part of the spread that counts for the task; ``part`` is the peg whose other end counts too.
        yaw_lever: on which the yaw about the direction counts [m]; zero where it does not.
        clearance: radial clearance of the hole [m]; ``has_hole`` says whether the task states one.
    """

    tool_point: ToolPoint
    walk: Walk
    q: ca.SX
    position: ca.SX
    axis: ca.SX
    frames: ca.SX
    covariance: ca.SX
    bias: ca.SX
    jacobian: ca.SX
    bases: dict[Within, ca.SX]
    within: Within
    part: HeldPart | None
    yaw_lever: float
    clearance: ca.SX
    has_hole: bool

    @property
    def robot(self) -> Robot:
        return self.tool_point.robot

    def projected(self, within: Within) -> tuple[ca.SX, ca.SX]:
        """Covariance ``Bᵀ C B`` (m, m) [m²] and bias ``Bᵀ b`` (m,) [m] in the basis B of a part of the spread."""
        basis = self.bases[within]
        return basis.T @ self.covariance @ basis, basis.T @ self.bias

    @cached_property
    def ends(self) -> tuple[tuple[ca.SX, ca.SX], ...]:
        """Covariance (m, m) [m²] and bias (m,) [m] of the tool point, and of a peg's other end."""
        basis, every = self.bases[self.within], [self.projected(self.within)]
        if self.part is not None:
            moments = self.part.behind(self.tool_point).moments(ca.vertsplit(self.q))
            bias = ca.SX(moments.mean) - ca.SX(moments.position)
            every.append((basis.T @ ca.SX(moments.covariance) @ basis, basis.T @ bias))
        return tuple(every)

    @cached_property
    def minded(self) -> tuple[ca.SX, ...]:
        """Covariances [m²] of the ends; with a lever l of ``(Bᵀ x, l dᵀ φ)``, φ [rad] of first order."""
        if not self.yaw_lever:
            return tuple(C for C, _ in self.ends)
        basis, pose = self.bases[self.within], ca.SX(self.tool_point.pose_first_order(ca.vertsplit(self.q), self.walk))
        turn = self.yaw_lever * self.bases["along"]
        shared = basis.T @ pose[:3, 3:] @ turn
        return (ca.blockcat([[self.ends[0][0], shared], [shared.T, turn.T @ pose[3:, 3:] @ turn]]),)

    def largest(self, measure: Callable[[ca.SX], ca.SX]) -> ca.SX:
        """The largest measure [m²] of the covariances that count."""
        return criteria.largest([measure(C) for C in self.minded])

    @property
    def variance(self) -> ca.SX:
        """Variance [m²] along the worst axis, of the worse end: the square of ``sigma_max``; a yaw does not count."""
        return criteria.largest([criteria.worst(C) for C, _ in self.ends])

    @cached_property
    def log_miss(self) -> ca.SX:
        """Logarithm of the probability to miss; of a peg the sum over its ends, at most twice that of either."""
        misses = [criteria.log_miss(C, bias, self.clearance) for C, bias in self.ends]
        return misses[0] if len(misses) == 1 else ca.logsumexp(ca.vertcat(*misses))

    @cached_property
    def turning(self) -> ca.SX:
        """(3, 3) first-order covariance of the rotation of the tool [rad²], world axes."""
        return ca.SX(self.tool_point.pose_first_order(ca.vertsplit(self.q), self.walk))[3:, 3:]

    @cached_property
    def state(self) -> ArmState:
        """The arm with its weights at ``q``."""
        arm, q = self.tool_point.arm, ca.vertsplit(self.q)
        return ArmState(arm.robot, q, arm.inputs, carried=arm.carried(q))


@dataclass(frozen=True)
class Stated:
    """A bound as a user states it: ``low`` to ``high`` [unit], of one joint where ``joint`` names it.

    Infinite where the file gives no bound on that side.
    """

    low: float
    high: float
    unit: str
    joint: str = ""


class Term(Spec):
    """A quantity of the posture; in ``minimize`` it has a ``weight``, in ``subject_to`` bounds of its own.

    A kind implements `quantity`, `bounds` and `scale`; what else differs from the defaults here, it overrides. Rows
    are ``low ≤ quantity ≤ high`` for each entry of the (k,) quantity, the cost is ``Σ (quantity/scale)²``.
    """

    summary: ClassVar[str]  # one line for ``optimize-posture list``
    unit: ClassVar[str]  # SI unit of the quantity
    size: ClassVar[float] = 1.0  # typical one [unit]
    keeps_clear: ClassVar[bool] = False  # whether it keeps the arm away from obstacles

    # Whether reports state the spread of the orientation where it is asked for.
    uses_orientation: ClassVar[bool] = False

    kind: str
    weight: float = Field(default=1.0, ge=0, description="in `minimize`: its factor beside the spread")

    @property
    def part(self) -> Within | None:
        """The part of the spread it is about, or None."""
        return None

    @property
    def subjects(self) -> dict[tuple[str, ...], str]:
        """Kind and fields that say which quantity it is -> words; no two terms of a list may have the same."""
        bounds = {"kind", "weight", "at_least", "at_most"}
        return {(self.kind, *(repr(v) for k, v in self if k not in bounds)): self.kind}

    def check(self, robot: Robot) -> None:
        """Raise BadValueError where the term does not fit the robot: a joint that it has not, a mass not stated."""

    def for_robot(self, robot: Robot, bounded: bool) -> Term:
        """The term with named values of the robot, and in ``subject_to`` (``bounded``) with its bounds."""
        return self

    def held(self, robot: Robot) -> dict[int, float]:
        """Joint index -> value [rad or m] at which the search holds it; a term that holds joints has no rows."""
        return {}

    @abstractmethod
    def quantity(self, at: Quantities) -> ca.SX:
        """The (k,) expression [unit], smooth in the joints; a root needs a small number under it."""

    def cost(self, at: Quantities) -> ca.SX:
        """What ``minimize`` adds to the objective at weight one: the squared quantity in units of its scale."""
        return ca.sumsqr(self.quantity(at) / self.scale(at))

    def labels(self, at: Quantities) -> list[str]:
        """A name for every entry of the quantity, for people."""
        return [self.kind]

    @abstractmethod
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound of every entry, infinite where there is none."""

    def bounds_of(self, at: Quantities) -> list[tuple[float, float]]:
        """Lower and upper bound of each entry [unit]; an InputError without any."""
        low, high = self.bounds()
        if math.isinf(low) and math.isinf(high):
            where = "task", "subject_to"
            raise InputError(Issue(f"{self.kind} states no bound", where, self.kind, "add at_most or at_least"))
        return [self.bounds()] * len(self.labels(at))

    def units_of(self, at: Quantities) -> list[str]:
        return [self.unit] * len(self.labels(at))

    def stated(self) -> list[Stated]:
        """The bounds as the file states them, for reports: one entry, or one for each joint that is named."""
        return [Stated(*self.bounds(), self.unit)]

    @property
    def row_size(self) -> float:
        """What rows are divided by: solvers and tolerances take values about one [unit]."""
        return 1.0

    def shown(self, value: float) -> float:
        """A value of the quantity as reports state it: a torque without its sign, a probability for a logarithm."""
        return value

    def scale(self, at: Quantities) -> float:
        """A typical size of the quantity [unit]: the cost is measured in it, so that weights of one compare."""
        return self.size


class LowerBoundedTerm(Term):
    """A quantity that is to be at least ``at_least``."""

    if TYPE_CHECKING:
        at_least: float

    def bounds(self) -> tuple[float, float]:
        return self.at_least, math.inf


def joints_named(names: Iterable[str], robot: Robot) -> list[int]:
    known = robot.joint_names
    for name in names:
        if name not in known:
            raise BadValueError(f"'{name}' is no joint of this arm", did_you_mean(name, known))
    return [known.index(name) for name in names]


def joint_values(values: Mapping[str, JointQuantity], robot: Robot, *, within_limits: bool = False) -> dict[int, float]:
    """Joint index -> value [rad or m]; BadValueError for another dimension, or beyond limits that are to be kept."""
    found = {}
    for index, (name, given) in zip(joints_named(values, robot), values.items(), strict=True):
        joint = robot.joints[index]
        wanted = "angle" if joint.type == "revolute" else "length"
        if not given.suits(wanted):
            example = "30 deg" if wanted == "angle" else "80 mm"
            wanted = "an angle" if wanted == "angle" else "a length"
            raise BadValueError(f"{name} is {joint.type} and takes {wanted}", f"write {name}: {example}")
        if within_limits and not joint.lower <= given.value <= joint.upper:
            raise BadValueError(f"{name} cannot stand there: it lies beyond its limits", "choose a value within them")
        found[index] = given.value
    return found


class StandardDeviationTerm(Term):
    """A standard deviation σ [m or rad] with an upper bound: the row is ``σ/at_most ≤ 1``."""

    at_most: float | None = None

    def bounds(self) -> tuple[float, float]:
        return -math.inf, math.inf if self.at_most is None else self.at_most

    @property
    def row_size(self) -> float:
        return self.at_most or 1e-3  # m or rad: where no bound says what is large

    def scale(self, at: Quantities) -> float:
        return self.row_size
