"""The block on the task planned anew: the posture before and after, where each one lands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from posture_opt.report.blocks import Block, Table
from posture_opt.report.parts import sentence
from posture_opt.report.units_text import joint_value, length, percent
from posture_opt.report.words import PARTS

if TYPE_CHECKING:
    from posture_opt.selection.plan_comparison import Replanned

FIGURE = "landing"
_HARDLY = 0.7  # of the old error: a gain that hardly shows at the task
_NOTHING = 1e-7  # m: a miss that the plan corrected for is rounding


def replanned_blocks(replanned: Replanned, after: str = "calibrated") -> tuple[Block, ...]:
    """What the measurements change for the task: a sentence, both postures and their errors, or why there is none."""
    title = "Posture before and after"
    reasons = tuple(sentence(reason) for reason in replanned.reasons)
    if replanned.after is None:
        return (Block(title, (f"The {after} arm has no posture for this task.", *reasons)),)
    figure = FIGURE if replanned.before is not None and replanned.after is not None else ""
    return (Block(title, (*_sentences(replanned, after), *reasons, _table(replanned, after)), figure),)


def replanned_lead(replanned: Replanned, after: str = "calibrated") -> tuple[str, ...]:
    """What it means for the task, in a sentence; nothing where one of the postures is missing."""
    old, new = replanned.landed, replanned.landing
    if old is None or new is None:
        return ()
    sizes = [old.critical_error, new.critical_error]
    lead = (
        f"For the task: in its best posture the old model would have come within {_length(sizes[0], sizes)} of the "
        f"target, the {after} one comes within {_length(sizes[1], sizes)} (95 of 100 visits)."
    )
    left = "What is left is scatter, and what these data do not tell of the arm."
    return (f"{lead} {left}",) if sizes[1] > _HARDLY * sizes[0] else (lead,)


def _sentences(replanned: Replanned, after: str) -> tuple[str, ...]:
    old, new = replanned.landed, replanned.landing
    if old is None or new is None:
        return ("The arm as it stood had no posture for this task:",)
    assert replanned.after is not None
    part = PARTS[replanned.after.critical.within]
    before, now = old.critical_error, new.critical_error
    return (
        f"With the old model the tool would have missed the target by {length(old.distance, among=[before])} {part} "
        f"(no more than {length(before)} in 95 of 100 visits); with the {after} one it stays within {length(now)} of "
        "it in 95 of 100.",
    )


def _table(replanned: Replanned, after: str) -> Table:
    pairs = ((replanned.before, replanned.landed), (replanned.after, replanned.landing))
    assert replanned.after is not None
    robot = replanned.after.programme.robot
    sizes = [landing.critical_error for _, landing in pairs if landing is not None]
    rows = [
        (joint.name, *("none" if s is None else joint_value(s.q[k], joint.type) for s, _ in pairs))
        for k, joint in enumerate(robot.joints)
    ]
    planned = [math.nan if s is None else s.critical.sigma_max for s, _ in pairs]
    known, misses, radii = (
        [math.nan if g is None else float(getattr(g, name)) for _, g in pairs]
        for name in ("sigma_max", "distance", "critical_error")
    )
    for label, values in (
        ("scatter that was planned with", planned),
        ("scatter by what is known now", known),
        ("mean off the target", misses),
        ("95 of 100 times within", radii),
    ):
        rows.append((label, *(_length(value, sizes) for value in values)))
    odds = [None if g is None else g.success_probability for _, g in pairs]
    if any(p is not None for p in odds):
        rows.append(("meets the clearance", *("" if p is None else _odds(p) for p in odds)))
    return Table(("", "as it stands", after), tuple(rows))


def _length(metres: float, among: list[float]) -> str:
    if not math.isfinite(metres):
        return ""
    return length(metres, among=among) if metres > _NOTHING else "0"


def _odds(p: float) -> str:
    return percent(p) if p < 0.9995 else "practically always"
