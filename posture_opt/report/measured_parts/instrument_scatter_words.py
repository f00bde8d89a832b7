"""Words on an instrument that scatters more than the arm errs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.report.text.units_text import angle_error, stated_length

if TYPE_CHECKING:
    from posture_opt.calibration.instrument_scatter import InstrumentScatter


def instrument_scatter_lead(found: InstrumentScatter | None) -> tuple[str, ...]:
    """The first line where the instrument is worse than the arm; nothing elsewhere."""
    if found is None or not found.exceeds:
        return ()
    scatter, arm = (_size(value, found.unit) for value in (found.scatter, found.arm))
    return (
        f"The instrument scatters more than the arm errs: {found.noun} have a scatter of {scatter} a reading, of which "
        f"errors of the nominal arm explain {arm}. The arm stays near nominal wherever the data do not improve it.",
    )


def _size(value: float, unit: str) -> str:
    """A length, or an angle in mrad."""
    return stated_length(value) if unit == "m" else angle_error(value, 2)
