"""Notes on numbers that are allowed and yet look like a slip of the unit."""

from __future__ import annotations

from posture_opt.robot.robot import Repeatability, Robot
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.uncertainty_section import UncertaintySpec

FAR = 20.0
"""So many times off the data sheet a stated scatter is remarked on: an arm may be worn, or badly calibrated."""


def plausibility_notes(robot: Robot, stated: UncertaintySpec, sources: Sources) -> tuple[str, ...]:
    """What stands far off the robot's data sheet, in sentences for the report; nothing where there is no data sheet."""
    sheet = robot.repeatability
    if sheet is None:
        return ()
    notes = []
    if stated.repeatability is not None and _far(stated.repeatability / sheet.value):
        given, times = f"{stated.repeatability * 1e3:g} mm", _times(stated.repeatability / sheet.value)
        notes.append(
            f"the stated repeatability {given} is {times} the data sheet's {_sheet(sheet)}: is its unit right?"
        )
    own = {robot.factors[i].parameter for i in robot.driven}
    named = sources.names if stated.repeatability is None and stated.covariance else tuple(stated.sigma)
    if own & set(named):
        notes += _joint_notes(
            robot, sheet, stated, {n: s for n, s in _sigmas(sources).items() if n in own & set(named)}
        )
    return tuple(notes)


def _joint_notes(robot: Robot, sheet: Repeatability, stated: UncertaintySpec, sigma: dict[str, float]) -> list[str]:
    from posture_opt.uncertainty.repeatability import joint_sigmas

    usual = _sigmas(joint_sigmas(robot, sheet.value))
    ratios = {name: value / usual[name] for name, value in sigma.items() if name in usual and value > 0}
    # A covariance is what a calibration leaves unknown, which many rows make as small as one likes.
    far = {name: ratio for name, ratio in ratios.items() if ratio > FAR or (_far(ratio) and name in stated.sigma)}
    if not far:
        return []
    name = max(far, key=lambda name: max(far[name], 1 / far[name]))
    given = f", {stated.sigma[name]}," if name in stated.sigma else ""
    more = f" (and {len(far) - 1} more are far off too)" if len(far) > 1 else ""
    return [
        f"the standard deviation of {name}{given} is {_times(far[name])} what the data sheet's repeatability "
        f"{_sheet(sheet)} leaves it{more}: is its unit right?"
    ]


def _sigmas(sources: Sources) -> dict[str, float]:
    return dict(zip(sources.names, map(float, sources.sigma), strict=True))


def _far(ratio: float) -> bool:
    return not 1 / FAR <= ratio <= FAR


def _times(ratio: float) -> str:
    return f"{float(f'{ratio:.2g}'):g} times" if ratio > 1 else f"1/{float(f'{1 / ratio:.2g}'):g} of"


def _sheet(sheet: Repeatability) -> str:
    return f"{sheet.value * 1e3:g} mm"
