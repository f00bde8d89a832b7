"""What the report says of named causes: words, size, gain, and what other cause could explain the same.

A cause is named with its evidence (a p-value corrected for the whole search), its size with one standard error, and
the share of the RMS error on held-out rows that it removes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.diagnosis.causes.causes import tool_shifts
from posture_opt.model.effects.base.multiples import line_words
from posture_opt.model.effects.drift import Drift
from posture_opt.numerics import rms
from posture_opt.report.measured_parts.cause_advice import advice
from posture_opt.report.measured_parts.cause_inspections import inspection, inspections
from posture_opt.report.measured_parts.causes_table import (
    causes_table,
    determined_geometry,
    number_of,
    rival_words,
    rivals_of,
    shift_at_tool,
    view_key,
)
from posture_opt.report.measured_parts.diagnosis_sizes import (
    fitted_effects,
    headline_of,
    periodic_joints,
)
from posture_opt.report.parts.parts import sentence
from posture_opt.report.text.blocks import Block, Facts, Table
from posture_opt.report.text.words import p_value, p_words
from posture_opt.selection.problem_data import ProblemData
from posture_opt.statements.notation import length, percent
from posture_opt.units import ERROR_UNITS, plus_minus

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis

_MAX_PAIRS, _MAX_MEASUREMENTS = 4, 8  # of causes that could be confused, and of measurements that discriminate them
_IMITATED_SHARE = 0.8  # of an effect at the tool: what geometry imitates by more is said
_MAX_FULL_EFFECTS = 4  # effects that are described in full; lighter ones are rows of a table
_AT_TOOL_NOTE = "At the tool: the RMS shift that geometry could not imitate, or the largest σ."
_ALONE_NOTE = (
    "RMS drop: by how much the error is smaller than with all other causes alone, so that drops do not add up."
)
_OPEN_SIZE_NOTE = "Open: seen, but of uncertain size."
_MASSES = "Masses"  # what is said of a compliance where the file states none
_MAX_GEOMETRY = 5  # geometric parameters that are farthest off, for their errors


def finding_words(finding: Finding, problem: ProblemData) -> str:
    """A finding in words; scatter of which the problem file states nothing is said to be so.

    "… scatters more than stated" would be wrong where nothing is stated.
    """
    noise = finding.noise
    if noise is not None and noise.unstated and finding.determined and not _states(problem, finding):
        return noise.unstated.format(target=noise.target, size=noise.headline(finding.sizes))
    return finding.cause.worded(finding.sizes) if finding.plausible else finding.cause.looks_like


def _states(problem: ProblemData, finding: Finding) -> bool:
    """Whether the file says how the joint of a finding scatters from repeat to repeat."""
    sources = problem.sources
    names = [] if finding.noise is None else finding.noise.scatter(problem.robot)
    return any(sources.scatter[i, i] > 0 for i, name in enumerate(sources.names) if name in names)


def causes_block(found: Diagnosis) -> Block:
    """All causes in a table, with what to do about them: what a screen has of them."""
    if not found.effects:
        return Block("Causes", ("None is found.",), brief=())
    last = ", open sizes" if not all(f.determined for f in found.effects) else ""
    items: tuple[str | Facts | Table, ...] = (causes_table(found), *_columns_notes(found), *advice(found))
    return Block(f"Causes, by what they explain{last}, geometry last", items, brief=items, stays=True)


def each_cause_block(found: Diagnosis) -> tuple[Block, ...]:
    """Every cause with its sizes, its evidence, and what it explains, one by one; nothing without any.

    The largest contribution comes first; causes of less gain than the first four are lines of a table.
    """
    if not found.effects:
        return ()
    items: list[str | Facts | Table] = []
    effects = [f for _, f in fitted_effects(found)]
    short = effects[_MAX_FULL_EFFECTS:] if len(effects) > _MAX_FULL_EFFECTS + 1 else []
    said: dict[str, int] = {}
    for finding in (f for f in found.effects if f not in short):
        number = number_of(found, finding)
        rows = [(label, _said_once(label, text, number, said)) for label, text in _facts(found, finding)]
        what = f"{number}. {sentence(finding_words(finding, found.problem))}"
        items += [what, Facts(tuple(rows), view=view_key(found, finding))]
    if short:
        items += ["Lighter ones:", _lighter(found, short), *inspections(found, [f for f in short if f.determined])]
    return (Block("Each cause", tuple(items), "diagnosis_curves" if effects else "", brief=()),)


def _columns_notes(found: Diagnosis) -> tuple[str, ...]:
    """What the columns of the table mean, as far as they hold anything that is to be explained."""
    open_ = any(not f.determined or f.open_part is not None for f in found.effects)
    notes = {
        _AT_TOOL_NOTE: any(shift_at_tool(found, f) for f in found.effects),
        _ALONE_NOTE: len(found.effects) > 1,
        _OPEN_SIZE_NOTE: open_ and len(found.effects) > 1,
    }
    text = " ".join(note for note, holds in notes.items() if holds)
    return (text,) if text else ()


def _said_once(label: str, text: str, number: int, said: dict[str, int]) -> str:
    """A text; what was said of an earlier cause of what the file lacks, as that of the other.

    Args:
        said: label -> the number of the cause where it was said, which this one is added to.
    """
    if label != _MASSES:
        return text
    first = said.setdefault(label, number)
    return text if first == number else f"{text.partition(' in place of')[0]}, as of cause {first}"


def _lighter(found: Diagnosis, findings: list[Finding]) -> Table:
    """Effects of less gain, one a line: size, shift beyond geometry, gain [%] and p-value."""
    rows = []
    for finding in findings:
        size = headline_of(finding) or ("" if finding.determined else "not determined")
        label = f"{number_of(found, finding)}. {finding.label}"
        rows.append((label, size, shift_at_tool(found, finding), percent(finding.gain), p_value(finding.p_value)))
    views = tuple(view_key(found, finding) for finding in findings)
    return Table(("cause", "size", "at the tool", "RMS drop", "p-value"), tuple(rows), views=views)


def _facts(found: Diagnosis, finding: Finding) -> list[tuple[str, str]]:
    """What is known of one cause, line by line: sizes, evidence, gain, planning, rivals.

    Left out where they do not apply: "Open" (the size is not determined, and stated nowhere), "In the file" (the file
    states a part of it), "At the tool" (a cause that moves nothing), "Planning" and "Could be".
    """
    place = finding.place
    name = finding.kind if finding.target == "all" else f"{finding.kind} of {finding.target}"
    name = f"{finding.kind} ({finding.target})" if isinstance(finding.cause, Drift) else name
    rows = [("Name", name)]
    sizes = finding.cause.sizes(finding.sizes) if finding.determined else ()
    rows += [(size.label[:1].upper() + size.label[1:], str(size)) for size in sizes]
    if finding.effect is None and finding.noise is None and not finding.estimate:
        rows += _geometry(found)
    if not finding.plausible:
        rows.append(("Would need", finding.would_need))
    if not finding.determined:
        rows.append(("Open", "these data do not determine the size: its uncertainty is as large"))
    if finding.open_part is not None:
        rows.append(("Open", f"these data do not determine its {line_words(finding.open_part.spectral_lines)}"))
    if finding.stated is not None and finding.determined:
        rows.append(("In the file", f"{finding.stated.stated_size}; the size here is the total"))
    if place is not None and finding.determined:
        rows.append(_at_tool(found, finding))
    rows.append(("Look at", inspection(found, finding)))
    rows.append(("Evidence", f"{p_words(finding.p_value)}, corrected for the whole search"))
    gain = _gain(found, finding)
    rows += [("Gain", gain)] if gain else []
    planning = _planning(found, finding)
    rows += [("Planning", planning)] if planning else []
    if finding.confounded_with:
        rows.append(("Could be", f"{rivals_of(finding, len(finding.confounded_with))} instead: see below"))
    return rows


def _planning(found: Diagnosis, finding: Finding) -> str:
    """Whether tasks are planned with a cause, where that is not plain."""
    entry = finding.effect or finding.noise
    if entry is None:
        return ""
    place = finding.place
    if place in found.delivery.vague:
        return "left out: these data do not determine its size"
    if place in found.delivery.dropped:
        return "left out: held-out rows are predicted no worse without it"
    if place in found.delivery.together:
        if finding.determined:
            return "its open lines hold together with all else in extended.yaml only, and are marked there"
        return "together with all else in extended.yaml; by itself its number there is no size of this cause"
    return entry.planning_note(place in found.delivery.kept)


def _at_tool(found: Diagnosis, finding: Finding) -> tuple[str, str]:
    """How far an effect moves the tool point in these data, and how much of that no geometry could imitate.

    The second part is said where it is below 80 % of the RMS shift: the rest would be taken by a plain calibration.
    """
    alone, beyond = tool_shifts(found.model, finding)
    most, size, own = float(alone.max()), rms(alone), rms(beyond)
    text = f"up to {length(most)} in these data, {length(size, among=[most])} RMS"
    if own < _IMITATED_SHARE * size:
        text += f"; {length(own, among=[most])} RMS of it is beyond what geometry could imitate"
    return "At the tool", text


def _gain(found: Diagnosis, finding: Finding) -> str:
    """By how much a cause reduces the cross-validated RMS, in words; empty where that is said elsewhere.

    A share: it is of the effects as they were chosen, the RMS errors in the report of effects chosen anew in each fold.
    """
    if finding.noise is not None:
        return _covers(found) if finding.noise.uneven else ""
    whole = " with its open lines" if finding.open_part is not None else ""
    text = f"reduces the RMS by {percent(finding.gain)}{whole}, everything else fitted again without it"
    if finding.interval is not None and finding.interval[0] <= 0:
        text += "; not significant"
    return text


def _covers(found: Diagnosis) -> str:
    """The gain of stating uneven noise: regions that hold what they should; nothing of other noise.

    Compared are shares of rows in their 95 % regions with and without it, of the quarter of rows that it spreads most.
    """
    held = found.held
    shape = held["extended"].shape
    if shape is None or fitted_effects(found):
        return ""
    sizes = np.trace(shape, axis1=1, axis2=2)
    alike = np.ptp(sizes) < 0.1 * sizes.mean()  # only the directions differ
    most = sizes >= (0.0 if alike else np.quantile(sizes, 0.75))
    after, before = (percent(float(held[name].inside[most].mean())) for name in ("extended", "calibrated"))
    which = "the rows" if alike else "the quarter of rows that it spreads most"
    return f"of {which}, {after} lie in their 95 % regions; without it {before}"


def _geometry(found: Diagnosis) -> list[tuple[str, str]]:
    """The most certain parameters of the arm with its effects, with their standard errors [mrad or mm]."""
    far = [(abs(x / std), p.name, x, std, p.unit) for p, x, std in determined_geometry(found)]
    far.sort(reverse=True)
    texts = [f"{name} {plus_minus(x, s, *ERROR_UNITS[unit])}" for _, name, x, s, unit in far[:_MAX_GEOMETRY]]
    return [("Most certain", f"{', '.join(texts)}; 'corrections' of extended.yaml holds them all")] if texts else []


def cyclic_block(found: Diagnosis) -> tuple[Block, ...]:
    """The periodogram of the joints with cyclic errors; nothing where there are none."""
    names = [found.model.residuals.data.joint_names[j] for j in periodic_joints(found)]
    if not names:
        return ()
    text = (
        f"Periodic joint errors were searched for at every frequency of each joint, in cycles per revolution; they are "
        f"found in {', '.join(names)}. The p-values are corrected for that search."
    )
    return (Block("Periodic joint errors", (text,), "diagnosis_periodogram", brief=()),)


def confusion_block(found: Diagnosis) -> tuple[Block, ...]:
    """What each cause may be confused with, and the measurement that would discriminate them; nothing if nothing.

    Pairs that one measurement discriminates share a line.
    """
    splits: dict[str, list[str]] = {}
    for finding in found.effects:
        rivals = {rival_words(rival): rival for rival in finding.confounded_with}
        for label, rival in rivals.items():
            splits.setdefault(finding.cause.discrimination(rival), []).append(f"{finding.label} or {label}")
    if not splits:
        return ()
    text = "These data fit either cause about equally well; the named one fits best. To discriminate them:"
    texts = [f"{_listed(pairs)}: {split}." for split, pairs in splits.items()]
    more = [f"And {len(texts) - _MAX_MEASUREMENTS} more measurements."] if len(texts) > _MAX_MEASUREMENTS else []
    return (Block("Causes that could be confused", (text, *texts[:_MAX_MEASUREMENTS], *more), brief=()),)


def _listed(pairs: list[str]) -> str:
    """Pairs of causes in one line."""
    return "; ".join(pairs[:_MAX_PAIRS]) + (f"; and {len(pairs) - _MAX_PAIRS} more" if len(pairs) > _MAX_PAIRS else "")
