"""What a unit of a requirement is worth: by new solves of other files, and by kinematics written out here."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Callable
from typing import Any

import pytest

import posture_opt as po
from tests.helpers.shipped import preset_robot
from tests.helpers.variants import conformance

DEGREE = math.radians(1.0)
STEP = {"rad": 0.1 * DEGREE, "m": 2e-4}


def document(arm: str, task: dict[str, Any], **more: Any) -> dict[str, Any]:
    sigma = {f"{joint}.theta": f"{0.1 + 0.05 * k} mrad" for k, joint in enumerate(preset_robot(arm).joint_names)}
    stated = {"kind": "insert", "direction": [0, 0, -1], **task}
    return {"robot": {"kind": "preset", "name": arm}, "uncertainty": {"sigma": sigma}, "task": stated, **more}


def set_tilt(data: dict[str, Any], more: float) -> None:
    tilt = float(data["task"].get("tilt", "0 rad").split()[0])
    data["task"]["tilt"] = f"{tilt + more!r} rad"


def set_ceiling(data: dict[str, Any], more: float) -> None:
    ceiling = data["cell"]["obstacles"][0]
    ceiling["offset"] = f"{float(ceiling['offset'].split()[0]) - more!r} m"


CEILING = {"name": "ceiling", "kind": "half_space", "normal": [0, 0, -1], "offset": "-0.68 m"}
CASES: dict[str, tuple[dict[str, Any], dict[str, Callable[[dict[str, Any], float], None]]]] = {
    "tilt": (
        document("irb120", {"position": ["0.35 m", "0.1 m", "0.2 m"], "tilt": f"{8 * DEGREE!r} rad"}),
        {"tilt": set_tilt},
    ),
    "ceiling": (
        document("panda", {"position": ["0.5 m", "0.1 m", "0.2 m"]},
                 cell={"obstacles": [CEILING], "clearance": "10 mm"}),
        {"clearance to ceiling": set_ceiling},
    ),
}  # fmt: skip


def solved(data: dict[str, Any], starts: int | None = None) -> po.Solution:
    return po.PostureSelector(po.problem_from_dict(data), compiled=False).solve(starts=starts, confirm=starts is None)


@pytest.mark.parametrize("name", conformance(CASES, ["tilt"]))
def test_prices_are_those_of_new_solves(name: str) -> None:
    data, changes = CASES[name]
    found = solved(data)
    prices = {price.requirement: price for price in found.prices}
    for requirement, change in changes.items():
        price = prices[requirement]
        step, sigma = STEP[price.unit], []
        for more in (step, -step):
            other = copy.deepcopy(data)
            change(other, more)
            sigma.append(solved(other, starts=8).sigma_max)
        assert price.value == pytest.approx((sigma[1] - sigma[0]) / (2 * step), rel=0.02)
        whole = copy.deepcopy(data)
        change(whole, price.step)
        assert price.gain == pytest.approx(found.sigma_max - solved(whole, starts=8).sigma_max, rel=0.05)


def planar_3r(limit: float) -> dict[str, Any]:
    """Three links of a plane, 0.6, 0.5 and 0.3 m; joint 1 goes no further than ``limit`` [rad]."""
    links = (0.6, 0.5, 0.3)
    joints = [
        {"name": f"joint{k}", "type": "revolute", "a": f"{a} m", "alpha": "0 deg", "d": "0 m", "theta": "0 deg",
         "limits": ["-200 deg", f"{limit!r} rad" if k == 1 else "200 deg"]}
        for k, a in enumerate(links, start=1)
    ]  # fmt: skip
    sigma = {f"joint{k}.theta": f"{k} mrad" for k in (1, 2, 3)}
    task = {"kind": "insert", "direction": [0, -1, 0], "position": ["0.7 m", "0.4 m", "0 m"]}
    return {"robot": {"kind": "dh", "joints": joints}, "uncertainty": {"sigma": sigma}, "task": task}


def least_sigma(limit: float) -> float:
    """Least σ across the direction −y, by hand: σ_x² = Σ (σ_k lever_k)², the lever of a joint how far it is below P.

    The angle of joint 1 is free; the other two reach the target with the elbow on either side.
    """
    best = math.inf
    for side in (1.0, -1.0):
        low, high = -3.4, limit
        for _ in range(6):  # nested grids
            step = (high - low) / 400
            every = [low + k * step for k in range(401)]
            value, first = min((sigma_at(angle, side), angle) for angle in every)
            low, high = max(first - 3 * step, -3.4), min(first + 3 * step, limit)
        best = min(best, value)
    return best


def sigma_at(first: float, side: float) -> float:
    """σ_x [m] with joint 1 at ``first``; infinite where the other links do not reach the target."""
    x, y = 0.6 * math.cos(first), 0.6 * math.sin(first)
    reach, way = math.hypot(0.7 - x, 0.4 - y), math.atan2(0.4 - y, 0.7 - x)
    cosine = (reach**2 + 0.5**2 - 0.3**2) / (2 * reach * 0.5)
    if abs(cosine) > 1:
        return math.inf
    elbow = way + side * math.acos(cosine)
    levers = 0.4, 0.4 - y, 0.4 - y - 0.5 * math.sin(elbow)
    return math.sqrt(sum((1e-3 * k * lever) ** 2 for k, lever in enumerate(levers, start=1)))


def test_the_price_of_a_joint_limit_is_that_by_hand() -> None:
    limit = 0.5
    found = solved(planar_3r(limit))
    assert found.sigma_max == pytest.approx(least_sigma(limit), rel=1e-4)
    (price,) = found.prices
    assert (price.requirement, price.side, price.unit) == ("joint1.limits", "upper", "rad")
    slope = (least_sigma(limit - 1e-3) - least_sigma(limit + 1e-3)) / 2e-3
    assert price.value == pytest.approx(slope, rel=0.01)
    assert price.gain == pytest.approx(least_sigma(limit) - least_sigma(limit + DEGREE), rel=0.02)
    assert re.search(r"joint1.limits, upper end +1 deg", found.report())
    told = found.to_json()["prices"]
    assert told == [{"requirement": "joint1.limits", "value": price.value, "unit": "rad", "side": "upper",
                     "solved_again": {"loosened_by": DEGREE, "gain": price.gain}}]  # fmt: skip
