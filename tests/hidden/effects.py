"""The forms of the catalogue, term by term.

Signs: the error of a joint adds to its command, dq = … ; τ_j is gravity's torque ON the joint (see mechanics), so that
a positive compliance gives way to it; lost motion is positive where a joint stops short: one whose value was
increasing on arrival (s = +1) rests at −b/2; lengths
grow by α (T − T0), T0 = 20 °C, all of them (links, not tool) or one; ``link_bending`` of joint j turns the end of link
j by φ = κ M, M the moment of what lies beyond that end about it, and shifts it by φ × r / 2, r the vector along the
link (a beam under an end moment); ``base_compliance`` turns all by κ M about the base's origin; a slip of the base
shifts it, or shifts and turns it, one of the tool shifts it in its flange; drift dp = v (1 − exp(−t/τ)) or v t, in the
instrument's frame; the instrument's field is a quadratic in the tool point about the base.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tests.hidden.designs import REFERENCE, Session
from tests.hidden.mechanics import Arm, Array, Walk, exponential, moment, torques, walk


@dataclass(frozen=True, eq=False)
class Site:
    """The true arm without effects in a session."""

    arm: Arm
    session: Session
    deviations: dict[str, Array | float]

    @cached_property
    def walk(self) -> Walk:
        return walk(self.arm, self.session.q, self.deviations)

    @cached_property
    def tau(self) -> Array:
        return torques(self.arm, self.walk, self.session.payload)

    @cached_property
    def payload_tau(self) -> Array:
        return self.tau - torques(self.arm, self.walk, 0 * self.session.payload)

    @property
    def warmth(self) -> Array:
        return self.session.temperature - REFERENCE

    def joint(self, name: str) -> int:
        return self.arm.joints.index(name)

    def end(self, j: int) -> Array:
        """(N, 3) the end of link j: its DH frame, or the origin of the next joint of a URDF."""
        w = self.walk
        if self.arm.kind == "dh":
            return w.o_link[:, j]
        return w.o[:, j + 1] if j + 1 < self.arm.n else w.p

    def along(self, j: int) -> Array:
        """(N, 3) the vector along link j, in the frame behind joint j."""
        return np.einsum("nba,nb->na", self.walk.R_link[:, j], self.end(j) - self.walk.o[:, j])

    def tip_moment(self, j: int) -> Array:
        """(N, 3) moment about the end of link j of all beyond it, in the frame behind joint j."""
        world = moment(self.arm, self.walk, self.session.payload, self.end(j), j + 1)
        return np.einsum("nba,nb->na", self.walk.R_link[:, j], world)

    def can_bend(self, least: float) -> list[int]:
        """Links longer than ``least`` [m], but the last."""
        lengths = np.linalg.norm([self.along(j)[0] for j in range(self.arm.n)], axis=1)
        return [j for j in range(self.arm.n - 1) if lengths[j] > least and not self.arm.prismatic[j]]

    @cached_property
    def base_moment(self) -> Array:
        w = self.walk
        return moment(self.arm, w, self.session.payload, w.o_base, 0)


@dataclass
class Perturbation:
    """What effects change; contributions add."""

    dq: dict[int, Array] = field(default_factory=dict)
    lengths: dict[str, Array] = field(default_factory=dict)
    twists: dict[int, tuple[Array, Array]] = field(default_factory=dict)
    turn: Array | float = 0.0  # (N, 3) rotation of everything about the base's origin, world
    shift: Array | float = 0.0  # (N, 3) of the measured point, world

    def joint(self, j: int, dq: Array) -> None:
        self.dq[j] = self.dq.get(j, 0.0) + dq


@dataclass(frozen=True)
class Effect:
    """A kind at a target: ``size`` enters linearly, ``shape`` does not; ``limits`` bound a factor on ``size``."""

    kind: str
    target: str
    size: dict[str, float]
    shape: dict[str, float] = field(default_factory=dict)
    limits: tuple[float, float] = (1.0, 1.0)

    def scaled(self, factor: float) -> Effect:
        size = {k: v * factor for k, v in self.size.items()}
        return Effect(self.kind, self.target, size, self.shape, self.limits)

    def only(self, name: str, value: float) -> Effect:
        return Effect(self.kind, self.target, {k: value * (k == name) for k in self.size}, self.shape)

    @property
    def name(self) -> tuple[str, str]:
        return self.kind, self.target


Form = Callable[[Site, Effect, Perturbation], None]
FORMS: dict[str, Form] = {}


def form(kind: str) -> Callable[[Form], Form]:
    def add(function: Form) -> Form:
        FORMS[kind] = function
        return function

    return add


def of_joint(kind: str, law: Callable[..., Array]) -> None:
    """A kind whose error of its joint j is ``law(site, j, size and shape)``."""

    def act(site: Site, e: Effect, out: Perturbation) -> None:
        j = site.joint(e.target)
        out.joint(j, law(site, j, {**e.size, **e.shape}))

    FORMS[kind] = act


def _wave(x: Array, v: dict[str, float]) -> Array:
    return v["a"] * np.sin(x) + v["b"] * np.cos(x)


of_joint("joint_scale", lambda s, j, v: v["c"] * s.session.q[:, j])
of_joint("gear_eccentricity", lambda s, j, v: _wave(s.session.q[:, j], v))
of_joint("gear_second_harmonic", lambda s, j, v: _wave(2 * s.session.q[:, j], v))
of_joint("gear_ripple", lambda s, j, v: _wave(v["n"] * v["N"] * s.session.q[:, j], v))
of_joint("cyclic_error", lambda s, j, v: _wave(v["k"] * s.session.q[:, j], v))
of_joint("joint_compliance", lambda s, j, v: v["c"] * s.tau[:, j])
of_joint("backlash", lambda s, j, v: -v["b"] / 2 * s.session.side[:, j])
of_joint("hysteresis", lambda s, j, v: v["h"] * s.session.side[:, j] * np.expm1(-s.session.travel[:, j] / v["d0"]))
of_joint("load_backlash", lambda s, j, v: -v["h"] * s.session.side[:, j] * np.abs(s.tau[:, j]))
of_joint("thermal_offset", lambda s, j, v: v["c"] * s.warmth)
of_joint(
    "quantisation", lambda s, j, v: v["share"] * (np.round(s.session.q[:, j] / v["lsb"]) * v["lsb"] - s.session.q[:, j])
)


@form("joint_coupling")
def _coupling(site: Site, e: Effect, out: Perturbation) -> None:
    a, b = map(site.joint, e.target.split("->"))
    out.joint(b, e.size["c"] * site.session.q[:, a])


@form("link_bending")
def _bending(site: Site, e: Effect, out: Perturbation) -> None:
    j, w = site.joint(e.target), site.walk
    along, load = site.along(j), site.tip_moment(j)
    part = np.einsum("na,na->n", load, along) / np.einsum("na,na->n", along, along)
    phi = e.size["k"] * (load - (1 - e.shape.get("torsion", 0.0)) * part[:, None] * along)
    end = np.einsum("nba,nb->na", w.R_link[:, j], site.end(j) - w.o_link[:, j])
    # about the end of the link, and not about the origin of the frame
    about = end - np.einsum("nab,nb->na", exponential(phi), end)
    out.twists[j] = (phi, about + np.cross(phi, along) / 2)


@form("base_compliance")
def _base(site: Site, e: Effect, out: Perturbation) -> None:
    out.turn = out.turn + e.size["k"] * site.base_moment


@form("payload_error")
def _payload(site: Site, e: Effect, out: Perturbation) -> None:
    for j in range(site.arm.n):
        if not site.arm.prismatic[j]:
            out.joint(j, e.size["e"] * site.payload_tau[:, j])


@form("thermal_growth")
def _growth(site: Site, e: Effect, out: Perturbation) -> None:
    values = {f.name: f.value for f in site.arm.factors}
    for name in site.arm.lengths if e.target == "all" else (e.target,):
        out.lengths[name] = out.lengths.get(name, 0.0) + e.size["alpha"] * values[name] * site.warmth


@form("drift")
def _drift(site: Site, e: Effect, out: Perturbation) -> None:
    t, v = site.session.time, np.array([e.size["x"], e.size["y"], e.size["z"]])
    grown = -np.expm1(-t / e.shape["tau"]) if e.target == "exponential" else t / e.shape["span"]
    out.shift = out.shift + grown[:, None] * v


@form("slip")
def _slip(site: Site, e: Effect, out: Perturbation) -> None:
    after = (site.session.time >= e.shape["t0"]).astype(float)
    v = e.size
    if e.target == "tool":  # a shift in the axes of the tool, which these arms do not turn in the flange
        shift = site.walk.R_link[:, -1] @ np.array([v["x"], v["y"], v["z"]])
        out.shift = out.shift + after[:, None] * shift
        return
    if e.target != "base":
        out.joint(site.joint(e.target), e.size["step"] * after)
        return
    out.shift = out.shift + after[:, None] * np.array([v["x"], v["y"], v["z"]])
    out.turn = out.turn + after[:, None] * np.array([v.get(name, 0.0) for name in ("roll", "pitch", "yaw")])


def speeds(session: Session) -> Array:
    """(N, n) of the joints, by central differences [rad/s or m/s]."""
    return np.gradient(session.q, session.time, axis=0)


@form("late_reading")
def _late(site: Site, e: Effect, out: Perturbation) -> None:
    for j, speed in enumerate(speeds(site.session).T):
        out.joint(j, -e.size["t"] * speed)


@form("tool_shift")
def _tool_shift(site: Site, e: Effect, out: Perturbation) -> None:
    shift = site.walk.R_link[:, -1] @ np.array([e.size["x"], e.size["y"], e.size["z"]])
    out.shift = out.shift + (site.session.payload > 0)[:, None] * shift


@form("instrument_scale")
def _scale(site: Site, e: Effect, out: Perturbation) -> None:
    out.shift = out.shift + e.size["c"] * site.walk.p


@form("instrument_field")
def _field(site: Site, e: Effect, out: Perturbation) -> None:
    u = site.walk.p - site.walk.o_base
    products = np.stack([u[:, i] * u[:, k] for i in range(3) for k in range(i, 3)], axis=1)
    weights = np.array([[e.size[f"{axis}{m}"] for axis in "xyz"] for m in range(6)])
    out.shift = out.shift + products @ weights


def measured(site: Site, effects: tuple[Effect, ...]) -> Array:
    """(N, 3) the tool point of the arm with its effects, without noise."""
    out = Perturbation()
    for e in effects:
        FORMS[e.kind](site, e, out)
    q = site.session.q.copy()
    for j, dq in out.dq.items():
        q[:, j] += dq
    deviations: dict[str, object] = dict(site.deviations)
    for name, growth in out.lengths.items():
        deviations[name] = site.deviations.get(name, 0.0) + growth
    w = walk(site.arm, q, deviations, out.twists)
    turned = w.p + np.cross(np.broadcast_to(out.turn, w.p.shape), w.p - w.o_base)
    return turned + out.shift
