"""What stays open after a diagnosis: structure that no cause explains, and causes that such data cannot show."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.diagnosis.causes.causes import missing_inputs, unknowable_causes
from posture_opt.diagnosis.scores import levels
from posture_opt.errors import enumerated
from posture_opt.statements import Quantity, Statement, state
from posture_opt.statements.quantity import UNLIKELY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.diagnosis.noise.uneven_noise import UnevenErrors

_MIN_IDENTIFIABLE_SHARE = 0.1  # of an effect that geometry leaves: ten times larger it would be as significant
_MAX_NAMES = 12
_TIME = "time"  # the place of residuals that are alike in the order of measuring


def open_statements(found: Diagnosis) -> list[Statement]:
    """What is left unexplained, what to repeat for it, and which causes these data cannot show."""
    return [*_structure(found), *_not_visible(found), *_discrimination(found)]


def _structure(found: Diagnosis) -> list[Statement]:
    """Whether anything is left that no cause explains, how certainly, and where.

    Two tests: whether errors of neighbouring rows are correlated, and whether the model misses poses by more than they
    repeat (lack of fit). Tests that find nothing are left out.
    """
    left = found.adequacy
    if found.verdict != "unexplained":
        return [state("diagnosis.structure-none", p=Quantity(left.p_value, "p"))]
    said, structured = [], bool(found.unexplained) or left.p_value < levels.LACK_OF_FIT_LEVEL
    if structured:
        which = "structure-small" if found.like_noise else "structure"
        said.append(state(f"diagnosis.{which}", left=Quantity(found.errors["extended"].rms)))
    if found.unexplained:
        said.append(state("diagnosis.structure-depends", components=[one.words for one in found.unexplained]))
    order = "the order of the rows" if left.place == _TIME else left.place
    if not found.unexplained and structured and left.place in found.unexplained_places:
        said.append(state("diagnosis.structure-along", order))
    if left.structure < UNLIKELY:
        said.append(state("diagnosis.neighbours-correlated", order, p=Quantity(left.structure, "p")))
    if left.lack_of_fit < UNLIKELY:
        said.append(state("diagnosis.lack-of-fit", p=Quantity(left.lack_of_fit, "p")))
    said += uneven_statements(found.uneven)
    for plan in found.repeat_plans:
        lines = ", ".join(map(str, plan.rows.line))
        said.append(state("diagnosis.repeat-plan", plan.target, lines=lines, times=plan.times))
    said += [state("diagnosis.one-shape", joint, effects=names) for joint, names in _sums(found).items()]
    return said


def uneven_statements(uneven: Sequence[UnevenErrors]) -> list[Statement]:
    """Errors that look like noisy joints or instruments; joints of which repeats say the same share a sentence."""
    alike: dict[tuple[object, ...], list[UnevenErrors]] = {}
    for errors in uneven:
        of_joint = errors.effect.moved_joint and (errors.refuted, errors.still, errors.scatters)
        alike.setdefault((errors.effect.kind, of_joint or errors.effect.target), []).append(errors)
    said = []
    for those in alike.values():
        one = max(those, key=lambda errors: errors.p_value)
        joints = enumerated([errors.effect.target for errors in those])
        several = one.effect.uneven_words.format(target=f"any of {joints}")
        clause = one.effect.uneven_clause if len(those) == 1 else several
        which = "uneven-scatters" if one.scatters else "uneven-refuted" if one.refuted else "uneven"
        which = "uneven-still" if one.still and which == "uneven" else which
        said.append(state(f"diagnosis.{which}", joints, clause=clause, p=Quantity(one.p_value, "p")))
    return said


def _sums(found: Diagnosis) -> dict[str, list[str]]:
    """Joints on which several slow curves are needed at once, each with the names of its effects."""
    slow: dict[str, list[str]] = {}
    for _, finding in found.fitted_effects:
        if finding.effect is not None and finding.effect.slow:
            slow.setdefault(finding.target, []).append(finding.cause.title)
    return {joint: names for joint, names in slow.items() if len(names) > 1}


def _not_visible(found: Diagnosis) -> list[Statement]:
    """Causes that geometry absorbs in these data, that were not searched for, or that no such data can show."""
    said, search = [], found.search
    absorbed = {candidate.what.label for candidate, _ in search.absorbed}
    faint = {j.candidate.what.label for j in search.scored if j.candidate.named and j.rho < _MIN_IDENTIFIABLE_SHARE}
    for id, names in (("absorbed", absorbed), ("faint", faint)):
        if names:
            shown = sorted(names)[:_MAX_NAMES]
            more = [f"{len(names) - len(shown)} more"] if len(shown) < len(names) else []
            said.append(state(f"diagnosis.{id}", causes=[*shown, *more]))
    for key, (what, hint, kinds) in missing_inputs(found.model.residuals).items():
        id = "not-varied" if getattr(found.request.data, key, None) is not None else "not-searched"
        lacking = [kind.replace("_", " ") for kind in kinds]
        said.append(state(f"diagnosis.{id}", what, kinds=lacking, hint=hint))
    for limit in unknowable_causes(found.model.residuals):
        kind, hint = limit.kind.replace("_", " "), limit.hint.rstrip(".")
        said.append(state("diagnosis.unknowable", kind, reason=limit.reason.rstrip("."), hint=hint))
    return said


def _discrimination(found: Diagnosis) -> list[Statement]:
    """How to read the table of pairs of causes, and the postures that discriminate them."""
    plan = found.split
    if plan is None:
        return []
    said = [state("diagnosis.split-read")]
    if any(split.count is None for pairs in plan.pairs.values() for split in pairs):
        said.append(state("diagnosis.split-impossible"))
    return [*said, *([state("diagnosis.split-caution")] if len(plan.rows) else [])]
