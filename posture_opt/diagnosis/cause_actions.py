"""What is to be done about each cause of a diagnosis, and why: data that the report shows and programs act on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Literal

from posture_opt.diagnosis.geometry_corrections import CERTAIN
from posture_opt.model.effects import CyclicError, InstrumentField
from posture_opt.model.effects.base.joint_effect import CATALOGUE_AMPLITUDE, Harmonic

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.causes.sessions import SecondSession

_EQUAL_CYCLES_TOLERANCE = 0.05  # of the cycles of a line, by which those of other joints are the same
_MIN_SHARED_KINDS = 2  # in which two joints err alike by more than chance

Action = Literal["inspect", "compensate", "check_instrument", "confirm", "measure", "ignore"]
"""``inspect`` the part; ``compensate`` by corrected commands and open nothing; ``check_instrument`` first; ``confirm``
on other rows what a test file does not show; ``measure`` more where the size is open; ``ignore`` what no arm has."""
Reason = Literal["size_of_catalogues", "one_type", "unconfirmed", "implausible", "like_instrument", "open_size", ""]


@dataclass(frozen=True)
class CauseAction:
    """What is to be done about one cause, and why it is not simply looked at.

    Args:
        cycles: range of cycles per revolution in which errors of several joints repeat, where that is the reason.
    """

    action: Action
    reason: Reason = ""
    cycles: tuple[float, float] = (0.0, 0.0)


def cause_actions(causes: Sequence[Finding], test: SecondSession | None, touches: bool) -> tuple[CauseAction, ...]:
    """The action for each cause, in their order.

    Args:
        causes: of one diagnosis; ``test`` a test file that they are held against.
        touches: whether the data are touched points, which no instrument reads.
    """
    sure = [f for f in causes if f.determined]
    alike = {
        id(finding): cycles
        for cycles, group in of_one_type([f for f in sure if f.plausible]).items()
        for finding in group
    }
    return tuple(_action(finding, alike.get(id(finding)), test, touches) for finding in causes)


def _action(
    finding: Finding, cycles: tuple[float, float] | None, test: SecondSession | None, touches: bool
) -> CauseAction:
    """The action for one cause; the first reason that applies counts."""
    if not finding.determined:
        return CauseAction("measure", "open_size")
    if not finding.plausible:
        return CauseAction("ignore", "implausible")
    if cycles is not None:
        return CauseAction("compensate", "one_type", cycles)
    if _as_in_catalogues(finding):
        return CauseAction("compensate", "size_of_catalogues")
    if unconfirmed(finding, test):
        return CauseAction("confirm", "unconfirmed")
    if not touches and any(isinstance(rival, InstrumentField) for rival in finding.confounded_with):
        return CauseAction("check_instrument", "like_instrument")
    return CauseAction("inspect")


def unconfirmed(finding: Finding, test: SecondSession | None) -> bool:
    """Whether it is not sure that a cause predicts the test file better; false of what is not tested there."""
    if test is None or finding.place is None or not any(test.gains):
        return False
    gain = test.gains[finding.place]
    return gain is not None and gain.low <= 0


def _as_in_catalogues(finding: Finding) -> bool:
    """Whether it is a periodic error of the size that new gears have, within its own error."""
    cause, rms = finding.cause, finding.sizes.rms
    if not isinstance(cause, Harmonic):
        return False
    size, std = cause.plausible_size(finding.sizes)
    if rms is not None and len(cause.frequencies) > 1:
        size, std = (math.sqrt(2) * value for value in rms)
    return size - (CERTAIN * std if math.isfinite(std) else 0.0) <= CATALOGUE_AMPLITUDE


def of_one_type(findings: Sequence[Finding]) -> dict[tuple[float, float], list[Finding]]:
    """Range of cycles per revolution -> errors of several joints that repeat about as often, as one type of drive.

    Of each joint the strongest band counts. Two are alike where no more is between them than the ranges of both joints
    tell apart.
    """
    bands = []
    for finding in findings:
        error = finding.cause
        if isinstance(error, CyclicError) and (strongest := error.bands(finding.sizes)[:1]):
            cycles = [error.lines[i] for i in strongest[0]]
            bands.append((min(cycles), max(cycles), finding))
    groups: list[list[tuple[float, float, Finding]]] = []
    for band in sorted(bands, key=lambda band: band[0]):
        if groups and any(_alike(one, band) for one in groups[-1]):
            groups[-1].append(band)
        else:
            groups.append([band])
    several = [group for group in groups if len(group) > 1]
    return {
        (min(low for low, _, _ in group), max(high for _, high, _ in group)): [finding for _, _, finding in group]
        for group in several
    }


def _alike(one: tuple[float, float, Finding], other: tuple[float, float, Finding]) -> bool:
    """Whether two bands of cycles per revolution are the same for all that the ranges of their joints tell."""
    (_, high, first), (low, _, second) = one, other
    apart = min(first.sizes.resolution, second.sizes.resolution)
    return low - high < max(_EQUAL_CYCLES_TOLERANCE * high, apart)


def shared_by_neighbours(
    causes: Sequence[Finding], names: Sequence[str]
) -> list[tuple[tuple[str, str], list[Finding]]]:
    """Neighbouring joints, of these names, that err alike in several ways at once, and these causes in pairs.

    Alike is a size of the same kind and sign that is the same within 1.96 of its standard errors, and not zero.
    """
    shared = []
    for joints in pairwise(names):
        own = [[f for f in causes if f.determined and f.target == joint and f.effect] for joint in joints]
        pairs = [(a, b) for a, b in combinations((*own[0], *own[1]), 2) if a.target != b.target and _of_one_size(a, b)]
        if len(pairs) >= _MIN_SHARED_KINDS:
            shared.append((joints, [finding for pair in pairs for finding in pair]))
    return shared


def _of_one_size(one: Finding, other: Finding) -> bool:
    """Whether two findings are of one kind that is no line of a spectrum, and of sizes that agree and are not zero."""
    if one.kind != other.kind or one.cause.spectral_lines:
        return False
    (x, u), (y, v) = (f.sizes.rms or f.effect.plausible_size(f.sizes) for f in (one, other) if f.effect)
    certain = min(abs(x) - CERTAIN * u, abs(y) - CERTAIN * v) > 0
    return certain and abs(x - y) < CERTAIN * math.hypot(u, v)
