"""posture_opt itself: one `PostureSelector` built per arm, then solved again and again at new positions."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.arms import Arm, Array
from benchmarks.ways import Solve

TITLE = "posture_opt"


def problem(arm: Arm) -> dict[str, Any]:
    """The benchmark's problem for one arm, as the content of a problem file; no way of the race checks collisions."""
    return {
        "name": f"Vertical insertion with a {arm.name}",
        "robot": {"kind": "urdf", "file": str(arm.path), "base_link": arm.base, "tip_link": arm.tip},
        "cell": "none",
        "uncertainty": {
            "sigma": {f"{joint}.theta": f"{sigma!r} rad" for joint, sigma in zip(arm.joints, arm.sigma, strict=True)}
        },
        "task": {"kind": "insert", "direction": [0, 0, -1], "tool_axis": [0, 0, 1], "position": _metres(arm)},
    }


def build(arm: Arm) -> Solve:
    import posture_opt as po

    selector = po.PostureSelector(po.problem_from_dict(problem(arm)))

    def solve(position: Array) -> Array | None:
        try:
            solution = selector.solve(position=tuple(position), ordinary=0.0)
        except po.errors.NoSolutionError:  # the judge counts a false word as a failure
            return None
        return np.array([solution.posture[joint] for joint in arm.joints])

    return solve


def _metres(arm: Arm) -> list[str]:
    """The middle of the box: any position will do, each solve brings its own."""
    return [f"{value!r} m" for value in np.mean([arm.lower, arm.upper], axis=0).tolist()]
