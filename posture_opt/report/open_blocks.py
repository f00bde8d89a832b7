"""What the report says of what stays open: the unexplained, what geometry absorbs, what no such data can tell."""

from __future__ import annotations

from posture_opt.diagnosis.causes import missing_inputs, unknowable
from posture_opt.report.blocks import Block, Facts, Table
from posture_opt.report.diagnosed import Diagnosed
from posture_opt.report.parts import sentence
from posture_opt.report.units_text import percent
from posture_opt.report.words import UNLIKELY, p_value, p_words

_FAINT = 0.1  # share of an effect that geometry leaves: ten times larger it would be as significant; a choice of taste
_SURE = 0.99  # p-value that is written as 1
_SHOWN = 8  # candidates of the table


def left_block(diagnosed: Diagnosed) -> Block:
    """Whether anything is left that no cause explains, how surely, and where."""
    found = diagnosed.diagnosis
    left = found.adequacy
    title = "Unexplained structure"
    if found.verdict != "unexplained":
        p = "p ≈ 1" if left.p_value > _SURE else p_words(left.p_value)
        return Block(title, (f"No unexplained structure remains ({p}).",))
    items: list[str | Facts | Table] = ["Structure remains that is not noise, and no known cause explains it."]
    rows = [("Depends on", "; ".join(component.words for component in found.unexplained))]
    if not found.unexplained:
        rows = [("Seen along", left.place)]
    if left.structure < UNLIKELY:
        rows.append(
            ("Neighbours", f"errors of rows with a similar {left.place} are correlated: {p_words(left.structure)}")
        )
    if left.lack_of_fit < UNLIKELY:
        rows.append(
            ("Repeats", f"the model misses poses by more than they repeat (lack of fit): {p_words(left.lack_of_fit)}")
        )
    items.append(Facts(tuple(rows)))
    items += [
        f"On {joint} the effects {', '.join(names)} add up to one curve: rather one unnamed shape than as many causes."
        for joint, names in _sums(diagnosed).items()
    ]
    items.append("The figure shows the remaining errors over each joint.")
    return Block(title, tuple(items), "diagnosis_left")


def _sums(diagnosed: Diagnosed) -> dict[str, list[str]]:
    """Joints on which several slow curves are needed at once."""
    slow: dict[str, list[str]] = {}
    for _, finding in diagnosed.effects:
        if finding.effect is not None and finding.effect.slow:
            slow.setdefault(finding.target, []).append(finding.cause.title)
    return {joint: names for joint, names in slow.items() if len(names) > 1}


def scores_block(diagnosed: Diagnosed) -> Block:
    """The best candidates on the calibrated arm alone."""
    scored = diagnosed.diagnosis.search.scored
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
        for j in scored[:_SHOWN]
    )
    headers = ("candidate", "in the catalogue", "explains", "not absorbed", "p-value")
    return Block("Candidates", (text, Table(headers, rows, text_columns=2)), "diagnosis_scores")


def absorbed_block(diagnosed: Diagnosed) -> Block:
    """Causes that geometry absorbs in these data, and causes that were not searched for at all."""
    search = diagnosed.diagnosis.search
    hidden = [candidate.what.label for candidate, _ in search.absorbed]
    faint = [j.candidate.what.label for j in search.scored if j.candidate.named and j.rho < _FAINT]
    items: list[str | Facts | Table] = []
    if hidden:
        items.append(
            f"Not identifiable in these data, as they act like lengths and angles of the arm: {_list(hidden)}. They "
            "are absorbed, not absent; wider joint ranges reveal them."
        )
    if faint:
        items.append(f"Hardly identifiable, as geometry absorbs more than nine tenths of them: {_list(faint)}.")
    lacking = missing_inputs(diagnosed.residuals)
    rows = tuple((what.capitalize(), f"{_kinds(kinds)}; {mend}") for what, mend, kinds in lacking.values())
    if rows:
        items += ["Not searched for, as the files lack the inputs that they depend on:", Facts(rows)]
    if not items:
        items.append("Every cause of the catalogue is identifiable in these data, if it is large enough.")
    return Block("What these data cannot show", tuple(items))


def _kinds(kinds: tuple[str, ...]) -> str:
    return ", ".join(kind.replace("_", " ") for kind in kinds)


def _list(names: list[str]) -> str:
    names = list(dict.fromkeys(names))
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def unknowable_block(diagnosed: Diagnosed) -> Block:
    """What no data of this kind can tell, why, and what would."""
    limits = unknowable(diagnosed.residuals)
    rows = tuple((x.kind.replace("_", " ").capitalize(), f"{sentence(x.reason)} To know: {x.mend}.") for x in limits)
    if not rows:
        return Block("What no data of this kind can show", ("No cause is hidden in principle.",))
    return Block("What no data of this kind can show", (Facts(rows),))
