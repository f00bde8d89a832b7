"""Words on an instrument that scatters more than the arm errs, and on how sure it is that calibration helps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.calibration.sure_gain import LEAST_PROBABILITY
from posture_opt.report.text.units_text import angle_error, stated_length

if TYPE_CHECKING:
    from posture_opt.calibration.calibration import Calibration
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


def sure_gain_lead(found: Calibration, nominal: bool) -> tuple[str, ...]:
    """How probable it is that the calibrated arm is better, where the instrument is worse than the arm.

    Args:
        nominal: whether the nominal arm is delivered in its place.
    """
    probability, scatter = found.better_than_nominal, found.instrument_scatter
    if nominal and not found.predicts_better:
        return (
            "The nominal arm is kept: the calibrated one predicts rows held out from the fit no better. More rows or a "
            "finer instrument show whether there is anything to correct.",
        )
    if probability is None or scatter is None or not scatter.exceeds:
        return ()
    percent = f"{min(100 * probability, 99.9):.3g} %"
    if not nominal:
        return (f"The calibrated arm is nearer to the true one than the nominal arm with a probability of {percent}.",)
    return (
        f"The nominal arm is kept: the calibrated one is nearer to the true arm with a probability of only {percent}, "
        f"and {100 * LEAST_PROBABILITY:.0f} % are asked for. More rows or a finer instrument decide it.",
    )


def _size(value: float, unit: str) -> str:
    """A length, or an angle in mrad."""
    return stated_length(value) if unit == "m" else angle_error(value, 2)
