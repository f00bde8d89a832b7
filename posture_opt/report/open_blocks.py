"""What the report says of what stays open: what has no name, what geometry hides, what no such data can tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.report.blocks import Block, Facts, Table
from posture_opt.report.diagnosed import Diagnosed
from posture_opt.report.effect_words import UNLIKELY, cause_words, chance_words, odds, short_words
from posture_opt.report.parts import sentence
from posture_opt.report.units_text import number, percent

if TYPE_CHECKING:
    from posture_opt.diagnosis.candidates import ScoredCandidate

_FAINT = 0.1  # share of its trace that geometry leaves of a cause: it had to be ten times larger to be seen as well
_SLOW, _SLOW_CYCLES = ("joint_scale", "gear_eccentricity", "gear_second_harmonic"), 5.0
_SHOWN = 8  # candidates of the table


def left_block(diagnosed: Diagnosed) -> Block:
    """Whether anything is left that no cause explains, how surely, and where."""
    found = diagnosed.diagnosis
    left = found.adequacy
    title = "What has no name"
    if found.outcome != "unexplained":
        p = number(100 * left.p_value, 2)
        return Block(title, (f"Nothing of note: noise alone leaves as much structure {p} times in 100.",))
    items: list[str | Facts | Table] = [
        "Something is left that is no noise, and no cause of the catalogue explains it."
    ]
    rows = [("Hangs on", "; ".join(cause_words(u.kind, u.target) for u in found.unexplained))]
    if not found.unexplained:
        rows = [("Seen along", left.place)]
    if left.structure < UNLIKELY:
        rows.append(("Neighbours", f"rows with a similar {left.place} err alike: {chance_words(left.structure)}"))
    if left.lack_of_fit < UNLIKELY:
        rows.append(("Repeats", f"the model misses poses by more than they repeat: {chance_words(left.lack_of_fit)}"))
    items.append(Facts(tuple(rows)))
    items += [
        f"On {joint} the effects {', '.join(names)} add up to one curve: rather one shape without a name than as many "
        "causes."
        for joint, names in _sums(diagnosed).items()
    ]
    items.append("The figure shows the errors that are left over each joint.")
    return Block(title, tuple(items), "diagnosis_left")


def _sums(diagnosed: Diagnosed) -> dict[str, list[str]]:
    """Joints on which several slow curves are needed at once."""
    slow: dict[str, list[str]] = {}
    for _, finding in diagnosed.effects:
        cycles = finding.estimate.get("cycles", (0.0,))[0]
        if finding.kind in _SLOW or (finding.kind == "cyclic_error" and cycles < _SLOW_CYCLES):
            slow.setdefault(finding.target, []).append(short_words(finding.kind, "all", finding.estimate))
    return {joint: names for joint, names in slow.items() if len(names) > 1}


def scores_block(diagnosed: Diagnosed) -> Block:
    """The best candidates on the calibrated arm alone."""
    scored = diagnosed.diagnosis.search.scored
    text = (
        f"{len(scored)} causes and curves without a name were set against what the calibrated arm leaves, each by "
        "itself. 'Explains' is of the sum of squares; 'geometry leaves' is the share of the trace of a cause that no "
        "length or angle can imitate; 'by chance' counts in that so many were tried."
    )
    rows = tuple(
        (
            short_words(j.candidate.kind, j.candidate.target, _cycles(j)),
            "yes" if j.candidate.named else "no",
            percent(j.share),
            percent(j.rho),
            odds(j.p_value),
        )
        for j in scored[:_SHOWN]
    )
    headers = ("candidate", "in the catalogue", "explains", "geometry leaves", "by chance")
    return Block("What competed", (text, Table(headers, rows, text_columns=2)), "diagnosis_scores")


def _cycles(scored: ScoredCandidate) -> dict[str, tuple[float, float, str]] | None:
    cycles = getattr(scored.candidate.what, "cycles", None)
    return None if cycles is None else {"cycles": (float(cycles), float("nan"), "")}


def absorbed_block(diagnosed: Diagnosed) -> Block:
    """Causes that geometry hides in these data, and causes that were not looked for at all."""
    from posture_opt.diagnosis.undetectable import not_looked_for

    search = diagnosed.diagnosis.search
    hidden = [short_words(s.kind, s.target) for s, _ in search.absorbed]
    faint = [
        short_words(j.candidate.kind, j.candidate.target) for j in search.scored if j.candidate.named and j.rho < _FAINT
    ]
    items: list[str | Facts | Table] = []
    if hidden:
        items.append(
            f"Cannot be seen in these data, because lengths and angles of the arm do the same here: {_list(hidden)}. "
            "They are absorbed, not absent; wider joint ranges bring them out."
        )
    if faint:
        items.append(f"Hardly seen, because geometry explains more than nine tenths of their trace: {_list(faint)}.")
    lacking = not_looked_for(diagnosed.residuals)
    rows = tuple((what.capitalize(), f"{_kinds(kinds)}; {mend}") for what, mend, kinds in lacking.values())
    if rows:
        items += ["Not looked for, because the files do not hold what they hang on:", Facts(rows)]
    if not items:
        items.append("Every cause of the catalogue would show in these data, if it is large enough.")
    return Block("What cannot be seen in these data", tuple(items))


def _kinds(kinds: tuple[str, ...]) -> str:
    return ", ".join(kind.replace("_", " ") for kind in kinds)


def _list(names: list[str]) -> str:
    names = list(dict.fromkeys(names))
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def unknowable_block(diagnosed: Diagnosed) -> Block:
    """What no data of this kind can tell, why, and what would."""
    from posture_opt.diagnosis.undetectable import unknowable

    limits = unknowable(diagnosed.residuals)
    rows = tuple((x.kind.replace("_", " ").capitalize(), f"{sentence(x.reason)} To know: {x.mend}.") for x in limits)
    if not rows:
        return Block("What no data of this kind can tell", ("Nothing is hidden on principle.",))
    return Block("What no data of this kind can tell", (Facts(rows),))
