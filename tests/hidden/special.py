"""One geometric error by itself, a batch of arms, effects that are not quite of the model's form."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tests.hidden.designs import Session, draw_session
from tests.hidden.effects import Effect, Site
from tests.hidden.mechanics import Arm, Array, walk
from tests.hidden.noise import SIGMA, Noise
from tests.hidden.strength import basis, names_of, off, tangent

if TYPE_CHECKING:
    from tests.hidden.draw import Draw
    from tests.hidden.families import Setting

LAST = {"joint_offset": "theta", "link_length": "a", "link_offset": "d", "link_twist": "alpha", "axis_tilt": "beta"}
TYPICAL = {"theta": (1e-3, 1e-2), "a": (0.5e-3, 3e-3), "d": (0.5e-3, 3e-3), "alpha": (1e-3, 5e-3), "beta": (1e-3, 5e-3)}
ALIKE = 0.9999
LEAST = 100.0  # λ: many parameters compete


def draw_single(
    rng: np.random.Generator, site: Site, kind: str, free: bool
) -> tuple[dict[str, Array | float], dict[str, Any] | None]:
    """A deviation of one parameter that the frames do not absorb, and its entry with those that act alike."""
    arm, last = site.arm, LAST[kind]
    names = names_of(site, False)
    frames = [n for n in names_of(site, True) if n.startswith(("base.", "tool."))] if free else []
    U = basis(tangent(site, frames, SIGMA))
    Z = off(U, tangent(site, names, SIGMA))
    norm = np.linalg.norm(Z, axis=0)
    pool = [i for i, n in enumerate(names) if n.endswith(f".{last}") and not _slides(arm, n)]
    i = int(rng.choice(pool)) if pool else -1
    if i < 0:
        return {}, None
    low, high = TYPICAL[last]
    value = float(rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(low), np.log(high))))
    size = float((norm[i] * value) ** 2)
    if size < LEAST:
        return {}, None
    cosine = np.abs(Z.T @ Z[:, i]) / np.maximum(norm * norm[i], 1e-30)
    back = {v: k for k, v in LAST.items()}
    rivals = [
        {"kind": back[names[k].rpartition(".")[2]], "target": names[k].rpartition(".")[0], "lost": 0.0}
        for k in np.flatnonzero(cosine > ALIKE)
        if k != i
    ]
    entry = {"kind": kind, "target": names[i].rpartition(".")[0], "size": {last: value}, "shape": {}}
    return {names[i]: value}, {**entry, "lambda": size, "lambda_alone": size, "rivals": rivals}


def _slides(arm: Arm, name: str) -> bool:
    """``d`` of a prismatic joint is its offset, not a length."""
    return any(f.name == name and f.joint >= 0 and f.kind == "T" for link in arm.links for f in link)


def draw_batch(rng: np.random.Generator, arm: Arm, setting: Setting, session: Session) -> Draw:
    """Arms of one type, both links of one arm long or short together, and joint 2 noisier than stated."""
    from tests.hidden.draw import Draw

    robots, spread = setting.robots, setting.geometry
    rho = float(rng.uniform(0.75, 0.95)) if setting.alike else 0.0
    noisy = float(np.exp(rng.uniform(np.log(0.1e-3), np.log(0.3e-3)))) if robots > 1 and setting.alike else 0.0
    lengths = rng.multivariate_normal([0, 0], spread**2 * np.array([[1, rho], [rho, 1]]), robots)
    sessions = [session] + [draw_session(rng, arm, setting.plan) for _ in range(robots - 1)]
    points = []
    for part, (first, second) in zip(sessions, lengths, strict=True):
        deviations = {"joint1.a": float(first), "joint2.a": float(second)}
        noise = Noise(joint=1, joint_sigma=noisy)
        points.append(walk(arm, part.q, deviations).p + noise.draw(rng, Site(arm, part, deviations))[0])
    whole = replace(session, **{k: np.concatenate([getattr(s, k) for s in sessions]) for k in _ROWS})
    count = len(session)
    whole = replace(whole, pose=whole.pose + 1000 * np.repeat(np.arange(robots), count))
    entries = [{"kind": "correlated_lengths", "target": "joint1.a, joint2.a", "size": {"rho": rho}, "shape": {}}]
    entries[0]["lambda"] = -robots * float(np.log(1 - rho**2))
    noise_entry = {"kind": "joint_noise", "target": "joint2", "size": {"sigma": noisy}, "shape": {}}
    noise_entry["lambda"] = robots * Noise(joint=1, joint_sigma=noisy).strength(Site(arm, session, {}))
    truth = {
        "arm": arm.name, "rows": len(whole), "free": False, "sides_stated": False, "sigma": SIGMA, "rms": 0.0,
        "effects": [*entries, noise_entry] if robots > 1 and setting.alike else [],
        "noise_rms": SIGMA, "gross_rows": [], "unknowable": [] if robots > 1 else entries,
    }  # fmt: skip
    labels = np.repeat([f"arm{i + 1:02d}" for i in range(robots)], count) if robots > 1 else None
    priors = {"joint1.a": spread, "joint2.a": spread}
    return Draw(arm, False, False, whole, np.concatenate(points), labels, priors, None, truth)


_ROWS = ("q", "pose", "side", "travel", "payload", "temperature", "time")


def loosened(session: Session, effects: tuple[Effect, ...]) -> tuple[Session, tuple[Effect, ...], tuple[Effect, ...]]:
    """Backlash whose sides are soft, torsion beside bending, a wave with an overtone, a drift that does not end.

    The session, the effects, and what comes beside them.
    """
    found, beside = [], []
    for e in effects:
        if e.kind == "link_bending":
            e = replace(e, shape={**e.shape, "torsion": 0.8})
        if e.kind == "gear_eccentricity":
            beside.append(Effect("cyclic_error", e.target, {k: 0.15 * v for k, v in e.size.items()}, {"k": 2.0}))
        if e.kind == "drift" and e.target == "exponential":
            slow = {k: 0.15 * v for k, v in e.size.items()}
            beside.append(Effect("drift", "linear", slow, {"span": float(session.time[-1])}))
        found.append(e)
    if any(e.kind == "backlash" for e in effects):
        soft = np.tanh(session.travel / 0.3)
        session = replace(session, side=session.side * np.where(soft > 0, soft, 1.0))
    return session, tuple(found), tuple(beside)
