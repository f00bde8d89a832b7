"""``draw``: everything about one hidden case from a seed: what is handed over, and the truth that is kept back."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tests.hidden.arms import ARMS
from tests.hidden.designs import Session, draw_centre, draw_session
from tests.hidden.effects import Effect, Site, measured
from tests.hidden.families import FAMILIES, Setting
from tests.hidden.mechanics import Arm, Array
from tests.hidden.noise import SIGMA, Noise, draw_noise
from tests.hidden.outside import OUTSIDE
from tests.hidden.rivals import rivals_of
from tests.hidden.sizes import draw_effect
from tests.hidden.special import draw_batch, draw_single, loosened
from tests.hidden.strength import (
    DETECTABLE,
    basis,
    components,
    names_of,
    off,
    reference_rms,
    signature,
    strain,
    tangent,
)

NATURAL, TRIES = 40, 200


@dataclass(frozen=True, eq=False)
class Draw:
    """One case: ``nominal`` is the arm of the file, with the frames as they are thought to stand."""

    nominal: Arm
    free: bool
    word: bool  # base and tool as the bare word ``free``, without a start
    session: Session
    points: Array  # (N, 3) measured
    robots: Array | None
    priors: dict[str, float]
    test: tuple[Session, Array] | None
    truth: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Wanted:
    """Between which λ an effect is to be, and whether its size may be scaled to get there."""

    weakest: float
    strongest: float
    scaled: bool


class OutOfReach(Exception):  # noqa: N818
    """The wanted strength cannot be had in this draw."""


def draw(
    seed: int,
    family: str = "full",
    index: int = 0,
    *,
    kind: str = "",
    weakest: float = DETECTABLE,
    strongest: float = np.inf,
    test: bool = False,
) -> Draw:
    """Case ``index`` of a family, λ of each effect between ``weakest`` and ``strongest``.

    Sizes are the catalogue's, drawn until they are of that strength; where that does not happen, they are scaled.
    """
    key = [seed, zlib.crc32(family.encode()), index]
    setting = FAMILIES[family](np.random.default_rng(key), kind)
    for attempt in range(TRIES):
        rng = np.random.default_rng([*key, attempt])
        try:
            case = _attempt(rng, setting, Wanted(weakest, strongest, attempt >= NATURAL), test)
        except OutOfReach:
            continue
        case.truth.update(family=family, seed=seed, index=index, attempt=attempt)
        return case
    raise OutOfReach(f"{family} {setting.kinds} of λ {weakest:g} … {strongest:g}")


def _attempt(rng: np.random.Generator, setting: Setting, wanted: Wanted, test: bool) -> Draw:
    free = bool(rng.random() < 0.6) if setting.free is None else setting.free
    nominal = place(rng, ARMS[setting.arm]())
    masses = nominal.masses * (1 + setting.masses * rng.choice([-1.0, 1.0], nominal.n))
    true = replace(nominal, masses=masses)
    centre = draw_centre(rng, true) if setting.plan.span else None
    session = draw_session(rng, true, setting.plan, centre)
    if setting.robots:
        return draw_batch(rng, true, setting, session)
    deviations, entries = geometry(rng, true, setting), []
    site = Site(true, session, deviations)
    if setting.single:
        deviations, entry = draw_single(rng, site, setting.single, free)
        if entry is None:
            raise OutOfReach
        entries, site = [entry], Site(true, session, deviations)
    effects = _effects(rng, site, setting, free, wanted)
    beside: tuple[Effect, ...] = ()
    if setting.loose:
        session, effects, beside = loosened(session, effects)
        site = Site(true, session, deviations)
    noise = Noise(freedom=setting.freedom)
    if setting.noise:
        noise, entry = draw_noise(rng, site, setting.noise)
        entry["lambda"] = noise.strength(site)
        if not wanted.weakest <= entry["lambda"] <= wanted.strongest:
            raise OutOfReach
        entries.append(entry)
    added, gross = noise.draw(rng, site)
    points = measured(site, effects + beside) + added
    truth = _truth(site, nominal, effects, entries, free, added)
    if any(e["kind"] in OUTSIDE and any(r["lost"] < DETECTABLE for r in e["rivals"]) for e in truth["effects"]):
        raise OutOfReach  # a name of the catalogue explains it well enough
    truth |= {
        "gross_rows": gross.tolist(),
        "noise": noise.__dict__,
        "deviations": deviations,
        "beside": [e.__dict__ for e in beside],
    }
    other = _test_session(rng, setting, site, effects + beside, noise, centre) if test else None
    logged = replace(session, temperature=_thermometer(session, setting))
    word = bool(rng.random() < 0.2)
    return Draw(stated(rng, nominal, free), free, word and free, logged, points, None, {}, other, truth)


def place(rng: np.random.Generator, arm: Arm) -> Arm:
    """The arm on its foot before the instrument, with a tool."""
    planar = len(arm.measured) == 2
    yaw, tilt = rng.uniform(-np.pi, np.pi), rng.normal(0, 0.01, 2)
    base = np.array([*rng.uniform(-2, 2, 2), 0.0, rng.normal(0, 0.2) if planar else yaw, *tilt])  # x, y, z, yaw, …
    base[4:] = 0.0 if planar else tilt
    base[2] = 0.0 if planar else rng.uniform(-1.0, 0.0)
    tool = np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.1, 0.2), 0.0, 0.0, 0.0])
    return arm.with_frames(np.round(base, 6), np.zeros(6) if planar else np.round(tool, 6))


def stated(rng: np.random.Generator, arm: Arm, free: bool) -> Arm:
    """Free frames start roughly where they are: 20 mm and 2° of yaw, upright to 0.3°, the tool to 2 mm."""
    if not free:
        return arm
    error = rng.normal(size=6) * np.array([0.02, 0.02, 0.02, 0.03, 0.005, 0.005])
    base = np.array([f.value for f in arm.base])
    tool = np.array([f.value for f in arm.tool])
    if len(arm.measured) == 2:
        error[[2, 4, 5]] = 0.0
        return arm.with_frames(base + error, tool)
    return arm.with_frames(base + error, tool + rng.normal(size=6) * np.array([0.002] * 3 + [0.0] * 3))


def geometry(rng: np.random.Generator, arm: Arm, setting: Setting) -> dict[str, Array | float]:
    """Small errors of all parameters of the links; in the plane of a planar arm only."""
    last = (
        ("theta", "a")
        if len(arm.measured) == 2
        else ("theta", "d", "a", "alpha", "x", "y", "z", "roll", "pitch", "yaw")
    )
    found = {}
    for link in arm.links:
        for f in link:
            prefix, _, name = f.name.rpartition(".")
            tilts = name == "beta" and arm.joints.index(prefix) in arm.parallel and len(arm.measured) == 3
            if name in last or tilts:
                found[f.name] = float(rng.normal(0, 1) * setting.geometry)
    return {name: value for name, value in found.items() if value}


def _effects(rng: np.random.Generator, site: Site, setting: Setting, free: bool, wanted: Wanted) -> tuple[Effect, ...]:
    """The effects of the setting, each of the wanted strength beside the geometry and the others."""
    low, high = wanted.weakest, wanted.strongest
    if setting.kinds == ("instrument_scale",):
        return (draw_effect(rng, site, "instrument_scale"),)
    U = basis(tangent(site, names_of(site, free), SIGMA))
    found: list[Effect] = []
    for kind in setting.kinds:
        e = draw_effect(rng, site, kind)
        size = _strength(site, e, found, U) / strain(e)
        if wanted.scaled and not low <= size <= high:
            goal = float(np.exp(rng.uniform(np.log(low), np.log(min(4 * low, high)))))
            e = e.scaled(float(np.clip(np.sqrt(goal / max(size, 1e-12)), *e.limits)))
        found.append(e)
    for e in found:
        size = _strength(site, e, [x for x in found if x is not e], U) / strain(e)
        if not low * 0.999 <= size <= high * 1.001:
            raise OutOfReach
    return tuple(found)


def _strength(site: Site, e: Effect, others: list[Effect], U: Array) -> float:
    if others:
        U = basis(np.concatenate([U, *(components(site, o, SIGMA) for o in others)], axis=1))
    z = off(U, signature(site, (e,), SIGMA))
    return float(z @ z)


def _truth(
    site: Site, nominal: Arm, effects: tuple[Effect, ...], entries: list[dict], free: bool, added: Array
) -> dict[str, Any]:
    J = tangent(site, names_of(site, free), SIGMA)
    U, k = basis(J), list(site.arm.measured)
    listed = list(entries)
    for e in effects:
        others = [x for x in effects if x is not e]
        rivals = rivals_of(site, e, U, SIGMA)
        size = {name: _strength(site, e, x, U) for name, x in (("lambda", others), ("lambda_alone", []))}
        size |= {"needed": DETECTABLE * strain(e), "rivals": rivals}
        listed.append({"kind": e.kind, "target": e.target, "size": e.size, "shape": e.shape, **size})
    model = np.concatenate([J, *(components(site, e, SIGMA) for e in effects)], axis=1)
    return {
        "arm": nominal.name, "rows": len(site.session), "free": free, "sides_stated": site.session.sides_stated,
        "sigma": SIGMA, "effects": listed, "rms": reference_rms(site, added[:, k], model),
        "noise_rms": float(np.sqrt((added[:, k] ** 2).sum(axis=1).mean())),
    }  # fmt: skip


def _thermometer(session: Session, setting: Setting) -> Array:
    """A loose thermometer lags behind the arm by some three rows."""
    if not setting.loose:
        return session.temperature
    lagged = np.convolve(np.pad(session.temperature, (3, 3), mode="edge"), np.ones(4) / 4, mode="valid")
    return np.round(lagged[: len(session)], 2)


def _test_session(
    rng: np.random.Generator,
    setting: Setting,
    site: Site,
    effects: tuple[Effect, ...],
    noise: Noise,
    centre: Array | None,
) -> tuple[Session, Array]:
    """Another day: other postures, another room; a drift starts anew, what has slipped stays."""
    plan = replace(
        setting.plan, rows=40, repeated=2, visits=2, logged=site.session.logged, sides=site.session.sides_stated
    )
    session = draw_session(rng, site.arm, plan, centre)
    after = tuple(replace(e, shape={**e.shape, "t0": -1.0}) if e.kind == "slip" else e for e in effects)
    there = Site(site.arm, session, site.deviations)
    return session, measured(there, after) + replace(noise, gross=0).draw(rng, there)[0]
