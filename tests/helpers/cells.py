"""Problems of arms in a cell, as data."""

from __future__ import annotations

import posture_opt as po

TABLE = {"name": "table", "kind": "box", "size": ["0.7 m", "1.2 m", "20 mm"], "xyz": ["0.65 m", "0 m", "-10 mm"]}
POST = {"name": "post", "kind": "cylinder", "radius": "60 mm", "length": "0.8 m", "xyz": ["0.35 m", "0.4 m", "0.4 m"]}
LAMP = {"name": "lamp", "kind": "sphere", "radius": "80 mm", "xyz": ["0.45 m", "0.1 m", "0.75 m"]}
GROUND = {"name": "ground", "kind": "half_space", "normal": [0, 0, 1], "offset": "-20 mm"}


def problem_in_cell(preset, *obstacles, clearance="20 mm", shape=None, mounting=None, **task):
    """The insert task of a preset among obstacles; ``task`` gives further keys of the task."""
    robot = {"kind": "preset", "name": preset, **({} if shape is None else {"shape": shape})}
    document = {
        "robot": robot,
        "uncertainty": {"repeatability": "0.1 mm"},
        "cell": {"obstacles": list(obstacles), "clearance": clearance, **({"mounting": mounting} if mounting else {})},
        "task": {"kind": "insert", **task},
    }
    return po.problem_from_dict(document)
