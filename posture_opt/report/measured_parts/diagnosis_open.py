"""What stays open: the unexplained, what no such data can show, and measurements that discriminate between causes.

Each block ends with what to do: postures to repeat, inputs to record, or measurements to add.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.csv_text import csv_line
from posture_opt.diagnosis.causes.causes import missing_inputs, unknowable_causes
from posture_opt.diagnosis.discrimination.discrimination_design import detection_probability
from posture_opt.diagnosis.scores import levels
from posture_opt.errors import enumerated
from posture_opt.measurements.columns import AXES
from posture_opt.measurements.kinds.pose_columns import QUATERNION
from posture_opt.report.measured_parts.cause_advice import FILE
from posture_opt.report.measured_parts.diagnosis_sizes import fitted_effects, like_noise, noise_floor
from posture_opt.report.measured_parts.error_table import mm
from posture_opt.report.parts.parts import sentence
from posture_opt.report.text.blocks import Block, Facts, Table
from posture_opt.report.text.words import UNLIKELY, p_value, p_words
from posture_opt.statements.notation import angle, count, joint_unit, percent
from posture_opt.units import fixed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.diagnosis.discrimination.discrimination_plan import DiscriminatedPair, DiscriminationPlan
    from posture_opt.diagnosis.noise.repeat_plan import RepeatPlan
    from posture_opt.diagnosis.noise.uneven_noise import UnevenErrors
    from posture_opt.measurements.measurements import Measurements
    from posture_opt.robot.robot import Robot

_MIN_IDENTIFIABLE_SHARE = (
    0.1  # share of an effect that geometry leaves: ten times larger it would be as significant; a choice of taste
)
_CERTAIN_P_VALUE = 0.99  # p-value that is written as 1
_MAX_SCATTERING_JOINTS = 2  # joints that one arm may have scattering at once
_FEW_ITEMS = 4  # sentences of a block that leave room for all causes on a screen
_MAX_CANDIDATES = 8  # candidates of the table
_TIME = "time"  # the place of residuals that are alike in the order of measuring
_REPEATED_DIGITS = 6
_TITLE = "Measurements that discriminate between causes"
_READ = (
    "The angle is that between the effects of the two causes on these data, beside the geometry and the other effects "
    "(0 deg: indistinguishable); 'now' is the probability that data like these refute the wrong one."
)
_IMPOSSIBLE = (
    "Pairs without a number cannot be discriminated by the postures, sides of approach and payloads at hand: see above."
)


def left_block(found: Diagnosis) -> Block:
    """Whether anything is left that no cause explains, how certainly, and where.

    Two tests: whether errors of neighbouring rows are correlated, and whether the model misses poses by more than they
    repeat (lack of fit). Lines of tests that find nothing are left out. Several slow effects on one joint are reported
    as one unnamed shape.
    """
    left = found.adequacy
    title = "Unexplained structure"
    if found.verdict != "unexplained":
        p = "p ≈ 1" if left.p_value > _CERTAIN_P_VALUE else p_words(left.p_value)
        return Block(title, (f"No unexplained structure remains ({p}).",))
    items: list[str | Facts | Table] = []
    rows = [("Depends on", "; ".join(component.words for component in found.unexplained))]
    if found.unexplained or left.p_value < levels.LACK_OF_FIT_LEVEL:
        items.append(_pattern_words(found))
    if not found.unexplained:
        seen = items and left.place in found.unexplained_places
        rows = [("Seen along", "the order of the rows" if left.place == _TIME else left.place)] if seen else []
    if left.structure < UNLIKELY:
        alike = "successive rows" if left.place == _TIME else f"rows with a similar {left.place}"
        rows.append(("Neighbours", f"errors of {alike} are correlated: {p_words(left.structure)}"))
    if left.lack_of_fit < UNLIKELY:
        rows.append(
            ("Repeats", f"the model misses poses by more than they repeat (lack of fit): {p_words(left.lack_of_fit)}")
        )
    items += [Facts(tuple(rows))] if rows else []
    brief = [*items[:1], *([Facts(tuple(rows[:1]))] if rows and items else [])]
    items += all_uneven_words(found.uneven)
    items += [_to_repeat(plan) for plan in found.repeat_plans]
    items += [
        f"On {joint} the effects {', '.join(names)} add up to one curve: rather one unnamed shape than as many causes."
        for joint, names in _sums(found).items()
    ]
    brief += items[len(brief) :] if len(items) <= _FEW_ITEMS else []
    items.append("The figure diagnosis_left (--out DIR) shows the remaining errors over each joint.")
    return Block(title, tuple(items), "diagnosis_left", brief=tuple(brief))


def _pattern_words(found: Diagnosis) -> str:
    """That the rest is not random, and how large it is where it is no larger than noise."""
    if not like_noise(found):
        return "The remaining errors are not random, and no known cause explains their pattern."
    rest, floor = found.errors["extended"].rms, noise_floor(found)
    noise = f"{'' if floor.repeated else 'the '}{floor.label} ({mm(floor.rms)} mm)"
    return (
        f"The remaining errors ({mm(rest)} mm RMS) are about as large as {noise}, but not random; no known cause "
        "explains their pattern."
    )


def all_uneven_words(uneven: Sequence[UnevenErrors]) -> list[str]:
    """Errors that look like noisy joints or instruments; joints of which repeats say the same share a sentence."""
    alike: dict[tuple[object, ...], list[UnevenErrors]] = {}
    for errors in uneven:
        of_joint = errors.effect.moved_joint and (errors.refuted, errors.still, errors.scatters)
        alike.setdefault((errors.effect.kind, of_joint or errors.effect.target), []).append(errors)
    return [uneven_words(those) for those in alike.values()]


def uneven_words(alike: Sequence[UnevenErrors]) -> str:
    """Errors that look like noise of one joint or of several, and what repeats say of them.

    Refuted: repeats of one posture do not scatter so, the errors are systematic. Otherwise too few postures were
    repeated.
    """
    errors = max(alike, key=lambda one: one.p_value)
    clause = errors.effect.uneven_clause
    if len(alike) > 1:
        joints = enumerated([one.effect.target for one in alike])
        clause = errors.effect.uneven_words.format(target=f"any of {joints}")
    text = f"{clause} ({p_words(errors.p_value)})"
    if errors.scatters:
        return f"{text}, and by more than repeats of one posture scatter: the rest is the same at every repeat."
    if errors.refuted:
        return f"{text}, but repeats of one posture do not scatter so: the errors are the same at every repeat."
    if errors.still:
        return (
            f"{text}, but rows of one posture that follow each other do not scatter so. If the arm left the posture in "
            "between, state data: {repeats: visits}: the errors are systematic then. If not, return to some."
        )
    return f"{text}; too few postures were repeated to tell scatter from a systematic error."


def _to_repeat(plan: RepeatPlan) -> str:
    """Which postures to repeat, and how often, to discriminate scatter from structure."""
    lines = ", ".join(map(str, plan.rows.line))
    return (
        f"To tell whether {plan.target} scatters, measure the postures of lines {lines} {plan.times} times each, "
        f"moving away in between and returning from the same side; fill in {FILE} and diagnose again."
    )


def unexplained_lead(found: Diagnosis) -> tuple[str, ...]:
    """What to repeat where only that is missing to separate scatter from structure; nothing elsewhere.

    Where the residual errors have structure anyway, or grow with many joints at once, repeats would show no more.
    """
    plans = found.repeat_plans
    structured = found.unexplained or found.adequacy.p_value < levels.LACK_OF_FIT_LEVEL
    if not plans or structured or len(plans) > _MAX_SCATTERING_JOINTS:
        return ()
    joints, one = " and ".join(plan.target for plan in plans[:2]), plans[0]
    more = f" and {count(len(plans) - 2, 'more joint')}" if len(plans) > 2 else ""
    return (
        f"Errors are larger where {joints}{more} {'moves' if len(plans) == 1 else 'move'} the tool more: repeat "
        f"{count(len(one.rows), 'posture')} {one.times} times each to tell scatter from a systematic error.",
    )


def _sums(found: Diagnosis) -> dict[str, list[str]]:
    """Joints on which several slow curves are needed at once, each with the names of its effects.

    Several slow effects that add up to one curve are rather one cause that the catalogue does not have.
    """
    slow: dict[str, list[str]] = {}
    for _, finding in fitted_effects(found):
        if finding.effect is not None and finding.effect.slow:
            slow.setdefault(finding.target, []).append(finding.cause.title)
    return {joint: names for joint, names in slow.items() if len(names) > 1}


def scores_block(found: Diagnosis) -> Block:
    """The best candidates on the calibrated arm alone.

    Columns: whether it is in the catalogue (else an unnamed curve), share of the sum of squares that it explains,
    share of it that geometry does not absorb, p-value corrected for the number of candidates.
    """
    scored = found.search.scored
    text = (
        f"{len(scored)} causes and unnamed curves were fitted one at a time to the residuals of the calibrated arm. "
        "'explains' is the share of the sum of squares; 'not absorbed' the share of the effect that geometry cannot "
        "imitate; the p-value is corrected for the number of candidates."
    )
    rows = tuple(
        (
            j.candidate.what.label,
            "yes" if j.candidate.named else "no",
            percent(j.share),
            percent(j.rho),
            p_value(j.p_value),
        )
        for j in scored[:_MAX_CANDIDATES]
    )
    headers = ("candidate", "in the catalogue", "explains", "not absorbed", "p-value")
    return Block("Candidates", (text, Table(headers, rows, text_columns=2)), "diagnosis_scores", brief=())


def absorbed_block(found: Diagnosis) -> Block:
    """Causes that geometry absorbs in these data, and causes that were not searched for at all.

    Absorbed is not absent: in these postures they act like lengths and angles of the arm. Of causes that were not
    searched for, the missing input and how to record it are named.
    """
    search = found.search
    hidden = [candidate.what.label for candidate, _ in search.absorbed]
    faint = [j.candidate.what.label for j in search.scored if j.candidate.named and j.rho < _MIN_IDENTIFIABLE_SHARE]
    items: list[str | Facts | Table] = []
    if hidden:
        items.append(
            f"Not identifiable in these data, as they act like lengths and angles of the arm: {_list(hidden)}. They "
            "are absorbed, not absent; wider joint ranges reveal them."
        )
    if faint:
        items.append(f"Hardly identifiable, as geometry absorbs more than nine tenths of them: {_list(faint)}.")
    lacking = missing_inputs(found.model.residuals)
    logged = [key for key in lacking if getattr(found.request.data, key, None) is not None]
    rows = tuple(
        (what.capitalize(), f"{_kinds(kinds)}; {'it hardly changed in these rows: ' * (key in logged)}{hint}")
        for key, (what, hint, kinds) in lacking.items()
    )
    if rows:
        items += ["Not searched for, as the files lack the inputs that they depend on:", Facts(rows)]
    if not items:
        items.append("Every cause of the catalogue is identifiable in these data, if it is large enough.")
    return Block("What these data cannot show", tuple(items), brief=())


def _kinds(kinds: tuple[str, ...]) -> str:
    """Kinds of effects as text."""
    return ", ".join(kind.replace("_", " ") for kind in kinds)


def _list(names: list[str]) -> str:
    """Up to twelve names, and how many more there are."""
    names = list(dict.fromkeys(names))
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def unknowable_block(found: Diagnosis) -> Block:
    """What no data of this kind can determine, why, and what would."""
    limits = unknowable_causes(found.model.residuals)
    rows = tuple((x.kind.replace("_", " ").capitalize(), f"{sentence(x.reason)} To know: {x.hint}.") for x in limits)
    if not rows:
        return Block("What no data of this kind can show", ("No cause is hidden in principle.",), brief=())
    return Block("What no data of this kind can show", (Facts(rows),), brief=())


def split_block(found: Diagnosis) -> tuple[Block, ...]:
    """Pairs that further postures discriminate, and these postures; nothing where no effect has a rival.

    Where no posture, side or payload at hand helps, the block has the pairs only. The number needed is that which
    refutes the wrong cause with a probability of 90 %.
    """
    plan = found.split
    if plan is None:
        return ()
    pairs = _pairs(found, plan)
    if not len(plan.rows):
        text = "No posture, side of approach or payload at hand discriminates these; the measurements named above do."
        return (Block(_TITLE, (f"{text} {_READ}", pairs), brief=()),)
    often = "" if plan.rounds == 1 else f" in {plan.rounds} rounds"
    items: list[str | Facts | Table] = [
        f"{count(len(plan.rows), 'posture')}{often} refute the wrong cause of each pair, whichever it is; 'needed' is "
        f"the number of measurements, from the first, that do so with a probability of 90 %. {_READ}",
        pairs,
        *([_IMPOSSIBLE] if any(s.count is None for each in plan.pairs.values() for s in each) else []),
        _postures(found, plan),
        "The postures keep clear of the arm itself and go no lower than its base or than these data; other obstacles "
        f"are not checked, so drive slowly the first time. Fill in {FILE}, append its rows to the data, column by "
        "column, and diagnose again.",
    ]
    return (Block(_TITLE, tuple(items), brief=()),)


def _pairs(found: Diagnosis, plan: DiscriminationPlan) -> Table:
    """Each pair of causes, the angle between them, and how certainly the wrong one is refuted, now and as planned.

    The angle [deg] is that between the effects on these data with geometry and all other effects projected out.
    """
    rows = []
    for place, finding in fitted_effects(found):
        for split in plan.pairs.get(place, ()):
            names = finding.label, split.rival.label
            rows.append((*names, angle(split.angle), _probability(detection_probability(split.now)), *_then(split)))
    table = Table(("cause", "rival", "angle", "now", "planned", "needed"), tuple(rows), text_columns=2)
    return table if len(plan.rows) else Table(table.headers[:4], tuple(row[:4] for row in table.rows), text_columns=2)


def _then(split: DiscriminatedPair) -> tuple[str, str]:
    """The probability with the plan, and the measurements needed; empty where no posture helps."""
    return ("", "") if split.count is None else (_probability(detection_probability(split.then)), str(split.count))


def _probability(p: float) -> str:
    """A probability of detection in percent."""
    return "above 99.9 %" if p > 0.999 else "below 0.1 %" if p < 0.001 else percent(p)


def _postures(found: Diagnosis, plan: DiscriminationPlan) -> Table:
    """The planned postures [deg or mm] with sides of approach and payloads."""
    robot, rows = found.model.residuals.robot, plan.rows
    headers = [f"{joint.name.replace('_', ' ')} [{joint_unit(joint.type)[0]}]" for joint in robot.joints]
    sides = [f"{robot.joint_names[j]} approach" for j in plan.sided]
    load = [] if rows.payload is None else ["payload [kg]"]
    return Table(("no.", *headers, *sides, *load), tuple(_cells(robot, plan, i) for i in range(len(rows))), 0)


def _cells(robot: Robot, plan: DiscriminationPlan, i: int) -> tuple[str, ...]:
    """One planned posture as a row: number, joints [deg or mm], sides of approach, payload [kg].

    Sides and payload have a column only where the plan varies them.
    """
    rows = plan.rows
    values = [fixed(float(v) * joint_unit(j.type)[1]) for v, j in zip(rows.q[i], robot.joints, strict=True)]
    sides = ["increasing" if rows.approach[i, j] > 0 else "decreasing" for j in plan.sided]
    load = [] if rows.payload is None else [f"{rows.payload[i]:g}"]
    return (str(i + 1), *values, *sides, *load)


def split_csv(found: Diagnosis) -> str:
    """The planned measurements with the columns of the data, what is to be measured left empty; empty without any.

    Joints in deg or mm, to two decimals; postures to repeat as they were commanded, to six. Labels name the plan and
    the number of the posture, rounds repeat the whole list.
    """
    plan, data = found.split, found.request.data
    parts = [("split", plan.rows, plan.rounds, 2)] if plan is not None and len(plan.rows) else []
    # Postures that are to be repeated are commanded as they were.
    parts += [(f"repeat {p.target}", p.rows, p.times, _REPEATED_DIGITS) for p in found.repeat_plans]
    if not parts:
        return ""
    robot = found.model.residuals.robot
    headers = [f"{j.name} [{joint_unit(j.type)[0]}]" for j in robot.joints]
    labels = [name for name in ("pose", "goal") if getattr(data, f"{name}_given")]
    every = tuple(range(robot.n)) if data.approach_given and found.repeat_plans else ()
    sided = every or (plan.sided if plan is not None else ())
    sides = [f"{robot.joint_names[j]}.approach" for j in sided]
    load = ["payload [kg]"] if any(rows.payload is not None for _, rows, _, _ in parts) else []
    empty = _unmeasured(data)
    target = ["target"] if data.target_names else []
    lines = [csv_line([*labels, *target, *headers, *sides, *load, *empty])]
    factors = [math.degrees(1.0) if j.type == "revolute" else 1e3 for j in robot.joints]
    for label, rows, times, digits in parts:
        for i in [*range(len(rows))] * times:
            values = [f"{v:.{digits}f}" for v in np.array(rows.q[i]) * factors + 0.0]
            here = [f"{label} {i + 1}"] * len(labels)
            here += [data.target_names[rows.target[i]]] if target else []
            here += [*values, *(f"{rows.approach[i, j]:.0f}" for j in sided)]
            here += ["" if rows.payload is None else f"{rows.payload[i]:g}"] if load else []
            lines.append(csv_line([*here, *[""] * len(empty)]))
    return "\n".join(lines) + "\n"


def _unmeasured(data: Measurements) -> list[str]:
    """Columns that only the measurement fills."""
    turned = list(QUATERNION) if data.rotation is not None else []
    logged = [("temperature [degC]", data.temperature), ("time [s]", data.time)]
    axes = [f"{AXES[a]} [mm]" for a in np.flatnonzero(data.measured_axes)]
    return [*axes, *turned, *(name for name, values in logged if values is not None)]
