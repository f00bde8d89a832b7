"""What the data can hardly tell from the truth: rivals that would lose against it by less than the usual Δ BIC."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tests.hidden.effects import Effect, Site
from tests.hidden.mechanics import Array
from tests.hidden.strength import components, off, signature

MARGIN, LISTED = 6.0, 30.0


def candidates(site: Site) -> Iterator[Effect]:
    """The catalogue at every target, unit sizes small enough to be linear."""
    arm, tiny, span = site.arm, 1e-6, float(site.session.time[-1])
    names = [n for n, slides in zip(arm.joints, arm.prismatic, strict=True) if not slides]
    for name in names:
        for kind in ("joint_scale", "thermal_offset"):
            yield Effect(kind, name, {"c": tiny})
        for kind in ("gear_eccentricity", "gear_second_harmonic"):
            yield Effect(kind, name, {"a": tiny, "b": tiny})
        yield from (Effect("cyclic_error", name, {"a": tiny, "b": tiny}, {"k": k}) for k in (3.0, 4.0, 5.0, 6.0, 8.0))
        if ratio := arm.gear[site.joint(name)]:
            for n in (1.0, 2.0):
                yield Effect("gear_ripple", name, {"a": tiny, "b": tiny}, {"N": float(ratio), "n": n})
        yield Effect("backlash", name, {"b": tiny})
        yield from (Effect("hysteresis", name, {"h": tiny}, {"d0": d}) for d in (0.2, 0.5, 1.2))
        yield from (Effect("joint_coupling", f"{a}->{name}", {"c": tiny}) for a in names if a != name)
        if np.abs(site.tau[:, site.joint(name)]).max() > 1.0:
            yield Effect("joint_compliance", name, {"c": tiny / 100})
            yield Effect("load_backlash", name, {"h": tiny / 100})
    yield from (Effect("link_bending", arm.joints[j], {"k": tiny / 100}) for j in site.can_bend(0.05))
    yield Effect("base_compliance", "base", {"k": tiny / 100})
    if np.ptp(site.session.payload):
        yield Effect("payload_error", "payload", {"e": tiny / 100})
    if site.session.logged:
        yield from (Effect("thermal_growth", name, {"alpha": tiny}) for name in ("all", *arm.lengths))
        v = dict.fromkeys("xyz", tiny)
        yield Effect("drift", "linear", v, {"span": span})
        yield from (Effect("drift", "exponential", v, {"tau": f * span}) for f in (0.05, 0.1, 0.2, 0.4))


def rivals_of(site: Site, truth: Effect, U: Array, sigma: float) -> list[dict]:
    """Kinds and targets that explain all but ``LISTED`` of the truth's λ, the closest first."""
    z = off(U, signature(site, (truth,), sigma))
    if z @ z < 2 * MARGIN:  # anything would do
        return []
    found: dict[tuple[str, str], float] = {}
    for e in candidates(site):
        if e.name == truth.name:
            continue
        Z = off(U, components(site, e, sigma))
        scale = np.linalg.norm(Z, axis=0)
        if not scale.max() > 0:
            continue
        Z = Z[:, scale > 1e-9 * scale.max()]
        lost = float(np.sum((z - Z @ np.linalg.lstsq(Z, z, rcond=1e-9)[0]) ** 2))
        # A rival with more parameters pays for them as the BIC counts.
        lost += (Z.shape[1] - len(truth.size)) * np.log(len(z))
        if lost < LISTED:
            found[e.name] = min(lost, found.get(e.name, np.inf))
    return [
        {"kind": k, "target": t, "lost": round(float(lost), 2)}
        for (k, t), lost in sorted(found.items(), key=lambda i: i[1])
    ]
