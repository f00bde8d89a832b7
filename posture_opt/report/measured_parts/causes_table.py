"""All causes of a diagnosis on one screen: size, share of the error, and what to look at on the arm."""

from __future__ import annotations

from itertools import zip_longest
from typing import TYPE_CHECKING

from posture_opt.diagnosis.causes.causes import tool_shifts
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.errors import enumerated
from posture_opt.report.measured_parts.diagnosis_sizes import headline_of, largest_scatter
from posture_opt.report.measured_parts.error_table import mm
from posture_opt.report.text.blocks import Facts, Table
from posture_opt.report.text.units_text import count, percent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from posture_opt.calibration.estimation.parameters import Parameter
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.model.effects import Cause

FILE = "split_measurements.csv"
"""The table of measurements that discriminate between causes."""
_MAX_INSPECTED = 3  # causes whose parts are named
_MAX_CAUSES = 12  # that a screen has room for
_TARGET = "{target}"  # in place of the joint in texts that are compared
_MAX_OPEN_RATIO = 10.0  # times the standard error among what the data determine: the rest is open
_DIFFERENT = 1.96  # standard errors
_MAX_RIVALS = 2  # causes that one could be confused with, by name


def causes_table(found: Diagnosis) -> Table:
    """Every cause with its size and the share of the RMS error on held-out rows that it removes.

    The share is that which is lost without it, everything else fitted again. Scatter removes no error. Between them
    is the largest shift of the tool point in the data [mm].
    """
    rows, views = [], []
    for number, finding in enumerate(found.effects, 1):
        gain = "" if finding.noise is not None else percent(finding.gain)
        rows.append((f"{number}. {finding.cause.label}", _size(found, finding), _largest_shift(found, finding), gain))
        views.append(view_key(found, finding))
    headers = ("cause", "size", "at the tool", "RMS drop")
    return Table(headers, tuple(rows), views=tuple(views), least=_MAX_CAUSES)


def _largest_shift(found: Diagnosis, finding: Finding) -> str:
    """The largest shift of the tool point in the data [mm]; of a joint that scatters, its largest σ.

    Empty of causes that move nothing, or by an open size.
    """
    if not finding.determined:
        return ""
    if finding.noise is not None and finding.noise.moved_joint:
        return f"σ {mm(largest_scatter(found, finding.noise))} mm"
    return "" if finding.place is None else f"{mm(float(tool_shifts(found.model, finding)[0].max()))} mm"


def _size(found: Diagnosis, finding: Finding) -> str:
    """The size with its standard error; that it is open, or how many parameters differ, where there is no number."""
    if not finding.determined:
        return "not determined"
    if finding.open_part is not None:
        return f"{headline_of(found, finding)}, {count(len(finding.open_part.size_parts), 'line')} open"
    return headline_of(found, finding) or (_differing(found) if finding.kind == "geometry" else "several parameters")


def _differing(found: Diagnosis) -> str:
    """How many of the geometric parameters that the data determine differ from the file, by 1.96 standard errors."""
    every = determined_geometry(found)
    return f"{sum(abs(x) > _DIFFERENT * std for _, x, std in every)} of {count(len(every), 'parameter')} differ"


def determined_geometry(found: Diagnosis) -> list[tuple[Parameter, float, float]]:
    """The geometric parameters of the arm with its effects that the data determine, with x and its standard error.

    Left out are those whose standard error is mostly what the data leave open.
    """
    calibration, model = found.calibration, found.model
    rows = zip(calibration.parameters, model.x, model.std, calibration.std, strict=False)
    return [
        (p, float(x), float(std))
        for p, x, std, whole in rows
        if p.group == "geometry"
        and 0 < whole < _MAX_OPEN_RATIO * std  # what the data leave open has a small part in what they determine
    ]


def look_at(found: Diagnosis) -> tuple[Facts, ...]:
    """What to look at on the arm for the first causes of a known size, and what else a cause could be.

    Nothing without such causes.
    """
    known = [f for f in found.effects if f.determined][:_MAX_INSPECTED]
    rows = [(f"Look at ({', '.join(numbers)})", words) for words, numbers in _inspections(found, known).items()]
    rows += [
        (f"Could be ({number_of(found, f)})", f"{rivals_of(f)} instead") for f in found.effects if f.confounded_with
    ]
    rows += _next(found)
    return (Facts(tuple(rows)),) if rows else ()


def _next(found: Diagnosis) -> list[tuple[str, str]]:
    """The postures that discriminate causes from their rivals; nothing where none are planned."""
    plan = found.split
    if plan is None or not len(plan.rows):
        return []
    which = f"{count(len(plan.rows), 'posture')} that refute the wrong cause ({FILE}, by --out DIR)"
    return [("Measure next", which)]


def _inspections(found: Diagnosis, findings: Sequence[Finding]) -> dict[str, list[str]]:
    """What to look at -> the numbers of the causes that it is for: what is alike of several joints is said once."""
    alike: dict[str, list[tuple[Finding, str]]] = {}
    for finding in findings:
        subject, colon, parts = finding.inspect(found.problem.robot).partition(": ")
        key = colon + parts if colon else subject.replace(finding.target, _TARGET)
        alike.setdefault(key, []).append((finding, subject))
    texts = {}
    for words, those in alike.items():
        text = words.replace(_TARGET, enumerated(finding.target for finding, _ in those))
        subjects = _enumerated_once([subject for _, subject in those]) if words.startswith(": ") else ""
        texts[f"{subjects}{text}"] = [str(number_of(found, finding)) for finding, _ in those]
    return texts


def _enumerated_once(texts: Sequence[str]) -> str:
    """Texts as a list; the words that all of them begin with stand once."""
    words = [text.split() for text in texts]
    same = 0 if len(texts) < 2 else next(i for i, each in enumerate(zip_longest(*words)) if len(set(each)) > 1)
    return enumerated([texts[0], *(" ".join(own[same:]) for own in words[1:])])


def rivals_of(finding: Finding, most: int = _MAX_RIVALS) -> str:
    """The causes that the data cannot tell from a finding: the first of many by name, and how many more there are.

    Errors without a name are counted where there are causes that have one.
    """
    named = dict.fromkeys(rival.label for rival in finding.confounded_with if not isinstance(rival, UnnamedComponent))
    others = dict.fromkeys(rival.words for rival in finding.confounded_with if isinstance(rival, UnnamedComponent))
    labels = [*named, *others]
    shown = labels[: min(most, len(named)) or most] if most < len(labels) else labels
    more = len(labels) - len(shown)
    return enumerated([*shown, *([f"{more} more"] if more else [])], "or")


def rival_words(rival: Cause) -> str:
    """The label of a rival; one without a name in words, as its label says it to those only who know the search."""
    return rival.words if isinstance(rival, UnnamedComponent) else rival.label


def number_of(found: Diagnosis, finding: Finding) -> int:
    """The number of a cause in the table."""
    return found.effects.index(finding) + 1


def view_key(found: Diagnosis, finding: Finding) -> str:
    """By which the interactive view knows a cause."""
    return f"cause-{number_of(found, finding)}"
