"""What the effects of a problem file that move nothing do to its sources of error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from posture_opt.errors import InputError, Issue
from posture_opt.robot.robot import Robot
from posture_opt.uncertainty.sources import Sources, covariance_issues

if TYPE_CHECKING:
    from posture_opt.model.effects import CatalogueEntry
    from posture_opt.uncertainty.uncertainty_section import MeasurementSpec


def noisy_sources(sources: Sources, robot: Robot, effects: Sequence[CatalogueEntry]) -> Sources:
    """The sources with the scatter that effects add from visit to visit, and the correlations that they state.

    Raises:
        InputError: a correlation of errors without a σ, stated twice, or impossible beside the others; keys from the
            top of the file.
    """
    from posture_opt.model.effects import NoiseEffect

    issues: list[Issue] = []
    for index, effect in enumerate(effects):
        if not isinstance(effect, NoiseEffect):
            continue
        scatter = effect.scatter(robot)
        sources = sources.plus(Sources.scattering(scatter)) if scatter else sources
        for a, b, rho in effect.correlation:
            fault = _pair_fault(sources, a, b)
            if fault is not None:
                issues.append(replace(fault, key=("effects", index), value=effect.name))
                continue
            sources = _correlated(sources, a, b, rho)
            contradictions = covariance_issues(sources.names, sources.constant)
            issues += [replace(issue, key=("effects", index), value=effect.name) for issue in contradictions]
    if issues:
        raise InputError(issues)
    return sources


def measurement_issues(stated: MeasurementSpec | None, effects: Sequence[CatalogueEntry]) -> list[Issue]:
    """Effects that change an instrument's σ where none is stated."""
    from posture_opt.model.effects import NoiseEffect

    if stated is not None and stated.position:
        return []
    return [
        Issue(
            f"{effect.name} changes the σ of the instrument, and none is stated", ("effects", index), effect.kind,
            "add uncertainty: {measurement: {position: 0.05 mm}}",
        )
        for index, effect in enumerate(effects)
        if isinstance(effect, NoiseEffect) and effect.of_stated
    ]  # fmt: skip


def noise_notes(effects: Sequence[CatalogueEntry]) -> tuple[str, ...]:
    """Which effects have no part in the spread of the tool point."""
    from posture_opt.model.effects import NoiseEffect

    kinds = [e.kind for e in effects if isinstance(e, NoiseEffect) and not e.of_arm]
    if not kinds:
        return ()
    return (f"{', '.join(dict.fromkeys(kinds))}: of the measurement alone, no part of the spread of the tool point",)


def of_a_type(effect: CatalogueEntry) -> bool:
    """Whether an effect says how robots of a type differ: once one was measured, the errors of that one are known."""
    from posture_opt.model.effects import NoiseEffect

    return isinstance(effect, NoiseEffect) and bool(effect.correlation)


def _pair_fault(sources: Sources, a: str, b: str) -> Issue | None:
    at = {name: k for k, name in enumerate(sources.names)}
    for name in (a, b):
        if name not in at or sources.constant[at[name], at[name]] <= 0:
            return Issue(f"'{name}' has no σ to be correlated", mend=f"add uncertainty: {{sigma: {{{name}: 0.1 mm}}}}")
    if sources.constant[at[a], at[b]] != 0:
        return Issue(f"the correlation of {a} and {b} is stated twice", mend="keep one, here or under uncertainty")
    return None


def _correlated(sources: Sources, a: str, b: str, rho: float) -> Sources:
    i, j = sources.names.index(a), sources.names.index(b)
    covariance = sources.covariance.copy()
    variance = sources.constant
    covariance[i, j] = covariance[j, i] = sources.covariance[i, j] + rho * (variance[i, i] * variance[j, j]) ** 0.5
    return replace(sources, covariance=covariance)
