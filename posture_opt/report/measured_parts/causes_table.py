"""All causes of a diagnosis on one screen: size, what geometry could not imitate of it, and share of the error."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.diagnosis.causes.causes import tool_shifts
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.errors import enumerated
from posture_opt.numerics import rms
from posture_opt.report.measured_parts.diagnosis_sizes import headline_of, largest_scatter
from posture_opt.report.measured_parts.error_table import mm
from posture_opt.report.text.blocks import Table
from posture_opt.statements.notation import count, percent

if TYPE_CHECKING:
    from posture_opt.calibration.estimation.parameters import Parameter
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.causes.sessions import Gain
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.model.effects import Cause

CERTAIN = 1.96
"""Standard errors that a certain difference has, at 95 %."""
_MAX_CAUSES = 16  # that a screen has room for
_HOLDS = "holds"
_MAX_OPEN_RATIO = 10.0  # times the standard error among what the data determine: the rest is open
_MAX_HELD_RATIO = 3.0  # times its standard error is that by the rows alone, of what no tolerance holds
_MAX_RIVALS = 2  # causes that one could be confused with, by name


def causes_table(found: Diagnosis) -> Table:
    """Every cause with its size and the share of the RMS error on held-out rows that it removes.

    The share is that which is lost without it, everything else fitted again. Scatter removes no error. Between them is
    the shift of the tool point in the data that geometry could not imitate, RMS [mm]; behind it the share on a test
    file, where there is one.
    """
    rows, views = [], []
    for number, finding in enumerate(found.effects, 1):
        gain = "" if finding.noise is not None else percent(finding.gain)
        like = "" if finding.plausible else "looks like "
        row = (f"{number}. {like}{finding.label}", _size(found, finding), shift_at_tool(found, finding), gain)
        rows.append((*row, *_elsewhere(found, finding)))
        views.append(view_key(found, finding))
    headers = ("cause", "size", "at the tool", "RMS drop", *_elsewhere_header(found))
    return Table(headers, tuple(rows), views=tuple(views), least=_MAX_CAUSES)


def _elsewhere_header(found: Diagnosis) -> tuple[str, ...]:
    """The header of what causes bring on a test file; none without one that effects are tested on."""
    return ("on the test file",) if found.test is not None and any(found.test.gains) else ()


def _elsewhere(found: Diagnosis, finding: Finding) -> tuple[str, ...]:
    """The share that a cause removes on the test file, and that it is not significant there."""
    if not _elsewhere_header(found):
        return ()
    if found.test is None or finding.place is None:
        return ("",)
    gain, verdict = gain_elsewhere(found.test.gains[finding.place])
    return (gain if verdict == _HOLDS else f"{gain}, {verdict}",)


def gain_elsewhere(gain: Gain | None) -> tuple[str, str]:
    """What an effect brings on the other file, and whether that can be sure."""
    if gain is None:
        return "not tested", "left out"
    sure = "not significant" if gain.value > 0 else "no gain"
    return percent(gain.value), _HOLDS if gain.low > 0 else sure


def shift_at_tool(found: Diagnosis, finding: Finding) -> str:
    """The shift of the tool point in the data that geometry could not imitate, RMS [mm]; of scatter, its largest σ.

    Empty of causes that move nothing, or by an open size.
    """
    if not finding.determined:
        return ""
    if finding.noise is not None and finding.noise.moved_joint:
        return f"σ {mm(largest_scatter(found, finding.noise))} mm"
    return "" if finding.place is None else f"{mm(rms(tool_shifts(found.model, finding)[1]))} mm"


def _size(found: Diagnosis, finding: Finding) -> str:
    """The size with its standard error; that it is open, or how many parameters differ, where there is no number."""
    if not finding.determined:
        return "not determined"
    if finding.open_part is not None:
        return f"{headline_of(finding)} + {len(finding.open_part.size_parts)} open"
    return headline_of(finding) or (_differing(found) if finding.kind == "geometry" else "several parameters")


def _differing(found: Diagnosis) -> str:
    """How many of the geometric parameters that the data determine differ from the file, by 1.96 standard errors."""
    every = determined_geometry(found)
    return f"{sum(abs(x) > CERTAIN * std for _, x, std in every)} of {count(len(every), 'parameter')} differ"


def determined_geometry(found: Diagnosis) -> list[tuple[Parameter, float, float]]:
    """The geometric parameters of the arm with its effects that the data determine, with x and its standard error.

    Left out are those whose standard error is mostly what the data leave open, or what a tolerance of parts holds: a
    zero of the last joint but one and the length behind it act alike, and the tighter tolerance decides which it is.
    """
    calibration, model = found.calibration, found.model
    rows = zip(calibration.parameters, model.x, model.std, calibration.std, model.held_by_prior, strict=False)
    return [
        (p, float(x), float(std))
        for p, x, std, whole, held in rows
        if p.group == "geometry"
        and 0 < whole < _MAX_OPEN_RATIO * std  # what the data leave open has a small part in what they determine
        and held < _MAX_HELD_RATIO
    ]


def unconfirmed(found: Diagnosis, finding: Finding) -> bool:
    """Whether it is not sure that a cause predicts the test file better; false of what is not tested there."""
    if found.test is None or finding.place is None or not any(found.test.gains):
        return False
    gain = found.test.gains[finding.place]
    return gain is not None and gain.low <= 0


def rivals_of(finding: Finding, most: int = _MAX_RIVALS) -> str:
    """The causes that the data cannot tell from a finding: the first of many by name, and how many more there are.

    Errors without a name are counted where there are causes that have one.
    """
    named = dict.fromkeys(rival.label for rival in finding.confounded_with if not isinstance(rival, UnnamedComponent))
    others = dict.fromkeys(rival.words for rival in finding.confounded_with if isinstance(rival, UnnamedComponent))
    labels = [*named, *others]
    shown = labels[: min(most, len(named)) or most] if most + 1 < len(labels) else labels  # "1 more" is as long
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
