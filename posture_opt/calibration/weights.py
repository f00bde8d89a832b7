"""Gravity's direction and the masses of an arm as assumptions: what the sag of its joints says of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from posture_opt.calibration.assumptions.refuted_statements import MIN_EVIDENCE
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.calibration.estimation.residuals import gravity_of
from posture_opt.encoding import Encoded
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements import Quantity, Statement, state

_SAME_DIRECTION = np.cos(np.radians(10.0))
"""Cosine within which two directions pull alike, and a base is upright."""
_ROUNDED = np.cos(np.radians(3.0))
"""Cosine within which a direction is that of an axis of the base."""
_LARGEST_SHARE, _MASSES_TRIED = 0.5, 26
"""Of the mass of all links, the most that one place carries beside what is stated; and how many masses are tried."""


@dataclass(frozen=True)
class GravityReading(Encoded, json="vector reading evidence line"):
    """Gravity in another direction than the file is taken to say."""

    key: ClassVar[str] = "gravity"

    vector: tuple[float, float, float]  # (3,) [m/s²], in the axes of the base as found; ``world`` in those of the data
    world: tuple[float, float, float]
    # ``instrument`` where its frame is level and the arm is not, ``base`` where it is the other way round, ``mounting``
    # where the arm stands neither upright nor in a level frame
    reading: str
    evidence: float  # logarithm of the likelihood ratio, by the sag of the joints alone
    base: Mapping[str, tuple[float, ...]]  # ``xyz`` [m] and ``rpy`` [rad] of the base as found

    @property
    def line(self) -> str:
        """What to write into the section ``robot`` of the problem file."""
        return f"gravity: [{', '.join(f'{v:.3g}' for v in self.vector)}]"

    @property
    def statement(self) -> Statement:
        return state("calibration.gravity", self.reading, line=self.line, evidence=self.evidence)

    def restated(self, problem: ProblemData) -> ProblemData:
        """The problem with this gravity, and the base where it was found: its axes then are those of the data."""
        base = {"xyz": [f"{v!r} m" for v in self.base["xyz"]], "rpy": [f"{v!r} rad" for v in self.base["rpy"]]}
        return problem.replace(robot__gravity=list(self.world), robot__base={**base, "free": True})


def better_gravity(calibration: Calibration) -> GravityReading | None:
    """The direction of gravity by which joints that give way explain clearly more; None where it is the one taken.

    ``r = G x + Σ_j c_j τ_j(g) + noise`` with c_j ≥ 0 for every direction g: turned over, the torques ask for joints
    that push against their load. Frame of the instrument and base compete; where the file states no gravity, so do the
    axes of the base, as of an arm on a wall or a ceiling.
    """
    sag, robot = _Sag.of(calibration), calibration.residuals.robot
    if not robot.base_free or not any(robot.gravity) or not sag.state.weighed:
        return None
    taken = np.array(gravity_of(robot, calibration.residuals.frames(calibration.x)))
    readings = {"taken": taken} | _other_directions(calibration, taken)
    left = {}
    for name, (x, y, z) in readings.items():
        pulled = replace(sag.state.robot, gravity=(float(x), float(y), float(z)))
        left[name] = sag.left(_with_robot(sag.state, pulled))
    best = min(left, key=lambda name: left[name])
    evidence = sag.evidence(left["taken"], left[best])
    if evidence <= MIN_EVIDENCE:
        return None
    return _reading(calibration, best.partition(" ")[0], readings[best], evidence)


@dataclass(frozen=True)
class MassReading(Encoded, json="place mass std evidence"):
    """A mass that the arm carries and the file does not state, or states and the arm does not carry."""

    key: ClassVar[str] = "masses"

    place: str  # joint behind which it is, or ``tool``
    mass: float  # beyond what is stated [kg], with its standard error ``std``
    std: float
    evidence: float  # logarithm of the likelihood ratio, by the sag of the joints alone

    @property
    def statement(self) -> Statement:
        mass = Quantity(self.mass, "mass", self.std if np.isfinite(self.std) else None)
        return state("calibration.masses", self.place, mass=mass, evidence=self.evidence)

    def restated(self, problem: ProblemData) -> ProblemData:
        """The problem without the masses that this one contradicts."""
        return problem.without_masses()


Reading = GravityReading | MassReading


def refuted_masses(calibration: Calibration) -> MassReading | None:
    """The further mass that explains clearly more of the sag than the masses of the file; None without such.

    One mass at one place at a time, ``τ_j + m τ_j(place)`` in every joint, at the m that leaves least.
    """
    sag = _Sag.of(calibration)
    relied_on = any("masses" in effect.asks for effect in calibration.residuals.arm.effects)
    if relied_on or not sag.state.weighed or not any(sag.state.robot.gravity):
        return None
    total, names = sum(joint.mass for joint in sag.state.robot.joints if joint.mass > 0), sag.state.robot.joint_names
    tried = np.linspace(-0.1, 1.0, _MASSES_TRIED) * _LARGEST_SHARE * total
    found, stated = list[MassReading](), sag.left(sag.state)
    for k, place in enumerate((*names[1:-1], "tool"), 1):
        left = np.array([sag.left(_heavier(sag.state, k if place != "tool" else None, float(m))) for m in tried])
        best = int(np.argmin(left))
        bend = np.polyfit(tried, np.log(left) * len(sag.r) / 2, 2)[0]
        std = 1 / float(np.sqrt(2 * bend)) if bend > 0 else np.inf
        found.append(MassReading(place, float(tried[best]), std, sag.evidence(stated, left[best])))
    best_one = max(found, key=lambda one: one.evidence)
    return best_one if best_one.evidence > MIN_EVIDENCE else None


@dataclass(frozen=True, eq=False)
class _Sag:
    """What a calibration leaves that joints which give way could explain."""

    # of the rows that count; r: (m,) their residuals and Q (m, k) an orthonormal basis of the geometry
    sensitivities: EffectSensitivities
    r: Array
    Q: Array

    @classmethod
    def of(cls, calibration: Calibration) -> _Sag:
        """Of the rows that are no outliers."""
        residuals = calibration.residuals.take(calibration.kept_rows)
        r, J = residuals.residuals_and_jacobian(calibration.x)
        Q = np.linalg.qr(J @ calibration.identifiability.directions)[0]
        return cls(EffectSensitivities(residuals, calibration.x), r - Q @ (Q.T @ r), Q)

    @property
    def state(self) -> ArmState:
        """The arm at all rows, its loads as stated."""
        return self.sensitivities.state

    def left(self, state: ArmState) -> float:
        """The least ``|r + Σ_j c_j τ_j|²`` for compliances c_j ≥ 0 of the turning joints under the loads of a state."""
        from scipy.optimize import nnls

        turning = [i for i, joint in enumerate(state.robot.joints) if joint.type == "revolute"]
        shape = (len(self.sensitivities.residuals.data), 1)
        torques = [np.broadcast_to(np.reshape(state.torque(i), (-1, 1)), shape) for i in turning]
        columns = [self.sensitivities.of_joint(i, torque) for i, torque in zip(turning, torques, strict=True)]
        Z = np.concatenate(columns, axis=1)
        Z = Z - self.Q @ (self.Q.T @ Z)
        scale = np.linalg.norm(Z, axis=0)
        return float(nnls(Z / np.where(scale > 0, scale, 1.0), -self.r)[1] ** 2)

    def evidence(self, stated: float, other: float) -> float:
        """Logarithm of the likelihood ratio of what two states leave."""
        return len(self.r) / 2 * float(np.log(stated / max(other, 1e-300)))


def _with_robot(state: ArmState, robot: Robot) -> ArmState:
    return ArmState(robot, state.q, state.inputs, state.p, state.carried)


def _heavier(state: ArmState, behind: int | None, mass: float) -> ArmState:
    """The arm with a further mass [kg] in the frame behind a joint; None: at the tool point."""
    if behind is None:
        inputs = replace(state.inputs, payload=np.asarray(state.inputs.payload) + mass)
        return ArmState(state.robot, state.q, inputs, state.p, state.carried)
    joints = list(state.robot.joints)
    m = joints[behind].mass + mass  # its centre moves towards the origin of the frame
    x, y, z = (v * joints[behind].mass / m if m > 0 else 0.0 for v in joints[behind].com)
    joints[behind] = replace(joints[behind], mass=m, com=(x, y, z))
    return _with_robot(state, replace(state.robot, joints=tuple(joints)))


def _other_directions(calibration: Calibration, taken: Array) -> dict[str, Array]:
    """Directions (3,) that gravity may have otherwise, by their reading, world."""
    robot = calibration.residuals.robot
    found_base, stated_base = _base_rotations(calibration)
    g = np.array(robot.gravity)
    every = {"instrument": g, "base": found_base @ stated_base.T @ g}
    if "gravity" not in calibration.request.problem.to_dict()["robot"]:
        axes = found_base.T
        every |= {f"mounting {i}": sign * np.linalg.norm(g) * axes[i // 2] for i, sign in enumerate([1, -1] * 3)}
    found, size = dict[str, Array](), float(g @ g)
    for name, one in every.items():
        if all(float(one @ other) < _SAME_DIRECTION * size for other in (taken, *found.values())):
            found[name] = one
    return found


def _base_rotations(calibration: Calibration) -> tuple[Array, Array]:
    """(3, 3) of the base in the world, as found and as the file places it."""
    base, off = calibration.residuals.robot.base, calibration.residuals.frames(calibration.x)
    found, stated = (np.array(walk(base, factor_values(base, [], at)).columns, dtype=float).T for at in (off, {}))
    return found, stated


def _reading(calibration: Calibration, name: str, world: Array, evidence: float) -> GravityReading:
    """A direction (3,) of the world, rounded to an axis of the base where it is one."""
    found, stated = _base_rotations(calibration)
    vector = (found @ stated.T).T @ world
    axis = int(np.argmax(np.abs(vector)))
    if abs(vector[axis]) > _ROUNDED * np.linalg.norm(vector):
        vector = np.sign(vector[axis]) * np.linalg.norm(vector) * np.eye(3)[axis]
    off = calibration.residuals.frames(calibration.x)
    at = {f.parameter: f.nominal + off.get(f.parameter, 0.0) for f in calibration.residuals.robot.base}
    axes = {"xyz": ("x", "y", "z"), "rpy": ("roll", "pitch", "yaw")}
    base = {key: tuple(at[f"base.{axis}"] for axis in names) for key, names in axes.items()}
    x, y, z = (float(v) + 0.0 for v in vector)  # no -0
    u, v, w = map(float, world)
    return GravityReading((x, y, z), (u, v, w), name, evidence, base)
