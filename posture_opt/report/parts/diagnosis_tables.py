"""The tables of a diagnosis, and ``split_measurements.csv`` with the measurements that discriminate between causes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.diagnosis.cause_statements import numbers_of
from posture_opt.diagnosis.diagnosis_statements import words
from posture_opt.diagnosis.discrimination_plan import detection_probability
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.errors import enumerated
from posture_opt.measurements.columns import AXES
from posture_opt.measurements.kinds.pose import QUATERNION
from posture_opt.report.parts.model_tables import error_cells, error_headers, mm, range_table
from posture_opt.report.text.blocks import Facts, Item, Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements import Quantity, p_value, p_words
from posture_opt.statements.notation import angle, count, joint_unit, percent
from posture_opt.texts import csv_line
from posture_opt.units import ERROR_UNITS, fixed, number, plus_minus

if TYPE_CHECKING:
    from collections.abc import Mapping

    from posture_opt import Diagnosis
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.causes.sessions import Gain, SecondSession
    from posture_opt.diagnosis.discrimination_plan import DiscriminationPlan
    from posture_opt.diagnosis.measured_goals import Choice, MeasuredGoals

MODELS = {name: MODEL_NAMES[name] for name in ("nominal", "calibrated", "extended")}
ACTIONS = {
    "inspect": "inspect",
    "compensate": "compensate",
    "check_instrument": "check instrument first",
    "confirm": "confirm first",
    "measure": "measure more",
    "ignore": "ignore",
}
_DELIVERED = {
    "delivered": "yes",
    "together": "together with the rest only",
    "session": "no: it belongs to this session",
    "size_undetermined": "no: the size is not determined",
    "no_gain": "no: held-out rows do not need it",
}


def view_key(found: Diagnosis, finding: Finding) -> str:
    """By which the interactive view knows a cause."""
    return f"cause-{numbers_of(found, [finding])[0]}"


def causes_table(found: Diagnosis) -> Table:
    """Every cause: size, shift at the tool, what to do, what else it could be."""
    rows = []
    for k, (finding, action) in enumerate(zip(found.effects, found.actions, strict=True), 1):
        like = "" if finding.plausible else "looks like "
        place = f" ({finding.cause.place})" if finding.cause.place else ""
        shift = found.shift_at_tool(finding)
        moved = "" if shift is None else f"{'σ ' * (finding.noise is not None)}{mm(shift)} mm"
        row = (f"{k}. {like}{finding.cause.title}{place}", _size(found, finding), moved)
        rows.append((*row, ACTIONS[action.action], rivals(finding)))
    headers = ("cause", "size", "at the tool", "what to do", "could also be")
    width = len(headers) - (not any(row[-1] for row in rows))
    views = tuple(view_key(found, f) for f in found.effects)
    return Table(headers[:width], tuple(row[:width] for row in rows), width, views=views, least=16)


def _size(found: Diagnosis, finding: Finding) -> str:
    if not finding.determined:
        return "not determined"
    if finding.open_part is not None:
        return f"{finding.size_text} + {len(finding.open_part.size_parts)} open"
    if finding.size_text or finding.kind != "geometry":
        return finding.size_text or "several parameters"
    return f"{sum(c.certain for c in found.corrections)} of {count(len(found.corrections), 'parameter')} differ"


def rivals(finding: Finding, most: int = 1) -> str:
    """The causes that the data cannot tell from a finding: those with a name first, and how many more there are."""
    ordered = sorted(finding.confounded_with, key=lambda rival: isinstance(rival, UnnamedComponent))
    labels = list(dict.fromkeys(rival.title_or_words for rival in ordered))
    more = len(labels) - most
    return enumerated([*labels[:most], *([f"{more} more"] if more > 0 else [])], "or")


def each_cause(found: Diagnosis) -> tuple[Item, ...]:
    """Every cause with its sizes, its evidence, and whether it is delivered."""
    items: list[Item] = []
    for k, finding in enumerate(found.effects, 1):
        rows = [("Name", f"{finding.kind} of {finding.target}")]
        sizes = finding.cause.sizes(finding.sizes) if finding.determined else ()
        rows += [(size.label.capitalize(), str(size)) for size in sizes]
        if finding.kind == "geometry":
            far = sorted((c for c in found.corrections if c.std), key=lambda c: -abs(c.value / c.std))[:5]
            texts = (f"{c.parameter.name} {plus_minus(c.value, c.std, *ERROR_UNITS[c.parameter.unit])}" for c in far)
            rows.append(("Most certain", ", ".join(texts)))
        rows += [("Would need", finding.would_need)] if not finding.plausible else []
        rows += [("In the file", finding.stated.stated_size)] if finding.stated is not None else []
        rows.append(("Evidence", f"{p_words(finding.p_value)}, corrected for the whole search"))
        if finding.interval is not None:
            low, high = (percent(value) for value in finding.interval)
            rows.append(("RMS drop", f"{percent(finding.gain)} ({low} to {high} with 95 % confidence)"))
        if finding.place is not None:
            rows.append(("Delivered", _DELIVERED[found.delivery.status(finding.place)]))
        if finding.confounded_with:
            rows.append(("Could be", rivals(finding, len(finding.confounded_with))))
        clause = words(finding, found.problem)
        items += [f"{k}. {clause[:1].upper()}{clause[1:]}.", Facts(tuple(rows), view=view_key(found, finding))]
    return tuple(items)


def errors_table(found: Diagnosis) -> Table:
    """Held-out errors of each model [mm], with the share of rows in their 95 % regions, and the noise floor."""
    delivery = found.delivery
    models = {name: text for name, text in MODELS.items() if name != "extended" or found.fitted_effects}
    if delivery.kept and (delivery.session or delivery.vague):
        models["delivered"] = MODEL_NAMES["delivered"]
    rows = [
        (text, *error_cells(found.errors[name]), percent(float(found.held[name].inside.mean())))
        for name, text in models.items()
    ]
    floor = found.noise_floor
    rows += [(floor.label, mm(floor.rms), *[""] * 5)] if floor.rms else []
    return Table((*error_headers(found.request.data), "in its 95 % region"), tuple(rows))


def test_tables(found: Diagnosis, test: SecondSession) -> tuple[Table, ...]:
    """Errors on the test file by model, in and out of the measured ranges, and the gain of each effect."""
    names = {name: text for name, text in MODELS.items() if name in test.models}
    rows = tuple((text, *error_cells(test.models[name])) for name, text in names.items())
    gains = []
    for place, f in found.fitted_effects:
        gain: Gain | None = test.gains[place]
        # In brackets where it is not significant.
        seen = "not tested" if gain is None else percent(gain.value) if gain.low > 0 else f"({percent(gain.value)})"
        gains.append((f.label, percent(f.gain), seen, _DELIVERED[found.delivery.status(place)]))
    effects = [Table(("effect", "RMS drop here", "on the test file", "delivered"), tuple(gains))] if gains else []
    return (Table(error_headers(found.request.data), rows), *range_table(test.file, names), *effects)


def goals_tables(goals: MeasuredGoals) -> tuple[Table, ...]:
    """Errors in the postures that each model chooses, commanded by it, and as commanded before calibration."""
    sent = _choices("commanded by the model", goals.sent, goals.clearance)
    chosen = _choices("chosen with the model", goals.uncorrected, goals.clearance)
    anyhow = ("any posture", *(number(1e3 * float(np.quantile(goals.anyhow, q))) for q in (0.5, 0.95)))
    blank = [""] * (len(chosen.headers) - len(anyhow) - 1)
    first = (*anyhow, *blank, percent(goals.chance))
    return sent, Table(chosen.headers, (first, *chosen.rows))


def _choices(head: str, choices: Mapping[str, Choice], clearance: float | None) -> Table:
    fits = [] if clearance is None else ["fits"]
    rows = []
    for name, choice in choices.items():
        sizes = [number(1e3 * float(np.quantile(choice.missed, q))) for q in (0.5, 0.95)]
        hits = [] if clearance is None else [percent(choice.hits(clearance))]
        others = number(1e3 * float(np.median(choice.elsewhere)))
        rows.append((MODELS[name], *sizes, *hits, others, percent(choice.better)))
    headers = (head, "error there [mm]", "95 % below", *fits, "in the others [mm]", "chose the better")
    return Table(headers, tuple(rows))


def candidates_table(found: Diagnosis) -> Table:
    """The best candidates on the calibrated arm alone: share of the squares, share left by geometry, p-value."""
    rows = []
    for j in found.search.scored[:8]:
        named = "yes" if j.candidate.named else "no"
        rows.append((j.candidate.what.label, named, percent(j.share), percent(j.rho), p_value(j.p_value)))
    return Table(("candidate", "in the catalogue", "explains", "not absorbed", "p-value"), tuple(rows), text_columns=2)


def split_tables(found: Diagnosis, plan: DiscriminationPlan) -> tuple[Table, ...]:
    """Each pair of causes, how certainly the wrong one is refuted now and as planned, and the planned postures."""
    pairs = []
    for place, finding in found.fitted_effects:
        for split in plan.pairs.get(place, ()):
            then = split.count is not None
            planned = (_refuted(split.chance), str(split.count)) if then else ("", "")
            now = _refuted(detection_probability(split.now))
            pairs.append((finding.label, split.rival.label, angle(split.angle), now, *planned))
    table = Table(("cause", "rival", "angle", "now", "planned", "needed"), tuple(pairs), text_columns=2)
    if not len(plan.rows):
        return (table,)
    robot, rows = found.model.residuals.robot, plan.rows
    headers = [f"{joint.name.replace('_', ' ')} [{joint_unit(joint.type)[0]}]" for joint in robot.joints]
    sides = [f"{robot.joint_names[j]} approach" for j in plan.sided]
    load = [] if rows.payload is None else ["payload [kg]"]
    cells = []
    for i in range(len(rows)):
        values = [fixed(float(v) * joint_unit(j.type)[1]) for v, j in zip(rows.q[i], robot.joints, strict=True)]
        ways = ["increasing" if rows.approach[i, j] > 0 else "decreasing" for j in plan.sided]
        cells.append((str(i + 1), *values, *ways, *([] if rows.payload is None else [f"{rows.payload[i]:g}"])))
    return table, Table(("no.", *headers, *sides, *load), tuple(cells), 0)


def _refuted(p: float) -> str:
    return "above 99.9 %" if p > 0.999 else "below 0.1 %" if p < 0.001 else str(Quantity(p, "share"))


FILE = "split_measurements.csv"


def split_csv(found: Diagnosis) -> str:
    """The planned measurements with the columns of the data, what is to be measured left empty; empty without any."""
    plan, data = found.split, found.request.data
    parts = [("split", plan.rows, plan.rounds, 2)] if plan is not None and len(plan.rows) else []
    # Postures that are to be repeated are commanded as they were.
    parts += [(f"repeat {p.target}", p.rows, p.times, 6) for p in found.repeat_plans]
    if not parts:
        return ""
    robot = found.model.residuals.robot
    headers = [f"{j.name} [{joint_unit(j.type)[0]}]" for j in robot.joints]
    labels = [name for name in ("pose", "goal") if getattr(data, f"{name}_given")]
    every = tuple(range(robot.n)) if data.approach_given and found.repeat_plans else ()
    sided = every or (plan.sided if plan is not None else ())
    sides = [f"{robot.joint_names[j]}.approach" for j in sided]
    load = ["payload [kg]"] if any(rows.payload is not None for _, rows, _, _ in parts) else []
    logged = {"temperature [degC]": data.temperature, "time [s]": data.time}
    empty = [f"{AXES[a]} [mm]" for a in np.flatnonzero(data.measured_axes)]
    empty += list(QUATERNION) if data.rotation is not None else []
    empty += [name for name, values in logged.items() if values is not None]
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
