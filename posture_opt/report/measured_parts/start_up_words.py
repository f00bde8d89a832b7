"""What a report says of rows that are farther off than those before or behind them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.errors import enumerated
from posture_opt.report.measured_parts.error_table import mm
from posture_opt.report.text.words import p_words

if TYPE_CHECKING:
    from posture_opt.calibration.scatter_change import ScatterChange
    from posture_opt.calibration.start_up import StartUp


def start_up_lead(found: StartUp | None) -> tuple[str, ...]:
    """How far off the first rows are and what to do about it; nothing where they are like the others."""
    if found is None:
        return ()
    elsewhere = "" if found.spread else ", or where the postures begin at an end of the range"
    taken = "" if found.seconds is None else f" ({found.seconds / 60:.0f} min)"
    return (
        f"The first {found.rows} rows{taken} are off by {mm(found.rms)} mm RMS, all others by {mm(found.rest)} mm "
        f"({p_words(found.p_value)}), as while an arm or an instrument warms up{elsewhere}{_warming_words(found)}: "
        "measure them again on the warm arm before leaving any out.",
    )


def _warming_words(found: StartUp) -> str:
    """By how much the temperature rose in these rows and in the others, where it is logged."""
    if found.warming is None:
        return ""
    first, rest = (f"{rise:+.1f} K" for rise in found.warming)
    return f" (the temperature that was logged changed by {first} in them and by {rest} in all others)"


def scatter_change_lead(found: ScatterChange | None) -> tuple[str, ...]:
    """From which line on errors are of another size, and what to look at; nothing where they are not."""
    if found is None:
        return ()
    verb = "is" if len(found.points) == 1 else "are"
    touched = f", where {enumerated(found.points)} {verb} touched," if found.points else ""
    return (
        f"From line {found.line} on{touched} the rows are off by {mm(found.after)} mm RMS, before by "
        f"{mm(found.before)} mm ({p_words(found.p_value)}): was something moved, loosened or changed there? If so, "
        "leave these rows out and diagnose again.",
    )
