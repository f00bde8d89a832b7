"""Whether measurements suffice for a calibration, and whether they belong to this arm; if not, what to do."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.assumptions.frames import far_places
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.fit_setup import TOLERANCES, FitSetup, prior_tolerances, sorts_of_parts
from posture_opt.calibration.estimation.identifiability import identify_parameters
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.errors import InputError, InsufficientDataError, Issue, listed
from posture_opt.measurements.measurements import Measurements, reach
from posture_opt.numerics import Array, Codes, Mask, rms_length
from posture_opt.robot.robot import Robot
from posture_opt.statements import Quantity

_MAX_NOMINAL_ERROR = 0.1  # of the reach: no nominal model is that wrong
_STATIONARY_POINT_WORDS = "holds its tool point where no joint moves it"
_STATIONARY_POINT_HINT = "state tool and base, add a known length, or measure where more joints move"
_PLAN_HINT = "'optimize-posture plan-measurements' proposes postures"


def still_joints(robot: Robot, data: Measurements) -> tuple[str, ...]:
    """``JOINT at VALUE`` of each joint that moves by less than 1e-3 [rad or m] over all rows."""
    still = [(joint, q[0]) for joint, q in zip(robot.joints, data.q.T, strict=True) if np.ptp(q) < 1e-3]
    return tuple(
        f"{joint.name} at {f'{math.degrees(v):.4g} deg' if joint.unit == 'rad' else f'{v * 1e3:.4g} mm'}"
        for joint, v in still
    )


def still_notes(robot: Robot, data: Measurements) -> tuple[str, ...]:
    """A sentence on joints that stood still, where others moved."""
    still = still_joints(robot, data)
    if not still:
        return ()
    which = "this joint" if len(still) == 1 else "these joints"
    return (f"in all rows stood still: {', '.join(still)}; what {which} could distinguish is open: move {which} too",)


def check_amount(residuals: Residuals, known: FitSetup, groups: int) -> None:
    """Refuses data that cannot determine the parameters, or not their errors."""
    data, block = residuals.data, residuals.block
    counted, measure = _row_count_text(residuals), spread_poses(residuals)
    if groups < 2 and len(data) > 1:
        still = len(still_joints(residuals.robot, data)) == residuals.robot.n
        alike = "all rows are alike" if still else "all rows belong to one group"
        raise InsufficientDataError(f"{alike}: {counted} cannot determine how the arm errs elsewhere; {measure}")
    tool_alone = data.touches and len(data.point_names) == 1  # the arm is held within its tolerances
    if tool_alone and groups < 4:
        text = f"{groups} touches of one point do not show how well the tool point is known"
        raise InsufficientDataError(Issue(text, hint="touch it from at least 4 postures, tilted differently"))
    rank = min(known.directions.shape[1], len(residuals.free)) if tool_alone else known.directions.shape[1]
    if len(data) * block + len(residuals.distances) <= rank or groups < 2:
        unknowns = f"{len(residuals.parameters)} parameters and their errors"
        raise InsufficientDataError(f"{counted} cannot determine {unknowns}: {measure}")


def check_size(residuals: Residuals, held: int | None) -> None:
    """Refuses touched points that an arm misses the less the smaller it is, and of which no length can be ``held``."""
    if residuals.data.kind.fixes_size or residuals.distances or held is not None:
        return
    if not any(p.group == "geometry" for p in residuals.parameters):
        return
    raise InsufficientDataError(
        f"{residuals.data.kind.noun} alone do not determine the size of this arm, and it has no length that could be "
        f"held: {state_a_distance(residuals.data)}"
    )


def state_a_distance(data: Measurements) -> str:
    """What makes the size of an arm known that touches points."""
    if not data.touches:
        return data.kind.remedy
    names = data.point_names
    if len(names) < 2:
        return "touch a second point at a known distance"
    return f"state a known distance in the problem file, data: {{distances: [[{names[0]}, {names[1]}, 50 mm]]}}"


def check_kept(residuals: Residuals, groups: Codes, kept: Mask) -> None:
    """Refuses data of which outliers leave one group (N,) alone, or none: no other predicts it."""
    if len(np.unique(groups[kept])) > 1:
        return
    raise InsufficientDataError(
        f"{int(np.sum(~kept))} of {len(kept)} rows are outliers, and the rest belongs to one group: it "
        f"cannot determine how the arm errs elsewhere; {spread_poses(residuals)}"
    )


def check_places(residuals: Residuals, x: Array) -> None:
    """Refuses a solution that has cameras, anchors or touched points outside of the workspace by far."""
    hint = "check its rows, its names and, of a camera, the intrinsics; measure more poses in its view"
    far, file = sorted(far_places(residuals, x).items()), residuals.data.file
    message = "{} is found {:.3g} m from the base, which is no solution"
    if far:
        raise InputError([Issue(message.format(*one), ("data",), hint=hint, file=file) for one in far])


def check_geometry(residuals: Residuals, known: FitSetup, x: Array) -> None:
    """Refuses data that determine frames alone; ``x`` (k,) is where the free frames are."""
    geometry = np.array([p.group == "geometry" for p in residuals.parameters])
    if not geometry.any() or known.identifiability.determined[geometry].any():
        return
    frames = [p for p in residuals.parameters if p.group != "geometry"]
    J, scale = residuals.residuals_and_jacobian(x)[1][:, ~geometry], prior_tolerances(frames, [])
    alone = identify_parameters([p.name for p in frames], J, len(residuals.data), scale=scale, noise=known.noise)
    if alone.rank < known.identifiability.rank:
        return
    still = still_joints(residuals.robot, residuals.data)
    stood = f", as these joints stood still: {', '.join(still)}" if still else ""
    raise InsufficientDataError(
        f"{_row_count_text(residuals)} determine no parameter of the arm itself{stood}; {spread_poses(residuals)}"
    )


def _row_count_text(residuals: Residuals) -> str:
    poses = len(np.unique(residuals.data.pose))
    return f"{len(residuals.data) * residuals.block} measured coordinates in {poses} pose{'s' * (poses != 1)}"


def spread_poses(residuals: Residuals) -> str:
    """How many poses to measure at least, and how to choose them."""
    # 5 poses beyond as many coordinates as unknowns: what errors are estimated from
    need = math.ceil(len(residuals.parameters) / residuals.block) + 5
    return f"measure at least {need} poses spread over the workspace, with every joint moving: {_PLAN_HINT}"


@dataclass(frozen=True)
class Disagreement:
    """What a calibrated arm leaves of measurements that are hardly its own: RMS error and RMS motion [m]."""

    left: float
    motion: float

    @classmethod
    def of(cls, residuals: Residuals, errors: Array) -> Disagreement | None:
        """Of the position errors (N, 3) that the calibrated arm leaves; None where they are those of an arm."""
        found = cls(rms_length(errors), _rms_motion(residuals))
        # 1 % of the motion: far more than calibrated arms err (the worst of ours, driven by cables, 0.5 %)
        least = 0.01 * max(found.motion, _MAX_NOMINAL_ERROR * reach(residuals.robot))
        return found if found.left > least else None


def _rms_motion(residuals: Residuals) -> float:
    data = residuals.data
    return reach(residuals.robot) if data.position is None else rms_length(data.position - data.position.mean(axis=0))


def _motion_of_tool(residuals: Residuals, x: Array) -> float:
    """RMS motion [m] of the tool point about its mean, with the deviations ``x`` (k,), in postures across the rows."""
    data = residuals.data
    q = np.column_stack([np.roll(column, k) for k, column in enumerate(data.q.T)])
    mixed = residuals.of_data(replace(data, q=q))
    points = np.stack([np.broadcast_to(p, len(data)) for p in mixed.walk(x).position], axis=1)
    return rms_length(points - points.mean(axis=0))


def _rest_meets(residuals: Residuals, held: int | None) -> bool:
    data = residuals.data
    apart = data.touches and len(data.point_names) > 1
    if apart or residuals.distances or data.kind.fixes_size or not data.kind.contact:
        return False
    lengths = [p.unit == "m" and p.group in ("geometry", "tool") for p in residuals.parameters]
    if held is not None:
        lengths[held] = False
    return _stands_still(residuals, np.where(lengths, [-p.nominal for p in residuals.parameters], 0.0))


def _stands_still(residuals: Residuals, x: Array) -> bool:
    """Whether the joints hardly move the tool point of the arm with the deviations x (k,) [rad, m]."""
    # 0.01 of the nominal motion of the tool point: no tool is held that close to where nothing moves it
    return _motion_of_tool(residuals, x) < 0.01 * _motion_of_tool(residuals, np.zeros(len(x)))


def check_sense(residuals: Residuals, x: Array, errors: Array, held: int | None = None) -> None:
    """Refuses measurements that the calibrated arm does not explain, or only with a tool point that stands still.

    x (k,) deviations of the calibrated arm [rad, m]; errors (N, 3) what it leaves [m].
    """
    motion, left = _rms_motion(residuals), rms_length(errors)
    touched, file = residuals.data.position is None, residuals.data.file
    if touched and _stands_still(residuals, x):
        message = (
            f"the arm that fits these rows best {_STATIONARY_POINT_WORDS}, and so meets planes, bars and points "
            "anywhere: the rows say nothing of the arm"
        )
        raise InsufficientDataError(Issue(message, hint=_STATIONARY_POINT_HINT, file=file))
    # 1e-14 of the reach: rounding; no readings are met so closely
    if touched and left < 1e-14 * reach(residuals.robot):
        message = "these rows are met exactly, to the last digit: they hold no reading that the arm could miss"
        hint = "touch each point, plane or length from several postures"
        raise InsufficientDataError(Issue(message, hint=hint, file=file))
    # 0.05 of the measured motion, left by a calibrated arm: no data of this arm
    if left < 0.05 * max(motion, _MAX_NOMINAL_ERROR * reach(residuals.robot)):
        return
    message = (
        f"even calibrated, the arm misses the measured points by {Quantity(left)} (RMS), where they move by "
        f"{Quantity(motion)}"
    )
    hint = "is it another robot's file? do all joints count in the direction and from the zero of the problem file?"
    # Which of both ends a fit arrives at is a matter of rounding: one that misses is no proof against these rows.
    if touched and _rest_meets(residuals, held):
        message += f"; an arm that {_STATIONARY_POINT_WORDS} would meet them: the rows say nothing of the arm"
        raise InsufficientDataError(Issue(message, hint=f"{hint} If so: {_STATIONARY_POINT_HINT}", file=file))
    raise InputError(Issue(message, hint=hint, file=file))


_SIZE_NOTE = "{} alone do not determine the size of the arm: {}; {}"
_HELD_BY_LENGTHS = "the lengths in the file hold it, within their tolerance"
_TOLERANCE_NOTE = (
    "parts are taken to be within manufacturing tolerance of nominal, as wide as the data suggest (one σ: {})"
)
_STAY_NOTE = "the data hardly improve, so that they stay near nominal: {}"


def size_notes(residuals: Residuals, held: int | None) -> tuple[str, ...]:
    """A sentence on what holds the size of an arm that the data leave open, and what would determine it."""
    kind = residuals.data.kind
    own = any(p.group == "geometry" for p in residuals.parameters)
    if not own or (held is None and (kind.fixes_size or residuals.distances)):
        return ()
    by = _HELD_BY_LENGTHS if held is None else f"{residuals.parameters[held].name} is held"
    return (_SIZE_NOTE.format(kind.noun, by, kind.remedy),)


def place_notes(residuals: Residuals, known: FitSetup, found: Fit) -> tuple[str, ...]:
    """Sentences on unknowns of planes, cameras and the like that stay open."""
    rows = zip(residuals.parameters, found.std, known.fixed, strict=True)
    errors = {p.name: float(std) if fixed else math.inf for p, std, fixed in rows if p.group == "place"}
    return residuals.data.kind.open_notes(errors)


def tolerance_notes(residuals: Residuals, known: FitSetup) -> tuple[str, ...]:
    """Sentences on tolerances by manufacturing, and on the parameters that the data do not improve."""
    own = np.flatnonzero(np.isfinite(known.assumed))
    if not len(own):
        return ()
    parameters = [residuals.parameters[i] for i in own]
    widths = zip(parameters, sorts_of_parts(residuals, own), known.assumed[own], strict=True)
    text = ", ".join(dict.fromkeys(f"{TOLERANCES[sort].noun} {1e3 * sigma:.2g} m{p.unit}" for p, sort, sigma in widths))
    names = [residuals.parameters[i].name for i in own if not known.fixed[i]]
    # 12 parameters that a sentence names.
    stay = (_STAY_NOTE.format(listed(names, 12)),) if names else ()
    return (_TOLERANCE_NOTE.format(text), *stay)
