"""Why no motion keeps its bounds: between which points a joint has to move farther or faster than it may."""

from __future__ import annotations

import math

import numpy as np

from posture_opt.selection.paths.motion import Motion
from posture_opt.selection.paths.motion_search import MotionSearch
from posture_opt.selection.paths.time_law import TimeLaw
from posture_opt.selection.search.relaxation import Reason
from posture_opt.units import joint_text


def too_large_a_step(search: MotionSearch, largest: float, calm: Motion) -> Reason:
    """Between which listed points a joint has to move farther than it may, and what would do.

    Args:
        largest: change that is allowed [rad or m]; ``calm`` the motion of least largest step.
    """
    smallest, ends = calm.largest_step, np.flatnonzero(search.path.listed)
    k = int(np.argmax(calm.steps))
    swept = np.ptp(calm.Q[ends[k] : ends[k + 1] + 1], axis=0)
    joint = search.engine.robot.joints[int(np.argmax(np.where(search.steps.counted, swept, 0.0)))]
    names = [search.path.numbers[end] for end in ends]
    hint = math.ceil(math.degrees(smallest) * 10 + 1e-6) / 10
    message = (
        f"from {names[k]} to {names[k + 1]} {joint.name} has to move by {math.degrees(smallest):.4g} deg, and "
        f"{math.degrees(largest):.4g} deg a step are allowed: set largest_step: {hint:g} deg, or list more points"
    )
    return Reason("largest_step", message, smallest - largest, "rad")


def too_fast(search: MotionSearch, speed: float, law: TimeLaw) -> Reason:
    """Which joint is too slow for a speed of the tool [m/s], where, and which speed would do.

    Args:
        law: of the fastest motion that was found.
    """
    highest, step = law.highest, law.limiting_step
    assert highest is not None, "a motion that no joint bounds is not too fast"
    assert step is not None, "a joint that bounds a motion does so in a step"
    joint = search.engine.robot.joints[search.engine.robot.joint_names.index(str(law.limiting_joint))]
    needed, limit = (f"{joint_text(v, joint.unit)}/s" for v in (joint.velocity * speed / highest, joint.velocity))
    first = int(np.count_nonzero(search.path.listed[: step + 1]))
    message = (
        f"at {speed * 1e3:.4g} mm/s {joint.name} would have to move at {needed} between points {first} and "
        f"{first + 1}, and {limit} is its limit: set speed: {_below(highest * 1e3):g} mm/s"
    )
    return Reason("speed", message, speed - highest, "m/s")


def too_fast_in_small_steps(search: MotionSearch, largest: float, speed: float) -> Reason:
    """What is said where either bound can be kept, and no motion was found that keeps both.

    Args:
        largest: change that is allowed [rad or m].
    """
    message = (
        f"no motion was found at {speed * 1e3:.4g} mm/s with steps of at most {math.degrees(largest):.4g} deg: "
        "leave out largest_step, or lower the speed"
    )
    return Reason("speed", message, 0.0, "m/s")


def _below(value: float) -> float:
    """The number with three digits, rounded down."""
    power = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.floor(value / power * (1 - 1e-9)) * power:.4g}")
