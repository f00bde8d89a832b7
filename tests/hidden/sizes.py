"""Sizes and targets of effects at random, within what the catalogue calls typical."""

from __future__ import annotations

import numpy as np

from tests.hidden.effects import Effect, Site
from tests.hidden.mechanics import Array
from tests.hidden.outside import OUTSIDE, TANGLED

mrad, mm = 1e-3, 1e-3
# kind: (least, most) of its largest error, in rad or m, unless said otherwise
TYPICAL = {
    "joint_scale": (1e-4, 5e-4),  # per rad
    "gear_eccentricity": (0.1 * mrad, 0.3 * mrad),
    "gear_second_harmonic": (0.05 * mrad, 0.2 * mrad),
    "gear_ripple": (0.05 * mrad, 0.2 * mrad),
    "cyclic_error": (0.05 * mrad, 0.3 * mrad),
    "joint_compliance": (0.1 * mrad, 2 * mrad),
    "link_bending": (0.05 * mrad, 0.5 * mrad),
    "base_compliance": (0.02 * mrad, 0.2 * mrad),
    "backlash": (0.05 * mrad, 0.5 * mrad),
    "hysteresis": (0.1 * mrad, 0.8 * mrad),
    "load_backlash": (0.05 * mrad, 0.3 * mrad),
    "joint_coupling": (1e-4, 1e-3),  # per rad
    "payload_error": (0.02 * mrad, 0.3 * mrad),
    "thermal_growth": (9e-6, 26e-6),  # per K
    "thermal_offset": (5e-6, 20e-6),  # rad/K
    "drift": (0.05 * mm, 0.2 * mm),
    "slip": (0.05 * mrad, 0.4 * mrad),
    "instrument_scale": (1e-6, 10e-6),
    "instrument_field": (0.01 * mm, 0.1 * mm),
    "quantisation": (1.0, 1.0),
    "late_reading": (1e-4, 1e-3),  # s
    "tool_shift": (0.1 * mm, 0.5 * mm),
    "dent": (0.2 * mrad, 1 * mrad),
    "product": (0.1 * mrad, 0.6 * mrad),
    "wrong_load": (0.1 * mrad, 0.5 * mrad),
    "waving_field": (0.05 * mm, 0.3 * mm),
    "square_wave": (0.1 * mrad, 0.4 * mrad),
    TANGLED: (0.1 * mrad, 0.6 * mrad),
}
KINDS = tuple(
    kind for kind in TYPICAL if kind not in ("instrument_scale", "late_reading", "tool_shift", TANGLED, *OUTSIDE)
)
LOADED = 5.0  # N m: a joint that carries less, such as one about the vertical, is no target
BENDING = 0.18  # m: what is shorter is stiff
WIDER = 1.5  # a size may leave the typical range by this factor to reach a wanted strength


def draw_effect(rng: np.random.Generator, site: Site, kind: str) -> Effect:
    """An effect of a kind at a random target, its largest error log-uniform in the typical range."""
    low, high = TYPICAL[kind]
    amount = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    target, size, shape = _SPECIAL.get(kind, _single)(rng, site, kind)
    limits = (1.0, 1.0) if kind == "quantisation" else (low / WIDER / amount, high * WIDER / amount)
    size = {name: value * amount for name, value in size.items()}
    return Effect(kind, target, size, shape, limits)


def turning(site: Site) -> list[str]:
    return [name for name, slides in zip(site.arm.joints, site.arm.prismatic, strict=True) if not slides]


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _ab(rng: np.random.Generator) -> dict[str, float]:
    phase = rng.uniform(0, 2 * np.pi)
    return {"a": float(np.sin(phase)), "b": float(np.cos(phase))}


def _unit(rng: np.random.Generator, site: Site) -> Array:
    """A direction among the measured axes."""
    v = np.zeros(3)
    v[list(site.arm.measured)] = rng.normal(size=len(site.arm.measured))
    return np.asarray(v / np.linalg.norm(v))


def _single(rng: np.random.Generator, site: Site, kind: str):
    """One joint, one coefficient."""
    name = {"backlash": "b"}.get(kind, "c")
    return str(rng.choice(turning(site))), {name: _sign(rng)}, {}


def _cyclic(rng: np.random.Generator, site: Site, kind: str):
    joint = str(rng.choice(turning(site)))
    if kind == "cyclic_error":
        k = float(np.exp(rng.uniform(np.log(3.0), np.log(300.0))))
        return joint, _ab(rng), {"k": float(np.round(k)) if rng.random() < 0.7 else k}
    if kind == "gear_ripple":
        ratio = float(site.arm.gear[site.joint(joint)])
        return joint, _ab(rng), {"N": ratio, "n": float(rng.integers(1, 3))}
    return joint, _ab(rng), {}


def _per_load(rng: np.random.Generator, site: Site, kind: str):
    """Coefficients per torque, so that the largest torque of the session makes the drawn error."""
    if kind == "base_compliance":
        return "base", {"k": 1 / np.linalg.norm(site.base_moment, axis=1).max()}, {}
    if kind == "payload_error":
        return "payload", {"e": _sign(rng) / max(np.abs(site.payload_tau).max(), 1e-9)}, {}
    if kind == "link_bending":
        j = int(rng.choice(site.can_bend(BENDING)))
        top = np.linalg.norm(site.tip_moment(j), axis=1).max()
        return site.arm.joints[j], {"k": 1 / max(top, 1e-9)}, {}
    loaded = [j for j in range(site.arm.n) if np.abs(site.tau[:, j]).max() > LOADED and not site.arm.prismatic[j]]
    j = int(rng.choice(loaded)) if loaded else 0
    name, sign = ("c", 1.0) if kind == "joint_compliance" else ("h", _sign(rng))
    return site.arm.joints[j], {name: sign / max(np.abs(site.tau[:, j]).max(), 1e-9)}, {}


def _hysteresis(rng: np.random.Generator, site: Site, kind: str):
    return str(rng.choice(turning(site))), {"h": _sign(rng)}, {"d0": float(rng.uniform(0.2, 1.2))}


def _coupling(rng: np.random.Generator, site: Site, kind: str):
    a, b = rng.choice(turning(site), 2, replace=False)
    return f"{a}->{b}", {"c": _sign(rng)}, {}


def _growth(rng: np.random.Generator, site: Site, kind: str):
    long = [f.name for link in site.arm.links for f in link if f.kind == "T" and f.name and abs(f.value) > 0.15]
    return "all" if rng.random() < 0.5 else str(rng.choice(long)), {"alpha": 1.0}, {}


def _drift(rng: np.random.Generator, site: Site, kind: str):
    v, span = _unit(rng, site), float(site.session.time[-1])
    size = dict(zip("xyz", map(float, v), strict=True))
    if rng.random() < 0.5:
        return "linear", size, {"span": span}
    return "exponential", size, {"tau": float(rng.uniform(0.08, 0.35)) * span}


def _slip(rng: np.random.Generator, site: Site, kind: str):
    when = {"t0": float(rng.uniform(0.2, 0.8)) * float(site.session.time[-1])}
    if rng.random() < 0.6:
        return str(rng.choice(turning(site))), {"step": _sign(rng)}, when
    v = _unit(rng, site) * 0.5  # 0.05 mrad of a joint and 25 µm of the base are alike
    size = dict(zip("xyz", map(float, v), strict=True))
    if rng.random() < 0.5 and len(site.arm.measured) == 3:  # about the vertical alone it would be joint 1 that slipped
        size |= dict(zip(("roll", "pitch", "yaw"), map(float, 0.7 * _unit(rng, site)), strict=True))
    return "base", size, when


def _field(rng: np.random.Generator, site: Site, kind: str):
    reach = np.linalg.norm(site.walk.p - site.walk.o_base, axis=1).max()
    if kind == "instrument_scale":
        return "instrument", {"c": _sign(rng)}, {}
    if kind == "instrument_field":
        weights = rng.normal(size=(6, 3)) / reach**2
        return "instrument", {f"{a}{m}": float(weights[m, i]) for m in range(6) for i, a in enumerate("xyz")}, {}
    k, v = _unit(rng, site) * 2 * np.pi / rng.uniform(0.4, 1.0) / reach, _unit(rng, site)
    shape = {f"k{a}": float(k[i]) for i, a in enumerate("xyz")} | {f"v{a}": float(v[i]) for i, a in enumerate("xyz")}
    return "field", {"h": 1.0}, shape | {"phase": float(rng.uniform(0, 2 * np.pi))}


def _quantised(rng: np.random.Generator, site: Site, kind: str):
    return str(rng.choice(turning(site))), {"share": 1.0}, {"lsb": float(2 * np.pi / 2 ** rng.integers(12, 16))}


def _beyond(rng: np.random.Generator, site: Site, kind: str):
    names = turning(site)
    joint = str(rng.choice(names))
    q = site.session.q[:, site.joint(joint)]
    if kind == "dent":
        span = q.max() - q.min()
        centre = float(rng.uniform(q.min() + 0.2 * span, q.max() - 0.2 * span))
        return joint, {"h": _sign(rng)}, {"centre": centre, "width": float(rng.uniform(0.15, 0.4))}
    if kind == "square_wave":
        return joint, {"h": 1.0}, {"k": float(rng.integers(1, 7)), "phase": float(rng.uniform(0, 2 * np.pi))}
    if kind == TANGLED:
        k = rng.choice([-1.0, 1.0], site.arm.n) * rng.uniform(4.0, 12.0, site.arm.n)  # per rad: no two postures alike
        waves = {f"k{j}": float(v) for j, v in enumerate(k)}
        return joint, {"h": 1.0}, {**waves, "phase": float(rng.uniform(0, 2 * np.pi))}
    a, b = rng.choice(names, 2, replace=False)
    if kind == "product":
        first, second = rng.uniform(0, 2 * np.pi, 2)
        return f"{a}*{b}", {"h": 1.0}, {"first": float(first), "second": float(second)}
    loaded = [j for j in range(site.arm.n) if np.abs(site.tau[:, j]).max() > LOADED]
    j = int(rng.choice(loaded)) if loaded else 0
    others = [n for n in names if n != site.arm.joints[j]]
    size = {"h": 1 / max(np.abs(site.tau[:, j]).max(), 1e-9)}
    return f"{rng.choice(others)}|{site.arm.joints[j]}", size, {}


_SPECIAL = {
    **dict.fromkeys(("gear_eccentricity", "gear_second_harmonic", "gear_ripple", "cyclic_error"), _cyclic),
    **dict.fromkeys(
        ("joint_compliance", "link_bending", "base_compliance", "load_backlash", "payload_error"), _per_load
    ),
    **dict.fromkeys(("dent", "product", "wrong_load", "square_wave", TANGLED), _beyond),
    **dict.fromkeys(("instrument_scale", "instrument_field", "waving_field"), _field),
    "hysteresis": _hysteresis,
    "joint_coupling": _coupling,
    "thermal_growth": _growth,
    "drift": _drift,
    "slip": _slip,
    "quantisation": _quantised,
    "late_reading": lambda rng, site, kind: ("instrument", {"t": _sign(rng)}, {}),
    "tool_shift": lambda rng, site, kind: ("tool", dict(zip("xyz", _unit(rng, site), strict=True)), {}),
}  # fmt: skip
