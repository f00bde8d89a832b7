"""Changes that rows can tell apart at all: links that act alike are one, those that act as a frame or zero are that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posture_opt.changes.new_rows import NewRows
from posture_opt.experiments.possible_changes import FRAME_PARTS
from posture_opt.numerics import Array

_ALIKE_SHARE = 0.02
"""Of its motion: by less, a change of a millimetre differs from another by micrometres."""
_LEAST_LENGTH_M = 5e-3
"""Of a link that is named as acting like another one: what is shorter is an error and no part of the arm."""


def distinct_rows(rows: NewRows) -> NewRows:
    """The rows with links that act as a frame, or as the zero of a joint, left to it, and links that act alike as one.

    Parallel axes have one distance along them between all: the longest link stands for it. A twist about the axis of a
    joint is its zero by another name.
    """
    factors = rows.residuals.robot.parameters
    lengths = {name: abs(factor.nominal) for name, factor in factors.items()}
    frames = {name: rows.twists([f"{name}.{part}" for part in FRAME_PARTS]) for name in ("base", "tool")}
    alike: dict[str, list[str]] = {name: [] for name in frames}
    zeros = [change for change in rows.changes if change.kind == "joint_offset"]
    own = {change.target: rows.twists(change.names) for change in zeros}
    links = [change.target for change in rows.changes if change.kind == "link"]
    for link in sorted(links, key=lambda link: -lengths[link]):
        motion = rows.twists([link])
        others = {**frames, **own}
        same = next((name for name, other in others.items() if _unlike(motion[0], other) < _ALIKE_SHARE), None)
        if same is None:
            own[link], alike[link] = motion, []
        elif same in alike and (factors[link].kind == "rotate" or lengths[link] > _LEAST_LENGTH_M):
            alike[same].append(link)
    gone = set(links) - set(own)
    kept = [change for change in rows.changes if change.target not in gone]
    return replace(rows, changes=tuple(replace(c, alike=tuple(alike.get(c.target, ()))) for c in kept))


def _unlike(one: Array, others: Array) -> float:
    """The share of a motion (6 N,) that no combination of other motions (p, 6 N) makes."""
    size = float(np.linalg.norm(one))
    if not size:
        return 0.0
    left = one - others.T @ np.linalg.lstsq(others.T, one, rcond=None)[0]
    return float(np.linalg.norm(left)) / size
