"""Notes of a problem for its reports: what was assumed, and numbers that look like a slip of the unit."""

from __future__ import annotations

from collections.abc import Sequence

from posture_opt.model.arm import Arm
from posture_opt.model.effects import CatalogueEntry, NoiseEffect
from posture_opt.robot.robot import Repeatability, Robot
from posture_opt.uncertainty.repeatability import joint_sigmas
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.uncertainty_section import UncertaintySpec

FAR = 20.0
"""So many times off the data sheet a stated scatter is remarked on: an arm may be worn, or badly calibrated."""


def problem_notes(
    arm: Arm, stated: UncertaintySpec, sources: Sources, effects: Sequence[CatalogueEntry]
) -> tuple[str, ...]:
    """All notes of a problem: on its sources, on numbers that are far off, on the inputs of effects, on noise."""
    return (
        *sources.notes,
        *plausibility_notes(arm.robot, stated, sources),
        *input_notes(arm),
        *noise_notes(effects),
    )


def input_notes(arm: Arm) -> tuple[str, ...]:
    """What was assumed of the inputs of the effects."""
    unknown = sorted({effect.target for effect in arm.effects if "approach" in effect.needs})
    unknown = [joint for joint in unknown if joint not in arm.inputs.stated]
    notes = []
    if unknown:
        told = f"task: {{approach: {{{unknown[0]}: 1}}}} tells it"
        notes.append(f"from which side {', '.join(unknown)} will arrive is not known: it counts as scatter ({told})")
    left = [effect for effect in arm.effects if not effect.for_planning]
    timed = {effect.kind for effect in left if "time" in effect.needs}
    if timed:
        time = float(arm.inputs.time)
        when = f"{time:g} s after the first measurement" if time else "at its beginning (task: {time: 2 h} tells when)"
        notes.append(f"{', '.join(sorted(timed))}: planned as {when}")
    read = {effect.kind for effect in left} - timed
    if read:
        notes.append(f"{', '.join(sorted(read))}: the place of the task is taken as the instrument reads it")
    return tuple(notes)


def noise_notes(effects: Sequence[CatalogueEntry]) -> tuple[str, ...]:
    """Which effects have no part in the spread of the tool point."""
    kinds = [e.kind for e in effects if isinstance(e, NoiseEffect) and not e.of_arm]
    if not kinds:
        return ()
    return (f"{', '.join(dict.fromkeys(kinds))}: of the measurement alone, no part of the spread of the tool point",)


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
