"""All causes of a diagnosis on one screen: size, share of the error, and what to look at on the arm."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.report.measured_parts.diagnosis_sizes import headline_of
from posture_opt.report.text.blocks import Facts, Table
from posture_opt.report.text.units_text import percent

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis

_MAX_INSPECTED = 3  # causes whose parts are named


def causes_table(found: Diagnosis) -> Table:
    """Every cause with its size and the share of the RMS error on held-out rows that it removes.

    The share is that which is lost without it, everything else fitted again. Scatter removes no error.
    """
    rows, views = [], []
    for number, finding in enumerate(found.effects, 1):
        gain = "" if finding.noise is not None else percent(finding.gain)
        rows.append((f"{number}. {finding.cause.label}", _size(found, finding), gain))
        views.append(view_key(found, finding))
    return Table(("cause", "size", "RMS reduced by"), tuple(rows), views=tuple(views))


def _size(found: Diagnosis, finding: Finding) -> str:
    """The size with its standard error; that it is open, or of many parameters, where there is no number."""
    if not finding.determined:
        return "not determined"
    return headline_of(found, finding) or ("many parameters" if finding.kind == "geometry" else "several parameters")


def look_at(found: Diagnosis) -> tuple[Facts, ...]:
    """What to look at on the arm, for the first causes of a known size; nothing without one."""
    known = [f for f in found.effects if f.determined][:_MAX_INSPECTED]
    rows = tuple((f"Look at ({found.effects.index(f) + 1})", f.inspect(found.problem.robot)) for f in known)
    return (Facts(rows),) if rows else ()


def view_key(found: Diagnosis, finding: Finding) -> str:
    """By which the interactive view knows a cause."""
    return f"cause-{found.effects.index(finding) + 1}"
