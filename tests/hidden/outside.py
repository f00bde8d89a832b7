"""What the catalogue does not hold: a dent, a product of joints, the wrong joint's load, a waving field, a square.

A cable that tugs is told by no shape at all: its pull hangs on how all joints lie, and looks like scatter from posture
to posture, yet it is the same at every repeat.
"""

from __future__ import annotations

import numpy as np

from tests.hidden.effects import FORMS, Effect, Perturbation, Site, form, of_joint
from tests.hidden.mechanics import Array

OUTSIDE = ("dent", "product", "wrong_load", "waving_field", "square_wave")
TANGLED = "cable"


def _dent(site: Site, j: int, v: dict[str, float]) -> Array:
    return v["h"] * np.exp(-0.5 * ((site.session.q[:, j] - v["centre"]) / v["width"]) ** 2)


of_joint("dent", _dent)
of_joint("square_wave", lambda s, j, v: v["h"] * np.sign(np.sin(v["k"] * s.session.q[:, j] + v["phase"])))


@form(TANGLED)
def _cable(site: Site, e: Effect, out: Perturbation) -> None:
    """The cable is caught or it is not, as a wave over all joints has it."""
    k = np.array([e.shape[f"k{j}"] for j in range(site.arm.n)])
    out.joint(site.joint(e.target), e.size["h"] * np.tanh(3 * np.sin(site.session.q @ k + e.shape["phase"])))


@form("product")
def _product(site: Site, e: Effect, out: Perturbation) -> None:
    a, b = map(site.joint, e.target.split("*"))
    q = site.session.q
    out.joint(b, e.size["h"] * np.sin(q[:, a] + e.shape["first"]) * np.sin(q[:, b] + e.shape["second"]))


@form("wrong_load")
def _wrong_load(site: Site, e: Effect, out: Perturbation) -> None:
    """Lost motion of one joint that grows with the torque of another."""
    a, b = map(site.joint, e.target.split("|"))
    out.joint(a, e.size["h"] * site.session.side[:, a] * np.abs(site.tau[:, b]))


@form("waving_field")
def _waving(site: Site, e: Effect, out: Perturbation) -> None:
    k, v = (np.array([e.shape[f"{n}{axis}"] for axis in "xyz"]) for n in ("k", "v"))
    wave = np.sin((site.walk.p - site.walk.o_base) @ k + e.shape["phase"])
    out.shift = out.shift + e.size["h"] * wave[:, None] * v


assert {*OUTSIDE, TANGLED} <= set(FORMS)
