"""Circumstances of the shop floor: each a measured UR10 with its table, its problem file and the truth. NumPy only.

The arms, their statics and the textbook effects are those of ``tests.hidden``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tests.hidden.arms import ARMS
from tests.hidden.designs import Session, above_floor, draw_postures
from tests.hidden.draw import geometry
from tests.hidden.effects import Effect, Site, measured
from tests.hidden.families import Setting
from tests.hidden.mechanics import Arm, Array, exponential, walk

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
SIGMA, TOOL = 0.05e-3, np.array([0.06, 0.02, 0.16])  # m
SOFT = (Effect("joint_compliance", "joint2", {"c": 5e-6}), Effect("joint_compliance", "joint3", {"c": 8e-6}))
REPEAT = 1e-5  # rad: σ of every joint from stay to stay, some 0.02 mm at the tool


@dataclass
class Case:
    """Truth, tables (column -> values, SI) and problem file of one draw.

    ``causes`` are pairs of kind and target that may be named, ``sizes`` the value of one of them by its parameter.
    """

    document: dict[str, Any]
    table: dict[str, Any]
    fresh: dict[str, Any] | None = None
    causes: tuple[tuple[str, str], ...] = ()
    sizes: dict[tuple[str, str], float] = field(default_factory=dict)
    unexplained: bool = False  # the right verdict, where none of the causes is named


@dataclass
class Shop:
    """An arm in a session: ``q`` (N, n) in the order of the rows, ``stay`` (N,) rows of one number are one arrival."""

    rng: np.random.Generator
    arm: Arm
    session: Session
    stay: Array
    deviations: dict[str, Any]

    @classmethod
    def drawn(
        cls,
        rng: np.random.Generator,
        poses: int = 100,
        repeats: str = "visits",
        payloads: tuple[float, ...] = (0.0, 8.0),
    ) -> Shop:
        """Random poses, six of them again: after other poses (``visits``), at once (``readings``), or never."""
        arm = ARMS["ur10"]().with_frames(_frame(rng), np.array([*TOOL, 0.0, 0.0, 0.0]))
        pose = rng.permutation(poses)
        if repeats == "visits":
            pose = _never_twice(rng, np.concatenate([pose, np.repeat(np.arange(7), 3)]))
        elif repeats == "readings":
            pose = np.repeat(pose, np.where(pose < 7, 4, 1))
        q = draw_postures(rng, arm, poses, 0.0)
        load = rng.choice(payloads, poses)
        return cls._of(rng, arm, q[pose], pose, load[pose], 45.0)

    @classmethod
    def along_a_path(cls, rng: np.random.Generator, rows: int = 200) -> Shop:
        """Rows of one smooth motion through all the joints' ranges, 20 a second."""
        arm = ARMS["ur10"]().with_frames(_frame(rng), np.array([*TOOL, 0.0, 0.0, 0.0]))
        while True:
            t = np.linspace(0, rows / 20, rows)
            w = 2 * np.pi * rng.uniform(0.1, 0.5, (arm.n, 2))
            q = sum(a * np.sin(t[:, None] * w[:, k] + rng.uniform(0, 6.3, arm.n)) for k, a in enumerate((0.9, 0.4)))
            q = q + rng.uniform(-1.5, 1.5, arm.n) * [1, 0, 1, 1, 1, 1] + [0, -1.4, 0, 0, 0, 0]
            if above_floor(arm, q).all():
                return cls._of(rng, arm, q, np.arange(rows), np.zeros(rows), 1 / 20)

    @classmethod
    def _of(cls, rng: np.random.Generator, arm: Arm, q: Array, pose: Array, load: Array, pause: float) -> Shop:
        step = np.diff(q, axis=0, prepend=q[:1])
        stay = np.cumsum(np.any(step != 0, axis=1))
        side = rng.choice([-1.0, 1.0], (len(q), arm.n))[stay]
        time = pause * np.arange(len(q))
        warm = 22.0 + 4 * np.sin(2 * np.pi * time / max(time[-1], 1) * 2 + rng.uniform(0, 6))
        session = Session(q, pose, side, np.abs(step), load, warm, time, True, True, True)
        return cls(rng, arm, session, stay, geometry(rng, arm, Setting("ur10")))

    def points(self, *effects: Effect, sigma: float = SIGMA, repeat: float = REPEAT, arm: Arm | None = None) -> Array:
        """(N, 3) measured points: every stay draws the joints' scatter anew, every row the instrument's."""
        off = self.rng.normal(0, repeat, (int(self.stay.max()) + 1, self.arm.n))[self.stay]
        site = Site(arm or self.arm, replace(self.session, q=self.session.q + off), self.deviations)
        clean = measured(site, effects)
        return clean + self.rng.normal(0, sigma, clean.shape)

    def table(self, points: Array, *left_out: str, pose: bool = True) -> dict[str, Any]:
        """The columns that an engineer hands over."""
        s = self.session
        table: dict[str, Any] = {f"{name} [rad]": s.q[:, j] for j, name in enumerate(JOINTS)}
        table |= {f"{axis} [m]": points[:, k] for k, axis in enumerate("xyz")}
        table |= {"pose": s.pose} if pose else {}
        table |= {f"{name}.approach": s.side[:, j] for j, name in enumerate(JOINTS)}
        table |= {"payload [kg]": s.payload, "temperature [degC]": s.temperature, "time [s]": s.time}
        return {name: column for name, column in table.items() if not any(part in name for part in left_out)}

    @property
    def lever(self) -> Array:
        return walk(self.arm, self.session.q, self.deviations).p


def _frame(rng: np.random.Generator) -> Array:
    return np.array([*rng.uniform(-0.5, 0.5, 3), rng.uniform(-np.pi, np.pi), *rng.normal(0, 0.005, 2)])


def _never_twice(rng: np.random.Generator, pose: Array) -> Array:
    while True:
        pose = rng.permutation(pose)
        if (np.diff(pose) != 0).all():
            return pose


def document(sigma: float = SIGMA, kind: str = "preset", **more: Any) -> dict[str, Any]:
    """The problem file of an engineer who knows the preset, the tool's drawing and the tracker's data sheet."""
    tool = {"xyz": [f"{v} m" for v in TOOL], "rpy": ["0 deg"] * 3, "free": True}
    robot = {"kind": "preset", "name": "ur10", "base": "free", "tool": tool, **more}
    return {"name": "floor", "robot": robot, "uncertainty": {"measurement": {"position": f"{sigma * 1e3:.6g} mm"}}}


SOFT_CAUSES = (("joint_compliance", "shoulder_lift"), ("joint_compliance", "elbow"))
SOFT_SIZES = dict(zip(SOFT_CAUSES, (5e-6, 8e-6), strict=True))


def _clean(repeats: str) -> Callable[[np.random.Generator], Case]:
    def drawn(rng: np.random.Generator) -> Case:
        shop = Shop.drawn(rng, repeats=repeats)
        return Case(document(), shop.table(shop.points()))

    return drawn


def soft(rng: np.random.Generator) -> Case:
    """Two compliant joints, upright, everything stated: the yardstick."""
    shop = Shop.drawn(rng)
    return Case(document(), shop.table(shop.points(*SOFT)), causes=SOFT_CAUSES, sizes=SOFT_SIZES)


def tilting_base(rng: np.random.Generator) -> Case:
    """The base turns steadily by 0.3 to 0.6 mrad in the session about a level axis."""
    shop = Shop.drawn(rng)
    axis = rng.uniform(0, 2 * np.pi)
    rate = rng.uniform(0.3e-3, 0.6e-3) * np.array([np.cos(axis), np.sin(axis), 0.0])
    points = shop.points()
    grown = shop.session.time / shop.session.time[-1]
    origin = np.array([f.value for f in shop.arm.base[:3]])
    points = points + grown[:, None] * np.cross(rate, points - origin)
    cause = ("drift", "base")
    return Case(document(), shop.table(points), causes=(cause,), sizes={cause: float(np.linalg.norm(rate))})


def two_arms(rng: np.random.Generator) -> Case:
    """The files of two arms in one."""
    repeats = rng.choice(["readings", "visits"])
    one, other = (Shop.drawn(rng, 60, repeats, (0.0,)) for _ in range(2))
    other.arm = one.arm
    tables = [shop.table(shop.points()) for shop in (one, other)]
    tables[1]["pose"] = tables[1]["pose"] + 1000
    tables[1]["time [s]"] = tables[1]["time [s]"] + tables[0]["time [s]"][-1] + 600
    return Case(document(), {k: np.concatenate([t[k] for t in tables]) for k in tables[0]}, unexplained=True)


def scatter_between_stays(rng: np.random.Generator) -> Case:
    """The joints scatter by 60 to 100 µrad from stay to stay, and every stay is read four times."""
    shop = Shop.drawn(rng, 50, "never", (0.0,))
    shop = Shop._of(rng, shop.arm, shop.session.q.repeat(4, axis=0), shop.session.pose.repeat(4), np.zeros(200), 45.0)
    points = shop.points(sigma=0.01e-3, repeat=rng.uniform(6e-5, 1e-4))
    return Case(document(0.01e-3), shop.table(points), unexplained=True)


def scattering_joint(rng: np.random.Generator) -> Case:
    """One joint scatters from visit to visit; what is alike at every visit, and no effect, hides it in all rows."""
    shop = Shop.drawn(rng, 70, "never", (0.0,))
    pose = _never_twice(rng, np.concatenate([np.arange(70), np.repeat(np.arange(10), 4)]))
    shop = Shop._of(rng, shop.arm, shop.session.q[pose], pose, np.zeros(len(pose)), 45.0)
    j, sigma = int(rng.integers(0, 3)), rng.uniform(4e-5, 1.2e-4)
    q, poses = shop.session.q, rng.normal(0, rng.uniform(0.1e-3, 0.3e-3), (70, 3))
    off = np.zeros_like(q)
    off[:, j] = rng.normal(0, sigma, len(q))
    moved = walk(shop.arm, q + off, shop.deviations).p
    points = moved + poses[pose] + rng.normal(0, 0.012e-3, moved.shape)
    cause = ("joint_noise", JOINTS[j])
    return Case(document(0.012e-3), shop.table(points), causes=(cause,), sizes={cause: sigma})


def other_sigma(rng: np.random.Generator) -> Case:
    """The instrument scatters by another factor than stated, and visits show it."""
    factor = float(rng.choice([rng.uniform(0.4, 0.6), rng.uniform(2.0, 5.0)]))
    shop = Shop.drawn(rng, 80, "visits", (0.0,))
    points = shop.points(sigma=factor * 0.03e-3, repeat=0.0)
    cause = ("stated_sigma", "data")
    return Case(document(0.03e-3), shop.table(points), causes=(cause,), sizes={cause: factor})


def other_nest(rng: np.random.Generator) -> Case:
    """The loaded rows were measured on another nest of the tool, in blocks."""
    shop = Shop.drawn(rng, 100, str(rng.choice(["readings", "visits"])))
    blocks = (shop.session.time / shop.session.time[-1] * 6).astype(int).clip(max=5) % 2
    shop.session = replace(shop.session, payload=8.0 * blocks)
    shift = rng.normal(size=3)
    shift *= rng.uniform(0.25e-3, 0.5e-3) / np.linalg.norm(shift)
    R = walk(shop.arm, shop.session.q, shop.deviations).R_link[:, -1]
    points = shop.points() + blocks[:, None] * (R @ shift)
    return Case(document(), shop.table(points), causes=(("tool_shift", "tool"),), unexplained=True)


def hung(rng: np.random.Generator) -> Case:
    """An arm on a ceiling or a wall, which no file states; one time in two the tracker is not level."""
    shop = Shop.drawn(rng, payloads=(0.0, 5.0))
    turned = np.array([np.pi if rng.random() < 0.5 else np.pi / 2, 0.0])
    base = np.array([f.value for f in shop.arm.base])
    base[3:] = [base[3], *turned[::-1]]  # yaw, pitch, roll
    shop.arm = shop.arm.with_frames(base, np.array([*TOOL, 0.0, 0.0, 0.0]))
    axis = rng.normal(size=(1, 3))
    seen = exponential(rng.choice([0.0, 1.0]) * axis)[0]
    return Case(document(), shop.table(shop.points(*SOFT) @ seen.T), causes=SOFT_CAUSES, sizes=SOFT_SIZES)


def leaning(rng: np.random.Generator) -> Case:
    """An arm on a wedge of 15° to 40°, measured by a levelled tracker."""
    shop = Shop.drawn(rng, payloads=(0.0, 5.0))
    base = np.array([f.value for f in shop.arm.base])
    base[5] = rng.uniform(0.26, 0.7)
    shop.arm = shop.arm.with_frames(base, np.array([*TOOL, 0.0, 0.0, 0.0]))
    return Case(document(), shop.table(shop.points(*SOFT)), causes=SOFT_CAUSES, sizes=SOFT_SIZES)


def askew_tracker(rng: np.random.Generator) -> Case:
    """An upright arm, measured by a tracker that is not levelled."""
    shop = Shop.drawn(rng, payloads=(0.0, 5.0))
    axis = rng.normal(size=(1, 3))
    turn = exponential(axis / np.linalg.norm(axis) * rng.uniform(0.5, 2.5))[0]
    return Case(document(), shop.table(shop.points(*SOFT) @ turn.T), causes=SOFT_CAUSES, sizes=SOFT_SIZES)


def unstated_gripper(rng: np.random.Generator) -> Case:
    """A gripper of 4 to 8 kg that the file does not know; only the shoulder is compliant."""
    shop = Shop.drawn(rng, payloads=(0.0,))
    heavy = replace(shop.arm, masses=shop.arm.masses + np.array([0, 0, 0, 0, 0, rng.uniform(4.0, 8.0)]))
    heavy = replace(heavy, coms=np.vstack([heavy.coms[:5], [0.03, 0.01, 0.1]]))
    points = shop.points(Effect("joint_compliance", "joint2", {"c": 8e-6}), arm=heavy)
    cause = ("joint_compliance", "shoulder_lift")
    return Case(document(), shop.table(points, "payload"), causes=(cause,), sizes={cause: 8e-6})


def fahrenheit(rng: np.random.Generator) -> Case:
    """Growth of all lengths, and a thermometer in °F."""
    shop = Shop.drawn(rng, payloads=(0.0,))
    points = shop.points(Effect("thermal_growth", "all", {"alpha": 12e-6}))
    table = shop.table(points)
    table["temperature [degC]"] = 32 + 1.8 * table["temperature [degC]"]
    return Case(document(), table, causes=(("thermal_growth", "all"),))


def pasted(rng: np.random.Generator) -> Case:
    """All rows three times in the file."""
    shop = Shop.drawn(rng, 70, "never", (0.0,))
    points = shop.points(Effect("gear_eccentricity", "joint2", {"a": 0.12e-3, "b": 0.0}))
    table = shop.table(points, "pose", "time", "payload", "temp")
    causes = (("gear_eccentricity", "shoulder_lift"),)
    return Case(document(), {k: np.tile(v, 3) for k, v in table.items()}, causes=causes)


def turned_sides(rng: np.random.Generator) -> Case:
    """Approach columns with the wrong sign in all rows."""
    shop = Shop.drawn(rng, 120, "never", (0.0,))
    side = np.sign(np.diff(shop.session.q, axis=0, prepend=shop.session.q[:1] - 1.0))
    shop.session = replace(shop.session, side=side)
    points = shop.points(Effect("backlash", "joint2", {"b": 0.3e-3}))
    shop.session = replace(shop.session, side=-side)
    return Case(document(), shop.table(points), causes=(("backlash", "shoulder_lift"),))


def late_tracker(rng: np.random.Generator) -> Case:
    """A moving arm, and a tracker that is late by 0.2 to 0.6 ms; ``fresh`` are static rows of the same arm."""
    return _path(rng, rng.uniform(0.2e-3, 0.6e-3))


def path(rng: np.random.Generator) -> Case:
    """A moving arm with two gear errors, measured in time."""
    eccentric = Effect("gear_eccentricity", "joint2", {"a": 0.15e-3, "b": 0.1e-3})
    return _path(rng, 0.0, (eccentric, Effect("gear_second_harmonic", "joint3", {"a": 0.1e-3, "b": 0.0})))


def _path(rng: np.random.Generator, late: float, effects: tuple[Effect, ...] = ()) -> Case:
    shop = Shop.along_a_path(rng)
    shop.stay = np.arange(len(shop.stay))
    speed = np.gradient(shop.lever, shop.session.time, axis=0)
    points = shop.points(*effects) - late * speed
    lower, upper = shop.session.q.min(axis=0), shop.session.q.max(axis=0)
    q = rng.uniform(lower, upper, (600, 6))
    q = q[above_floor(shop.arm, q)][:120]
    still = Shop._of(rng, shop.arm, q, np.arange(len(q)), np.zeros(len(q)), 45.0)
    still.deviations = shop.deviations
    left = ("approach", "payload", "temp", "pose")
    causes = tuple((e.kind, JOINTS[int(e.target[-1]) - 1]) for e in effects)
    causes += (("late_reading", "instrument"),) if late else ()
    fresh = still.table(still.points(*effects), *left)
    return Case(document(), shop.table(points, *left), fresh, causes, unexplained=bool(late))


CIRCUMSTANCES: dict[str, Callable[[np.random.Generator], Case]] = {
    "clean_visits": _clean("visits"), "clean_readings": _clean("readings"), "clean_single": _clean("never"),
} | {
    one.__name__: one
    for one in (
        soft, tilting_base, two_arms, scatter_between_stays, scattering_joint, other_sigma, other_nest, hung, leaning,
        askew_tracker, unstated_gripper, fahrenheit, pasted, turned_sides, late_tracker, path,
    )
}  # fmt: skip
