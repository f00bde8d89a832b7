"""A problem with a change made that an infeasible answer offers."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import posture_opt as po


def changed(problem: po.Problem, relaxation: Any) -> po.Problem:
    """The problem with the change made by its keys, as they are printed in the document and no digit more."""
    keys = json.loads(json.dumps(relaxation.to_json()))["set"]
    assert keys
    limits = {key.split(".")[2]: keys.pop(key) for key in list(keys) if key.startswith("robot.")}
    names = sorted((key for key in keys), key=len)
    problem = problem.replace(**{key.replace(".", "__"): keys[key] for key in names})
    size = {"deg": math.radians(1.0), "mm": 1e-3}
    for name, ends in limits.items():  # a preset has no key for them
        lower, upper = (float(end.split()[0]) * size[end.split()[1]] for end in ends)
        joints = tuple(replace(j, lower=lower, upper=upper) if j.name == name else j for j in problem.robot.joints)
        problem = replace(problem, arm=replace(problem.arm, robot=replace(problem.robot, joints=joints)))
    return problem
