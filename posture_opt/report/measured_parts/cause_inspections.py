"""What to look at on the arm for each cause of a diagnosis, in a line of mechanics."""

from __future__ import annotations

from itertools import pairwise, zip_longest
from typing import TYPE_CHECKING

from posture_opt.calibration.assumptions.geometric_deviation import GeometricDeviation
from posture_opt.errors import enumerated
from posture_opt.report.measured_parts.causes_table import CERTAIN, determined_geometry, number_of
from posture_opt.report.text.blocks import Facts
from posture_opt.units import ERROR_UNITS, plus_minus

if TYPE_CHECKING:
    from collections.abc import Sequence

    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis

_MANUFACTURING_TOLERANCES = {"rad": 5e-3, "m": 5e-3}  # rad, m, of new arms; a choice of taste
_CHECK_ZERO = "Was the joint set to zero anew, its encoder or drive replaced? Compare its reference with the file."
_CHECK_LINK = (
    "Compare with the maker's calibration in the controller, then the type of the arm with the file; then look for a "
    "link that is bent or seated askew."
)
_TARGET = "{target}"  # in place of the joint in texts that are compared


def inspections(found: Diagnosis, findings: Sequence[Finding]) -> tuple[Facts, ...]:
    """What to look at on the arm for some causes, each line with their numbers; nothing for none."""
    texts = inspections_by_text(found, findings).items()
    return (Facts(tuple((f"Look at ({', '.join(numbers)})", words) for words, numbers in texts)),) if texts else ()


def inspection(found: Diagnosis, finding: Finding) -> str:
    """What to look at for one cause; of the geometry also the correction that is hardest to build."""
    text = _by_both_ends(found, finding.inspect(found.problem.robot))
    if finding.kind != "geometry" or (largest := _largest_correction(found)) is None:
        return text
    deviation, size, check = largest
    end = "more than arms are built with" if check else "as arms are built"
    end += ": compare its reference with the file" if not check and deviation.moved_joint else ""
    return f"{text}; largest certain correction: {size}, {end}"


def _largest_correction(found: Diagnosis) -> tuple[GeometricDeviation, str, str] | None:
    """The certain correction of the geometry that is hardest to build, the same in words, and what to check.

    Nothing is to be checked where arms are built so, within the error of the correction. None where none is certain.
    """
    every = [(p, x, std) for p, x, std in determined_geometry(found) if abs(x) > CERTAIN * std]
    if not every:
        return None
    sizes = [(abs(x) - CERTAIN * std) / _MANUFACTURING_TOLERANCES[p.unit] for p, x, std in every]
    sure, (largest, x, std) = max(zip(sizes, every, strict=True), key=lambda pair: pair[0])
    deviation, size = GeometricDeviation.of(largest), plus_minus(x, std, *ERROR_UNITS[largest.unit])
    check = _CHECK_ZERO if largest.name.endswith(".theta") else _CHECK_LINK
    noun = _by_both_ends(found, deviation.noun)
    return deviation, f"{noun} ({largest.name}), {size}", "" if sure <= 1 else check


def _by_both_ends(found: Diagnosis, text: str) -> str:
    """A text in which a link is named by the joints at both of its ends: one looks at the wrong link otherwise."""
    for joint, following in pairwise(found.problem.robot.joint_names):
        text = text.replace(f"link behind {joint}", f"link from {joint} to {following}")
    return text


def bent_link(found: Diagnosis) -> list[Finding]:
    """The geometric causes by which a link may be bent or seated askew: none where arms are built so."""
    largest = _largest_correction(found)
    named = [f for f in found.effects if isinstance(f.cause, GeometricDeviation)]
    return named if largest is not None and largest[2] == _CHECK_LINK else []


def bent_lead(found: Diagnosis) -> tuple[str, ...]:
    """The largest correction of the geometry, where it is a cause and no arm is built with it; else nothing."""
    largest = _largest_correction(found)
    geometry = (f for f in found.effects if isinstance(f.cause, GeometricDeviation))
    named = [f for f in geometry if f.kind not in ("base_frame", "tool_frame")]
    if not named or largest is None or not largest[2]:
        return ()
    deviation, size, check = largest
    own = [f for f in named if f.cause in (deviation, GeometricDeviation.of_all())]
    cause = f" (cause {number_of(found, own[0])})" if own else ""
    return (f"First check the geometry{cause}: {size}, more than arms are built with. {check}",)


def inspections_by_text(found: Diagnosis, findings: Sequence[Finding]) -> dict[str, list[str]]:
    """What to look at -> the numbers of the causes that it is for: what is alike of several joints is said once."""
    alike: dict[str, list[tuple[Finding, str]]] = {}
    for finding in findings:
        subject, colon, parts = inspection(found, finding).partition(": ")
        key = colon + parts if colon else subject.replace(finding.target, _TARGET)
        alike.setdefault(key, []).append((finding, subject))
    texts = {}
    for words, those in alike.items():
        text = words.replace(_TARGET, enumerated(finding.target for finding, _ in those))
        subjects = _enumerated_once([subject for _, subject in those]) if words.startswith(": ") else ""
        texts[f"{subjects}{text}"] = [str(number_of(found, finding)) for finding, _ in those]
    return texts


def _enumerated_once(texts: Sequence[str]) -> str:
    """Texts as a list; the words that all of them begin with stand once."""
    words = [text.split() for text in texts]
    same = 0 if len(texts) < 2 else next(i for i, each in enumerate(zip_longest(*words)) if len(set(each)) > 1)
    return enumerated([texts[0], *(" ".join(own[same:]) for own in words[1:])])
