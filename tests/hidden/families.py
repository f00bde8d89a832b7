"""Families of draws: which arm, which session, and what is hidden."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from tests.hidden.designs import Plan
from tests.hidden.noise import NOISES
from tests.hidden.outside import OUTSIDE, TANGLED
from tests.hidden.sizes import KINDS

GEOMETRY = ("joint_offset", "link_length", "link_offset", "link_twist", "axis_tilt")
TIMED = ("thermal_growth", "thermal_offset", "drift", "slip")
SIDED = ("hysteresis",)  # its travel follows from the rows alone


@dataclass(frozen=True)
class Setting:
    """What is drawn: kinds of effects on the mean, a kind of noise, errors of the geometry (σ in m and rad)."""

    arm: str = "ur10"
    plan: Plan = field(default_factory=Plan)
    kinds: tuple[str, ...] = ()
    noise: str = ""
    geometry: float = 0.4e-3
    single: str = ""  # one geometric error in an otherwise true arm
    free: bool | None = None  # base and tool to be found; drawn where None
    masses: float = 0.0  # relative error of every mass
    freedom: float = 0.0
    loose: bool = False  # the effect is not exactly of the model's form
    robots: int = 0
    alike: bool = True  # whether both links of an arm of a batch are long or short together, and a joint is noisy


Family = Callable[[np.random.Generator, str], Setting]
FULL, UNLOADED = Plan(), Plan(payloads=(0.0,))
ON_SCARA = ("joint_scale", "gear_eccentricity", "gear_second_harmonic", "cyclic_error", "backlash", "hysteresis")
ON_SCARA += ("joint_coupling", "thermal_growth", "thermal_offset", "drift", "slip")
ON_PLANAR = (*ON_SCARA, "joint_compliance", "load_backlash", "link_bending")
LOOSE = ("backlash", "thermal_growth", "drift", "link_bending", "joint_compliance", "gear_eccentricity")


def fit(plan: Plan, kinds: tuple[str, ...]) -> Plan:
    """The session that lets these kinds be seen."""
    if any(kind in TIMED for kind in kinds):
        plan = replace(plan, logged=True)
    if any(kind in SIDED for kind in kinds):
        plan = replace(plan, sides=False)
    if "payload_error" in kinds:
        plan = replace(plan, payloads=(0.0, 5.0, 10.0))
    return plan


def one(arm: str, plan: Plan = FULL, kinds: tuple[str, ...] = KINDS, **more: object) -> Family:
    def draw(rng: np.random.Generator, kind: str) -> Setting:
        chosen = (kind or str(rng.choice(kinds)),)
        return replace(Setting(arm, fit(plan, chosen), chosen), **more)  # type: ignore[arg-type]

    return draw


def two(rng: np.random.Generator, kind: str) -> Setting:
    first = kind or str(rng.choice(KINDS))
    kinds = (first, str(rng.choice([k for k in KINDS if k != first])))
    return Setting(kinds=kinds, plan=fit(FULL, kinds))


def beyond(rng: np.random.Generator, kind: str) -> Setting:
    return Setting(str(rng.choice(["ur10", "kr16"])), kinds=(kind or str(rng.choice(OUTSIDE)),))


def clean(rng: np.random.Generator, kind: str) -> Setting:
    return Setting(str(rng.choice(["ur10", "ur10", "kr16", "scara", "seven"])))


def single(rng: np.random.Generator, kind: str) -> Setting:
    chosen = kind or str(rng.choice(GEOMETRY))
    arms = ["ur10", "kr16", "scara"] + ["planar"] * (chosen in ("joint_offset", "link_length"))
    return Setting(str(rng.choice(arms)), geometry=0.0, single=chosen)


def heavy(rng: np.random.Generator, kind: str) -> Setting:
    kinds = ((kind or str(rng.choice(KINDS))),) if rng.random() < 0.5 or kind else ()
    return Setting(kinds=kinds, plan=fit(FULL, kinds), freedom=4.0)


def noisy(kind: str, plan: Plan = FULL) -> Family:
    return lambda rng, _: Setting(str(rng.choice(["ur10", "kr16"])), plan, noise=kind)


def shaped(plan: Plan) -> Family:
    """Structure without a name: what could pass for scatter where no posture is repeated."""
    return lambda rng, kind: Setting(
        str(rng.choice(["ur10", "kr16"])), plan, (kind or str(rng.choice([TANGLED, TANGLED, *OUTSIDE])),)
    )


NARROW = Plan(span=1.0)
ONCE, OFTEN = Plan(repeated=0, visits=1), Plan(repeated=30, visits=4)
BATCH = Plan(rows=10, repeated=3, visits=2, payloads=(0.0,), sides=False, logged=False)
GRAVITY = ("joint_compliance", "link_bending", "base_compliance", "load_backlash")
UNEXPLAINED = ("outside", "noise_once", "shape_once", "shape_often")
"""Families whose data show that something is there, and cannot show its name."""
FAMILIES: dict[str, Family] = {
    "full": one("ur10"),
    "full_100": one("ur10", replace(FULL, rows=100)),
    "kr16": one("kr16"),
    "narrow": one("ur10", NARROW),
    "narrow_unloaded": one("ur10", replace(NARROW, payloads=(0.0,)), tuple(k for k in KINDS if k != "payload_error")),
    "few_poses": one("ur10", replace(FULL, rows=60, repeated=6, visits=2)),
    "planar": one("planar", UNLOADED, ON_PLANAR),
    "scara": one("scara", UNLOADED, ON_SCARA),
    "seven": one("seven", kinds=tuple(k for k in KINDS if k != "gear_ripple")),  # a URDF has no gear ratio
    "wrong_masses": one("ur10", FULL, GRAVITY, masses=0.25),
    "loose": one("ur10", FULL, LOOSE, loose=True),
    "heavy_tails": heavy,
    "two": two,
    "outside": beyond,
    "clean": clean,
    "exact": lambda rng, _: Setting(str(rng.choice(["ur10", "planar"])), geometry=0.0),
    "geometry": single,
    **{kind: noisy(kind, OFTEN if kind == "joint_noise" else FULL) for kind in NOISES},
    "noise_once": noisy("joint_noise", ONCE),
    "shape_once": shaped(ONCE),
    "shape_often": shaped(OFTEN),
    "unknowable": lambda rng, _: Setting(kinds=("instrument_scale",), free=True),
    "batch": lambda rng, _: Setting("planar", BATCH, robots=int(rng.integers(25, 41)), geometry=0.4e-3, free=False),
    "batch_clean": lambda rng, _: Setting(
        "planar", BATCH, robots=int(rng.integers(25, 41)), geometry=0.4e-3, free=False, alike=False
    ),
    "one_robot": lambda rng, _: Setting("planar", UNLOADED, robots=1, geometry=0.4e-3, free=False),
}
