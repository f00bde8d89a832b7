"""The report on what changed on a calibrated arm: the verdict, its size, its rivals, and what could be seen."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.assumptions.geometric_deviation import GeometricDeviation
from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.errors import enumerated
from posture_opt.model.effects import FittedSizes
from posture_opt.report.figures.recheck import plot_recheck_changes, plot_recheck_rows
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.page.save import Files
from posture_opt.report.parts.parts import note_facts, robot_facts
from posture_opt.report.results.measurement_plan_report import postures_block
from posture_opt.report.text.blocks import Block, Facts, Report, Summary, Table
from posture_opt.statements.notation import count, length, percent, stated_length
from posture_opt.units import ERROR_UNITS, fixed, number, plus_minus, shown

if TYPE_CHECKING:
    from posture_opt.changes.visibility import Visibility
    from posture_opt.changes.what_changed import LikelyChange, Recheck

_MAX_ROWS = 8
_STATED_SEVERAL = 0.005  # probability from which more than one change is told from none in whole per cent
_NO_MOTION_M = 1e-8  # a change that moves the tool less moves it by rounding only
_MAX_SEEN_TURN = math.pi  # rad: a turn that is seen from there on is seen nowhere
_PHRASES = {
    "tool_frame": "the tool moved in the flange",
    "base_frame": "the base moved",
    "joint_offset": "the zero of {target} is off",
    "link": "the {part} {target} changed",
}
_LENGTHS = ("a", "d", "x", "y", "z")


def recheck_lead(found: Recheck) -> tuple[str, ...]:
    """The answer in its first sentence, then the errors, rivals, what to look at or what could be seen; gross rows."""
    return (*_answer(found), *_gross(found))


def _gross(found: Recheck) -> tuple[str, ...]:
    """The rows that are left out."""
    if not found.gross:
        return ()
    lines = enumerated([f"{row.line} ({length(row.error)})" for row in found.gross])
    noun, verb, them = ("Line", "is", "it") if len(found.gross) == 1 else ("Lines", "are", "them")
    return (f"{noun} {lines} {verb} left out: all other rows contradict {them}. Measure {them} again.",)


def _answer(found: Recheck) -> tuple[str, ...]:
    """What changed, and what follows."""
    first, errors = found.changes[0], _errors(found)
    if found.verdict == "unchanged":
        return (f"Nothing changed that these rows can show (probability {percent(found.unchanged)}).", _power(found))
    if found.shared:
        return (*_one_of(found), errors, *_next(found), *_looked_at(found))
    if found.verdict == "changed":
        changed = f"One thing changed: {sized(found, first)}; probability {percent(first.probability)}{_if_one(found)}."
        return (changed, errors, _rivals(found), *_looked_at(found))
    if found.verdict == "unclear":
        names = enumerated([short(change) for change in (first, *found.rivals)])
        return (f"Something changed, and these rows do not tell what: {names}.", errors, *_next(found))
    if found.named:
        both = enumerated([sized(found, change) for change in found.named])
        return (f"More than one thing changed; likeliest: {both}.", errors, *_next(found))
    return ("The rows err in a way that neither one change nor two explain.", errors, *_next(found))


def _if_one(found: Recheck) -> str:
    """That a probability is that of one change at most, and how likely more are; nothing where that is none."""
    several = found.probabilities.several
    return f" if it is the only one ({percent(several)} that it is not)" if several >= _STATED_SEVERAL else ""


def _one_of(found: Recheck) -> tuple[str, str]:
    """The changes of which one is made, which these postures cannot tell apart; sizes, each of it alone."""
    either = (found.changes[0], *found.shared)
    total = percent(sum(change.probability for change in either))
    names = " or ".join(f"the {short(change)}" for change in either)
    sizes = ", or ".join(f"{sized(found, change)} ({percent(change.probability)})" for change in either)
    first = (
        f"One thing changed: {names}; these postures cannot tell which (probability together {total}{_if_one(found)})."
    )
    return first, f"Each alone: {sizes}."


def _looked_at(found: Recheck) -> tuple[str, ...]:
    """What to look at on the arm: of all that may be the one change."""
    every = (found.changes[0], *found.shared)
    words = dict.fromkeys(inspection(found, change) for change in every)
    loaded = any(change.possible.effect is not None and "payload" in change.possible.effect.asks for change in every)
    if loaded and found.data.payload is None:
        carried = found.problem.arm.inputs.payload
        words[f"the payload: the rows state none, and the file has {carried:.6g} kg"] = None
    return tuple(_ended(f"{'Look at' if k == 0 else 'Or'}: {text}") for k, text in enumerate(words))


def _ended(text: str) -> str:
    """The text with a full stop, unless it ends as a question."""
    return text if text.endswith("?") else f"{text}."


def sized(found: Recheck, change: LikelyChange) -> str:
    """What changed and by how much, in one clause; of what the file states already, from which size on."""
    effect = change.possible.effect
    stated = [e for e in found.problem.arm.effects if effect and (e.kind, e.target) == (effect.kind, effect.target)]
    if stated:
        return f"the {short(change)} changed by {size_words(change)}, from {stated[0].stated_size}"
    if effect is not None:
        return f"{phrase(change)} ({size_words(change)})"
    return f"{phrase(change)} by {size_words(change)}"


def phrase(change: LikelyChange) -> str:
    """What changed, in one clause."""
    known = change.possible
    if known.effect is not None:
        values = {name: (v, s, unit) for name, (v, s, unit) in change.values.items()}
        return known.effect.worded(FittedSizes(values))
    return _PHRASES[change.kind].format(target=change.target, part=_link_part(change.target))


def _link_part(target: str) -> str:
    """Whether a parameter of a link is a length of it or a twist: ``a``, ``d``, ``x``, or ``alpha``, ``roll``."""
    return "length" if target.rpartition(".")[2] in _LENGTHS else "twist"


def short(change: LikelyChange) -> str:
    """The change by its name: "zero of elbow"."""
    return _named(change.kind, change.target)


def size_words(change: LikelyChange) -> str:
    """How large it is: of a frame the length of its shift, else its one parameter, with standard error."""
    if change.possible.effect is not None:
        ((name, dimension),) = change.possible.effect.dimensions
        value, std, _ = change.values[name]
        return shown(value, dimension, std)
    mean, covariance = change.estimate.mean, change.estimate.covariance
    if len(mean) == 1:
        written = ERROR_UNITS[change.possible.parameters[0].unit]
        return plus_minus(float(mean[0]), math.sqrt(covariance[0, 0]), *written)
    shift = mean[:3]
    size = float(np.linalg.norm(shift))
    std = math.sqrt(max(float(shift @ covariance[:3, :3] @ shift), 0.0)) / size if size else 0.0
    vector = ", ".join(fixed(1e3 * float(v), 3) for v in shift)
    turn = 1e3 * float(np.linalg.norm(mean[3:]))
    turned = f" and {number(turn, 2)} mrad" if np.any(np.abs(mean[3:]) > 2 * np.sqrt(np.diag(covariance)[3:])) else ""
    return f"{plus_minus(size, std, 1e3, 'mm')} ({vector}){turned}"


def inspection(found: Recheck, change: LikelyChange) -> str:
    """What to look at on the arm."""
    if change.possible.effect is not None:
        return change.possible.effect.inspect(found.problem.robot)
    return GeometricDeviation.of(change.possible.parameters[0]).inspect(found.problem.robot)


def _next(found: Recheck) -> tuple[str, ...]:
    """What to measure next, where postures are proposed."""
    if found.plan is None:
        return ()
    return (f"Measure the {len(found.plan.q)} postures below as well: with them, changes are told apart best.",)


def _errors(found: Recheck) -> str:
    """The errors before, and after what is named."""
    among = [found.before, found.after]
    before, after = (length(size, among=among) for size in among)
    if found.after >= found.before:
        return f"RMS error of {count(len(found.data), 'row')}: {before}."
    return f"RMS error of {count(len(found.data), 'row')}: {before}, and {after} with it."


def _rivals(found: Recheck) -> str:
    """What nearly as well explains the rows, and what is the same as the change that is named."""
    alike = found.changes[0].possible.alike
    same = f" The rows cannot tell it from {enumerated(list(alike))}." if alike else ""
    if not found.rivals:
        return f"Nothing else explains these rows nearly as well.{same}"
    rivals = enumerated([f"{short(c)} ({percent(c.probability)})" for c in found.rivals[:3]])
    return f"Rivals: {rivals}.{same}"


def _power(found: Recheck) -> str:
    """The power to see 0.1 mm, of the change that is seen best of its kind and of the one that is seen least."""
    least = min(found.visible, key=lambda v: v.power)
    strong = [v for v in found.visible if v.power >= 0.9]
    seen = f"{len(strong)} of {len(found.visible)} possible changes"
    text = f"A change that moves the tool by 0.1 mm would be seen with 90 % or more for {seen}"
    return f"{text}; least for the {_visible_name(least)} ({percent(least.power)})."


def _is_seen(visible: Visibility) -> bool:
    """Whether there is a size from which the change is seen."""
    return not (visible.unit == "rad" and _MAX_SEEN_TURN < visible.size < math.inf)


def _seen_from(visible: Visibility) -> str:
    """The size from which the change is seen; nothing of a frame, which has several."""
    if not _is_seen(visible):
        return "not seen"
    if not math.isfinite(visible.size):
        return ""
    factor, unit = ERROR_UNITS[visible.unit]
    return f"{number(factor * visible.size, 2)} {unit}".rstrip()


def _visible_name(visible: Visibility) -> str:
    """The change by its name."""
    return _named(visible.kind, visible.target)


def _named(kind: str, target: str) -> str:
    """A change by its name: "zero of elbow", "twist elbow.alpha"."""
    names = {
        "tool_frame": "tool",
        "base_frame": "base",
        "joint_offset": "zero of {}",
        "link": _link_part(target) + " {}",
    }
    return names.get(kind, f"{kind.replace('_', ' ')} of {{}}").format(target)


def changes_block(found: Recheck) -> Block:
    """The likeliest changes with their size, and what each of them moves the tool by."""
    rows = [("unchanged", "", "", percent(found.unchanged))]
    for change in found.changes[:_MAX_ROWS]:
        shift = number(1e3 * change.shift, 2) if change.shift >= _NO_MOTION_M else "0"
        rows.append((short(change), size_words(change), shift, percent(change.probability)))
    table = Table(("what", "size", "tool moves [mm]", "probability"), tuple(rows), text_columns=2)
    p = found.probabilities
    text = (
        f"Probability of no change {percent(p.unchanged)}, of one {percent(p.one)}, of more than one, or of errors "
        f"that no change explains, {percent(p.several)}. Each size is that of "
        f"{'both together' if len(found.named) > 1 else 'the change alone'}."
    )
    if p.several >= _STATED_SEVERAL and len(found.named) < 2:
        text += " The table's probabilities are those if at most one thing changed."
    return Block("What may have changed", (text, table), "recheck_changes")


def visible_block(found: Recheck) -> Block:
    """How large each change must be to be seen with a probability of 90 %."""
    rows = tuple(
        (
            _visible_name(v),
            percent(v.power),
            number(1e3 * v.shift, 2) if _is_seen(v) else "",
            _seen_from(v),
        )
        for v in found.visible
    )
    headers = ("what", "power at 0.1 mm", "seen from [mm]", "seen from")
    text = (
        "Power: the probability that a change is seen that moves the tool by 0.1 mm (RMS over these postures), in its "
        "least visible direction. Seen from: the change that is seen with a probability of 90 %."
    )
    return Block("What these rows can show", (text, Table(headers, rows)), "recheck_rows")


def measured_block(found: Recheck) -> Block:
    """Rows, instrument, errors, and the arm that was held against them."""
    sigma = position_sigma(found.problem, found.data)
    name = Path(found.data.file).name or "table"
    facts = (
        ("Measured", f"{count(len(found.data), 'row')} ({name})"),
        ("Instrument", f"σ {stated_length(sigma)} per coordinate" if sigma else "no σ stated"),
        *robot_facts(found.problem),
        *note_facts(found.notes),
    )
    return Block("Data", (Facts(facts),))


class RecheckPresenter(Presenter["Recheck"]):
    """What changed on a calibrated arm."""

    stem = "recheck"

    def summary(self) -> Summary:
        """Verdict, the likeliest change, errors before and after."""
        found, among = self.result, [self.result.before, self.result.after]
        first = found.changes[0]
        facts = (
            ("Verdict", found.verdict),
            ("Unchanged", f"probability {percent(found.unchanged)}"),
            ("Likeliest change", f"{short(first)}, {size_words(first)} ({percent(first.probability)})"),
            ("RMS error", f"{length(among[0], among=among)} before, {length(among[1], among=among)} after"),
        )
        return Summary(f"Recheck with {count(len(found.data), 'row')}: {self.problem.name}", facts)

    def document(self) -> Report:
        """The whole report."""
        found = self.result
        further = (postures_block(found.plan),) if found.plan is not None else ()
        blocks = (changes_block(found), *further, visible_block(found), measured_block(found))
        return Report(found.problem.name or "Recheck", recheck_lead(found), blocks)

    def drawings(self) -> Drawings:
        """Probabilities of the changes, and the errors of the rows."""
        return {
            "recheck_changes": partial(
                plot_recheck_changes, self.result, [short(change) for change in self.result.changes]
            ),
            "recheck_rows": partial(plot_recheck_rows, self.result),
        }

    def files(self) -> Files:
        """``plan.csv`` with the postures to measure next, where there are some."""
        plan = self.result.plan
        return {} if plan is None else {"plan.csv": plan.to_csv().encode()}

    def delivered(self) -> tuple[str, ...]:
        """``plan.csv`` where it is written."""
        return tuple(self.files())

    def columns(self) -> Columns:
        """Every possible change with its probability and the motion of the tool by it [mm], the likeliest first."""
        changes = self.result.changes
        return {
            "kind": [c.kind for c in changes],
            "target": [c.target for c in changes],
            "probability": [c.probability for c in changes],
            "tool moves [mm]": [1e3 * c.shift for c in changes],
        }
