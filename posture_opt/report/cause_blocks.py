"""What the report says of named causes: size, weight, and what else could stand for them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.blocks import Block, Facts, Table
from posture_opt.report.diagnosed import Diagnosed
from posture_opt.report.effect_rivals import splitting_measurement
from posture_opt.report.effect_words import (
    chance_words,
    main_size,
    odds,
    plus_minus,
    short_words,
    size_words,
)
from posture_opt.report.finding_words import finding_words
from posture_opt.report.parts import sentence
from posture_opt.report.units_text import length, number, percent

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes import Finding

_PAIRS, _SPLITS = 4, 8  # of causes that could be confused, and of measurements that tell them apart
_FULL = 4  # effects that are told in full; lighter ones stand in a table
_OF_ARM = "it spreads the tool point from visit to visit, and stands under effects in extended.yaml"
_OF_MEASUREMENT = "left out, as it is of the measurement and not of the arm"
_VAGUE = 10.0  # times the standard error among what the data tell: the rest is open
_LISTED = 5  # geometric parameters that are farthest off, for their errors


def causes_block(diagnosed: Diagnosed) -> Block:
    """Every named cause with its size, its evidence, and what it explains."""
    found = diagnosed.diagnosis
    if not found.findings:
        return Block("Causes", ("None is found.",))
    items: list[str | Facts | Table] = []
    short = [f for _, f in diagnosed.effects][_FULL:] if len(diagnosed.effects) > _FULL + 1 else []
    for i, finding in enumerate((f for f in found.findings if f not in short), 1):
        what = f"{i}. {sentence(finding_words(finding, diagnosed.problem))}"
        items += [what, Facts(tuple(_facts(diagnosed, finding)))]
    if short:
        items += ["Lighter ones:", _lighter(diagnosed, short)]
    figure = "diagnosis_curves" if diagnosed.effects else ""
    return Block("Causes, the weightiest first", tuple(items), figure)


def _lighter(diagnosed: Diagnosed, findings: list[Finding]) -> Table:
    """Effects of less weight, one a line."""
    rows = []
    for finding in findings:
        place = diagnosed.place(finding)
        assert place is not None
        most = length(float(diagnosed.at_tool(place).max()))
        name = short_words(finding.kind, finding.target, finding.estimate)
        size = main_size(finding, diagnosed.amplitude(place))
        rows.append((name, size, most, percent(finding.gain), odds(finding.p_value)))
    return Table(("cause", "size", "at the tool up to", "off the RMS", "by chance"), tuple(rows))


def _facts(diagnosed: Diagnosed, finding: Finding) -> list[tuple[str, str]]:
    place = diagnosed.place(finding)
    name = finding.kind if finding.target == "all" else f"{finding.kind} of {finding.target}"
    rows = [("Name", name)]
    loads = place is not None and getattr(finding.effect, "loads", "masses") == "points"
    sizes = (
        _loads(diagnosed, place)
        if loads and place is not None
        else size_words(
            finding, None if place is None else diagnosed.amplitude(place), diagnosed.residuals.data.time is not None
        )
    )
    rows += [(label[:1].upper() + label[1:], text) for label, text in sizes]
    if finding.kind == "geometry":
        rows += _geometry(diagnosed)
    if place is not None:
        rows.append(_at_tool(diagnosed, place))
    rows.append(("Evidence", _evidence(finding.p_value)))
    brings = _brings(diagnosed, finding)
    rows += [("Brings", brings)] if brings else []
    stays = {effect.name for effect in diagnosed.diagnosis.persistent.effects()}
    if finding.effect is not None and finding.effect.name in stays and not finding.effect.for_planning:
        rows.append(("Planning", "kept, as asked for: the 'time' of the task says when it is done"))
    elif finding.effect is not None and not finding.effect.for_planning:
        rows.append(("Planning", _left_out(finding)))
    if finding.noise is not None:
        rows.append(("Planning", _OF_ARM if finding.noise.of_arm else _OF_MEASUREMENT))
    if finding.confounded_with:
        others = ", ".join(dict.fromkeys(short_words(*rival) for rival in finding.confounded_with))
        rows.append(("Could be", f"{others} instead: see below"))
    return rows


def _left_out(finding: Finding) -> str:
    if finding.kind == "slip":
        if finding.target == "base":
            return (
                "left out: set the base up again and measure anew; the plan holds it where it stood on average, if free"
            )
        return "left out: planned for the arm as it was before; undo the slip, or measure anew, before you use that"
    whose = "the instrument's" if finding.kind == "instrument_field" else "this session's"
    return f"left out, as it is {whose} and not the arm's"


def _loads(diagnosed: Diagnosed, place: int) -> list[tuple[str, str]]:
    """Of a joint that gives way under masses that nobody states: how far it turns, and what is not known for that."""
    low, high = diagnosed.turns(place)
    count = len(diagnosed.diagnosis.model.suspects[place].Z.T)
    return [
        ("Turns by", f"{number(1e3 * low)} to {number(1e3 * high)} mrad in these data"),
        (
            "Masses",
            f"the file states none, so {count} loads times compliance are estimated in place of one compliance: that "
            "costs certainty, and the stiffness stays open; state 'mass' and 'com' of every joint",
        ),
    ]


def _evidence(p: float) -> str:
    return f"{chance_words(p)}, with the whole search for causes counted in"


def _at_tool(diagnosed: Diagnosed, place: int) -> tuple[str, str]:
    moved = diagnosed.at_tool(place)
    most, rms = float(moved.max()), float(np.sqrt(np.mean(moved**2)))
    return "At the tool", f"up to {length(most)} in these data, {length(rms, among=[most])} RMS"


def _brings(diagnosed: Diagnosed, finding: Finding) -> str:
    found = diagnosed.diagnosis
    if finding.noise is not None:
        return _covers(diagnosed) if finding.noise.uneven else ""
    if finding.effect is None:
        geometry = [f for f in found.findings if f.effect is None and f.noise is None]
        if finding is not geometry[0]:
            return ""  # it brings what it brings with the others, which is said of the first
        return (
            f"{'all geometry together' if len(geometry) > 1 else 'the geometry'} takes {percent(finding.gain)} off the "
            f"RMS of the arm as it stands: {_mm(found.errors['nominal'].rms)} to "
            f"{_mm(found.errors['calibrated'].rms)} mm"
        )
    rms = found.errors["extended"].rms
    without = rms / max(1 - finding.gain, 1e-9)
    text = f"{percent(finding.gain)} off the RMS: without it {_mm(without)} mm instead of {_mm(rms)} mm"
    if finding.interval is not None and finding.interval[0] <= 0:
        text += "; that little is no sure gain"
    return text


def _covers(diagnosed: Diagnosed) -> str:
    """What uneven noise brings where it is told: regions that hold what they should; nothing of other noise."""
    held = diagnosed.diagnosis.held
    shape = held["extended"].shape
    if shape is None or diagnosed.effects:
        return ""
    sizes = np.trace(shape, axis1=1, axis2=2)
    alike = np.ptp(sizes) < 0.1 * sizes.mean()  # only the directions differ
    most = sizes >= (0.0 if alike else np.quantile(sizes, 0.75))
    after, before = (percent(float(held[name].inside[most].mean())) for name in ("extended", "calibrated"))
    which = "the rows" if alike else "the quarter of rows that it spreads most"
    return f"of {which}, {after} lie in their 95 % regions; without it {before}"


def _geometry(diagnosed: Diagnosed) -> list[tuple[str, str]]:
    """The surest parameters of the arm with its effects, with their standard errors."""
    calibration, model = diagnosed.diagnosis.calibration, diagnosed.diagnosis.model
    D = model.directions
    g = D.shape[1]
    std = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", D, model.covariance[:g, :g], D), 0.0))
    far = [
        (abs(float(x / s)), p.name, float(x), float(s), p.unit)
        for p, x, s, whole in zip(calibration.parameters, model.x, std, calibration.std, strict=True)
        if p.group == "geometry"
        and 0 < whole < _VAGUE * s  # what the data leave open has a small part in what they tell
    ]
    far.sort(reverse=True)
    units = {"rad": (180 / np.pi, "deg"), "m": (1e3, "mm")}
    texts = [f"{name} {plus_minus(x, s, *units[unit])}" for _, name, x, s, unit in far[:_LISTED]]
    return [("Surest", f"{', '.join(texts)}; 'corrections' of extended.yaml holds them all")] if texts else []


def cyclic_block(diagnosed: Diagnosed) -> tuple[Block, ...]:
    """The periodogram of the joints with cyclic errors; nothing where there are none."""
    names = [diagnosed.residuals.data.joint_names[j] for j in diagnosed.cyclic_joints]
    if not names:
        return ()
    text = (
        f"Errors that come back with the turn of a wheel were sought at every number of cycles a turn of each joint; "
        f"they are found in {', '.join(names)}. The search over all of them is counted in the evidence."
    )
    return (Block("Cycles of gears", (text,), "diagnosis_periodogram"),)


def confusion_block(diagnosed: Diagnosed) -> tuple[Block, ...]:
    """What each cause may be confused with, and the measurement that would tell them apart; nothing if nothing."""
    splits: dict[str, list[str]] = {}
    for finding in diagnosed.diagnosis.findings:
        mine = short_words(finding.kind, finding.target, finding.estimate)
        for kind, target in dict.fromkeys(finding.confounded_with):
            split = splitting_measurement((finding.kind, finding.target), (kind, target))
            splits.setdefault(split, []).append(f"{mine} or {short_words(kind, target)}")
    if not splits:
        return ()
    text = "These data fit either cause about as well. What is named explains them best; a measurement would tell:"
    texts = [f"{_listed(pairs)}: {split}." for split, pairs in splits.items()]
    more = [f"And {len(texts) - _SPLITS} more measurements."] if len(texts) > _SPLITS else []
    return (Block("What could be confused", (text, *texts[:_SPLITS], *more)),)


def _listed(pairs: list[str]) -> str:
    return "; ".join(pairs[:_PAIRS]) + (f"; and {len(pairs) - _PAIRS} more" if len(pairs) > _PAIRS else "")


def _mm(metres: float) -> str:
    return number(metres * 1e3)
