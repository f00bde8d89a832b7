"""The first lines of a report where the data refute what the problem file states as known.

They come before any answer: with a wrong statement all that follows would be wrong too.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.model.effects import JointCoupling
from posture_opt.report.measured_parts.error_table import mm
from posture_opt.units import ERROR_UNITS, number, plus_minus, shown

if TYPE_CHECKING:
    from posture_opt.calibration.assumptions.contradictions import Contradiction
    from posture_opt.calibration.calibration import Calibration

_DIMENSIONS = {"m": "length", "rad": "angle"}
_MAX_LISTED = 3
_WRONG_DISTANCE, _MAX_DISTANCES = 4.0, 3  # σ's from which on a stated distance is doubted, and how many are listed
_MIN_TURN_RAD = math.radians(0.01)  # less is no turn that anyone would correct


def doubts_lead(found: Calibration) -> tuple[str, ...]:
    """What comes before any answer: data that are hardly this arm's, what they refute of the file, runaway frames.

    Each is one line and left out where the data give no reason for it; the most fundamental doubt comes first.
    """
    return (
        *_disagreement(found),
        *_preset(found),
        *(_line(contradiction) for contradiction in found.contradictions),
        *_distances(found),
        *(_away(frame, far) for frame, far in found.far_frames.items()),
        *_implausible(found),
    )


def refuted_of_robots(found: Sequence[Calibration]) -> tuple[str, ...]:
    """What the data of several robots of one type refute, one line each."""
    counts = Counter(c.cause for calibration in found for c in calibration.contradictions)
    return tuple(
        f"For {count} of {len(found)} robots {cause.words}: the value in the file is ignored for them."
        for cause, count in counts.items()
    )


def _disagreement(found: Calibration) -> tuple[str, ...]:
    """Data that no calibration of this arm explains: another robot's, or other joints than the file's.

    Compared are the RMS error that is left and the RMS motion of the tool point in the data [mm].
    """
    if found.disagreement is None:
        return ()
    left, motion = found.disagreement.left, found.disagreement.motion
    text = f"The data disagree with the arm of the file: even calibrated, it misses them by {mm(left)} mm RMS, where "
    text += f"they move by {mm(motion)} mm. Is it another robot's file? Do all joints count in the direction, in the "
    return (f"{text}order and from the zero of the problem file? Treat the results below with caution.",)


def _distances(found: Calibration) -> tuple[str, ...]:
    """Stated distances between touched points that the calibrated arm does not meet, the farthest off first [mm]."""
    errors, names = found.residuals.distance_errors(found.x), found.residuals.data.place_names
    order = [i for i in np.argsort(-np.abs(errors)).tolist() if abs(errors[i]) > _WRONG_DISTANCE]
    lines = []
    for i in order[:_MAX_DISTANCES]:
        a, b, length, sigma = found.residuals.distances[i]
        away, side = abs(float(errors[i])), "longer" if errors[i] > 0 else "shorter"
        lines.append(
            f"The distance of {names[a]} and {names[b]}, stated as {1e3 * length:.6g} mm, comes out {mm(away * sigma)} "
            f"mm {side} ({away:.1f} σ), though the arm gave way to it: check it, as lengths of the arm depend on it."
        )
    return tuple(lines)


def _preset(found: Calibration) -> tuple[str, ...]:
    """Link lengths that are those of another preset, with the RMS position error of both [mm]."""
    other = found.other_preset
    if other is None:
        return ()
    far = sorted(other.lengths, key=lambda name: -abs(other.lengths[name][1] - other.lengths[name][0]))
    which = ", ".join(f"{name} {number(1e3 * other.lengths[name][1], 4)} mm" for name in far[:_MAX_LISTED])
    which += f" and {len(far) - _MAX_LISTED} more" if len(far) > _MAX_LISTED else ""
    text = (
        f"These link lengths are those of a {other.title} ({which}): the uncalibrated arm is off by {mm(other.rms)} mm "
    )
    return (f"{text}RMS with them, and by {mm(other.stated)} mm with those of the file. State preset {other.name}.",)


def _implausible(found: Calibration) -> tuple[str, ...]:
    """The geometry that is farthest off its nominal value, where that is farther than any part is.

    At most three parameters are named, each with its deviation and one standard error [mrad or mm].
    """
    of = found.implausible
    texts = [f"{name} by {plus_minus(x, std, *ERROR_UNITS[unit])}" for name, (x, std, unit) in of.items()]
    if not texts or found.other_preset is not None:  # which says what they are
        return ()
    more = f" and {len(texts) - _MAX_LISTED} more" if len(texts) > _MAX_LISTED else ""
    text = f"Implausibly large deviation from the file: {', '.join(texts[:_MAX_LISTED])}{more}. "
    return (f"{text}Is it the right robot, and are the zeros of its joints those of the file?",)


def _away(frame: str, far: float) -> str:
    """A frame that was found implausibly far [m] from where it can be."""
    of = "from the measured points" if frame == "base" else "from the flange"
    text = f"The {frame} is found {number(far)} m {of}, which is implausible: these data do not determine it. "
    return f"{text}State it, or measure with more different orientations."


def _line(found: Contradiction) -> str:
    """One contradiction: what the file states, by how much it is off, and what was done instead.

    Of a coupling, a standard deviation or a frame; each ends with the gain in RMS [mm] of setting it aside.
    """
    if isinstance(found.cause, JointCoupling):
        return _coupled(found, found.cause)
    if found.sigma:
        ((name, (value, std, unit)),) = found.estimate.items()
        dimension = _DIMENSIONS[unit]
        text = f"The data contradict the standard deviation of {shown(found.sigma, dimension)} that the file states of "
        text += f"{found.cause.target}.{name}: it is off by {shown(value, dimension, std)}. "
        return f"{text}The stated value is ignored here, which {gain_words(found)}."
    frame = found.cause.target
    text = f"The data contradict the {frame} frame that the file states: the {frame} is off by {_off(found)}. "
    return f"{text}It is treated as free here, which {gain_words(found)}. Correct the file, or write '{frame}: free'."


def _coupled(found: Contradiction, coupling: JointCoupling) -> str:
    """A coupling of two joints that the file does not state."""
    ratio, std, _ = found.estimate["ratio"]
    text = f"In these data {coupling.joint} is coupled to {coupling.follows} (ratio {plus_minus(ratio, std)}), which "
    text += f"the file does not state. The coupling is added to the model, which {gain_words(found)}. Log the "
    return f"{text}angle of {coupling.joint} against the link before it, or keep {coupling.kind} in the file."


def gain_words(found: Contradiction) -> str:
    """What setting all contradictions aside brings."""
    return f"reduces the RMS error of the calibrated arm from {mm(found.rms_stated)} mm to {mm(found.rms)} mm"


def _off(found: Contradiction) -> str:
    """How far a frame is off, and how far it is turned where the data determine it.

    The turn is left out below 0.01 deg and below three standard errors.
    """
    shift = [(v, s) for v, s, unit in found.estimate.values() if unit == "m"]
    turn = [(v, s) for v, s, unit in found.estimate.values() if unit == "rad"]
    length, std = _length(shift)
    texts = [plus_minus(length, std, 1e3, "mm")] if shift else []
    angle, error = _length(turn)
    if angle > max(_MIN_TURN_RAD, 3 * error):
        texts.append(plus_minus(angle, error, *ERROR_UNITS["rad"]))
    return " and ".join(texts)


def _length(parts: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Length of a vector of (value, standard error), and its own standard error to first order.

    ``|v| = sqrt(Σ v²)``, ``σ = sqrt(Σ (v s)²) / |v|`` for independent entries.
    """
    length = math.sqrt(sum(v**2 for v, _ in parts))
    return length, math.sqrt(sum((v * s) ** 2 for v, s in parts)) / length if length else 0.0
