"""What a calibration has to say of data, file, arm and test file; a diagnosis says it, too."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.estimation.identifiability import ANGLE_TOLERANCE_RAD, LENGTH_TOLERANCE_M
from posture_opt.calibration.instruments import LEAST_PROBABILITY
from posture_opt.measurements.measurements import rows_back_in_time
from posture_opt.model.effects import Effect, JointCoupling
from posture_opt.statements import Quantity, Statement, state
from posture_opt.statements.notation import listed_lines, sentence
from posture_opt.statements.quantity import UNLIKELY
from posture_opt.units import ERROR_UNITS, number, plus_minus

if TYPE_CHECKING:
    from posture_opt.calibration.assumptions.contradictions import Contradiction
    from posture_opt.calibration.calibration import Calibration
    from posture_opt.calibration.second_file import LargeFile
    from posture_opt.calibration.start_up import ScatterChange, StartUp
    from posture_opt.measurements.measurements import Measurements

DIMENSIONS = {"m": "length", "rad": "angle", "1": "number"}
"""SI unit -> dimension of a quantity that is an error."""
CORRELATION_SHOWN = 0.9
"""Correlation from which on one of two estimates leans on the other."""
_MAX_LISTED = 3
_FRAME_UNITS = {"m": (1e3, "mm"), "rad": (math.degrees(1), "deg")}
_WRONG_DISTANCE, _MAX_DISTANCES = 4.0, 3  # σ's from which on a stated distance is doubted, and how many are listed
ELSEWHERE = 20  # times the errors at home: no arm drifts that far


def doubts(found: Calibration) -> list[Statement]:
    """Data that are hardly this arm's, what they refute of the file, and frames that they do not determine."""
    said = [*found.request.data.reading_statements, *(doubt.statement for doubt in found.doubts)]
    if found.disagreement is not None:
        left, motion = found.disagreement.left, found.disagreement.motion
        said.append(state("calibration.data-disagree", left=Quantity(left), motion=Quantity(motion)))
    if (other := found.other_preset) is not None:
        far = sorted(other.lengths, key=lambda name: -abs(other.lengths[name][1] - other.lengths[name][0]))
        lengths = _some([f"{name} {number(1e3 * other.lengths[name][1], 4)} mm" for name in far])
        errors = {"with_them": Quantity(other.rms), "stated": Quantity(other.stated)}
        said.append(state("calibration.other-preset", other.name, title=other.title, lengths=lengths, **errors))
    said += [_contradiction(one) for one in found.contradictions]
    said += _distances(found)
    for frame, away in found.far_frames.items():
        origin = "the measured points" if frame == "base" else "the flange"
        said.append(state("calibration.frame-far", frame, far=Quantity(away), origin=origin))
    if found.implausible and other is None:  # which says what they are
        texts = [f"{name} {plus_minus(x, s, *ERROR_UNITS[unit])}" for name, (x, s, unit) in found.implausible.items()]
        said.append(state("calibration.implausible-deviation", next(iter(found.implausible)), deviations=_some(texts)))
    return said


def _some(texts: Sequence[str]) -> tuple[str, ...]:
    more = len(texts) - _MAX_LISTED
    return (*texts[:_MAX_LISTED], *([f"{more} more"] if more > 0 else []))


def _contradiction(one: Contradiction) -> Statement:
    gain = {"before": Quantity(one.rms_stated), "after": Quantity(one.rms)}
    if isinstance(one.cause, JointCoupling):
        ratio, std, _ = one.estimate["ratio"]
        size = Quantity(ratio, "number", std)
        return state("calibration.coupling-unstated", one.cause.joint, follows=one.cause.follows, ratio=size, **gain)
    if one.sigma:
        ((name, (value, std, unit)),) = one.estimate.items()
        sigma, off = Quantity(one.sigma, DIMENSIONS[unit]), Quantity(value, DIMENSIONS[unit], std)
        return state("calibration.sigma-contradicted", f"{one.cause.target}.{name}", sigma=sigma, off=off, **gain)
    (shift, std), (turn, error) = (_norm(one, unit) for unit in ("m", "rad"))
    apart = [str(Quantity(shift, "length", std))] if shift else []
    # Less than 0.01° is no turn that anyone would correct.
    apart += [str(Quantity(turn, "angle", error))] if turn > max(math.radians(0.01), 3 * error) else []
    return state("calibration.frame-contradicted", one.cause.target, off=tuple(apart), **gain)


def _norm(one: Contradiction, unit: str) -> tuple[float, float]:
    """Length of the vector of estimates of a unit, and its standard error to first order.

    ``|v| = sqrt(Σ v²)``, ``σ = sqrt(Σ (v s)²) / |v|`` for independent entries.
    """
    parts = [(v, s) for v, s, of in one.estimate.values() if of == unit]
    size = math.sqrt(sum(v**2 for v, _ in parts))
    return size, math.sqrt(sum((v * s) ** 2 for v, s in parts)) / size if size else 0.0


def _distances(found: Calibration) -> list[Statement]:
    errors, names = found.residuals.distance_errors(found.x), found.residuals.data.place_names
    said = []
    for i in [i for i in np.argsort(-np.abs(errors)).tolist() if abs(errors[i]) > _WRONG_DISTANCE][:_MAX_DISTANCES]:
        a, b, length, sigma = found.residuals.distances[i]
        away, side = abs(float(errors[i])), "longer" if errors[i] > 0 else "shorter"
        values = {"stated": Quantity(length, "stated length"), "off": Quantity(away * sigma)}
        about = f"{names[a]} to {names[b]}"
        said.append(state("calibration.distance-doubted", about, **values, side=side, sigmas=f"{away:.1f}"))
    return said


def instrument(found: Calibration, nominal: bool) -> list[Statement]:
    """That the instrument is worse than the arm, and how sure it is then that calibration helps."""
    scatter, probability = found.instrument_scatter, found.better_than_nominal
    kept = nominal and not found.predicts_better
    said = [state("calibration.nominal-kept-no-gain")] if kept else []
    if scatter is None or not scatter.exceeds:
        return said
    dimension = DIMENSIONS.get(scatter.unit, "number")
    sizes = {"scatter": Quantity(scatter.scatter, dimension), "arm": Quantity(scatter.arm, dimension)}
    said.append(state("calibration.instrument-scatters-more", **sizes))
    if probability is None or kept:
        return said
    sure = Quantity(min(probability, 0.999), "share")
    if not nominal:
        return [*said, state("calibration.probably-better", probability=sure)]
    asked = Quantity(LEAST_PROBABILITY, "share")
    return [*said, state("calibration.nominal-kept-unsure", probability=sure, asked=asked)]


def rows_in_time(data: Measurements, start: StartUp | None, change: ScatterChange | None = None) -> list[Statement]:
    """What is odd along the rows: a clock that starts anew, first rows that are off, scatter that changes."""
    said = []
    if data.time is not None and data.visit is None and len(back := rows_back_in_time(data.time, data.robot)):
        said.append(state("calibration.clock-restarts", lines=listed_lines([int(line) for line in data.line[back]])))
    if start is not None:
        which = "start-up" if start.spread else "start-up-elsewhere"
        values = {"first": Quantity(start.rms), "rest": Quantity(start.rest), "p": Quantity(start.p_value, "p")}
        said.append(state(f"calibration.{which}", rows=start.rows, **values))
        if start.warming is not None:
            first, rest = (f"{rise:+.1f} K" for rise in start.warming)
            said.append(state("calibration.start-up-temperature", first=first, rest=rest))
    elif change is not None:
        which = "scatter-changes-at-points" if change.points else "scatter-changes"
        sizes, p = {"after": Quantity(change.after), "before": Quantity(change.before)}, Quantity(change.p_value, "p")
        said.append(state(f"calibration.{which}", line=str(change.line), points=change.points, p=p, **sizes))
    return said


def data_warnings(texts: Sequence[str]) -> list[Statement]:
    """What is odd in the data or the fit, each once."""
    return [state("calibration.data-warning", text=sentence(text)) for text in dict.fromkeys(texts)]


def left_out(found: Calibration, lines: Sequence[int]) -> list[Statement]:
    """Rows that are left out as outliers, by their lines."""
    if not lines:
        return []
    run, listed = found.outliers_at_ends, listed_lines(lines)
    if run < 4:  # outliers that follow each other, which instruments do not make
        return [state("calibration.outliers", lines=listed)]
    return [state("calibration.outliers-at-end", lines=listed, run=run)]


def thinned(large: LargeFile | None) -> list[Statement]:
    """How a file of very many rows was thinned, and whether more of them would change the answer."""
    if large is None:
        return []
    models = {name: Quantity(large.models[name].rms) for name in ("nominal", "calibrated")}
    used, rows, share = len(large.thinning.rows), len(large.thinning.data), large.uncertainty / max(large.left, 1e-300)
    which = "thinning-suffices" if share < 0.1 else "thinning-limits"  # standard errors then hardly count
    moves = {"moves": Quantity(large.uncertainty), "share": Quantity(share, "share")}
    return [state("calibration.thinned", used=used, rows=rows, **models), state(f"calibration.{which}", **moves)]


def statements_of(found: Calibration) -> tuple[Statement, ...]:
    """What a calibration has to say by itself, the answer first."""
    explained = any(isinstance(c.cause, Effect) for c in found.contradictions)  # by the first line
    warnings = () if explained else found.request.data.warnings
    return (
        *_answer(found),
        *doubts(found),
        *rows_in_time(found.request.data, found.start_up),
        *data_warnings((*warnings, *found.fit.notes)),
        *_test(found),
        *left_out(found, found.lines),
        *thinned(found.large),
        *_parameters(found),
        *(state("calibration.undetermined", text=sentence(text)) for text in found.identifiability.words),
        *(state("calibration.note", text=sentence(text)) for text in (*found.request.data.notes, *found.notes)),
    )


def _answer(found: Calibration) -> list[Statement]:
    """What calibration brings, and where the frames are that are all of it."""
    before, after = Quantity(found.nominal.rms), Quantity(found.calibrated.rms)
    data = found.request.data
    what, tool_alone = data.kind.error_words, data.touches and len(data.point_names) == 1
    if (tool_alone and found.keeps_nominal) or not any(p.group == "geometry" for p in found.parameters):
        said = [state("calibration.frames-found", what=what, left=before)]
    else:
        which = "error-reduced" if after.value < before.value else "error-not-reduced"
        said = [state(f"calibration.{which}", what=what, nominal=before, calibrated=after)]
        said += instrument(found, found.keeps_nominal)
    return said + frames(found) * found.keeps_nominal


def frames(found: Calibration) -> list[Statement]:
    """Where tool and base are, if the data determine their origin: what they determine, with its standard error."""
    said = []
    for frame in ("tool", "base"):
        texts = {
            p.name.partition(".")[2]: plus_minus(p.nominal + x, std, *_FRAME_UNITS[p.unit])
            for p, x, std, counts in zip(found.parameters, found.delivered, found.std, found.fixed, strict=True)
            if counts and p.name.partition(".")[0] == frame
        }
        if {*"xyz"} <= {*texts}:
            said.append(state("calibration.frame-found", frame, at=[f"{name} {text}" for name, text in texts.items()]))
        elif frame == "tool" and found.request.data.touches and found.request.problem.robot.tool_free:
            said.append(state("calibration.frame-open", frame, open=sorted({*"xyz"} - {*texts})))
    return said


def _test(found: Calibration) -> list[Statement]:
    if found.test is None:
        return []
    errors = {name: Quantity(found.test.models[name].rms) for name in ("nominal", "calibrated")}
    holds = errors["calibrated"].value < errors["nominal"].value
    said = [state("calibration.test-holds" if holds else "calibration.test-fails", **errors)]
    moved = not found.request.refit_frames and errors["calibrated"].value > ELSEWHERE * found.calibrated.rms
    return [*said, *([state("calibration.test-moved")] if moved else [])]


def _parameters(found: Calibration) -> list[Statement]:
    geometry = [i for i, p in enumerate(found.parameters) if p.group == "geometry"]
    tested = [i for i in geometry if math.isfinite(found.z[i])]
    said = []
    if tested:
        sure = sum(found.p_values[i] < UNLIKELY for i in tested)
        said.append(state("calibration.significant-parameters", count=int(sure), of=len(tested)))
    limits = {"m": LENGTH_TOLERANCE_M, "rad": ANGLE_TOLERANCE_RAD}
    far = [i for i in geometry if found.fixed[i] and abs(found.x[i]) > limits[found.parameters[i].unit]]
    if far:
        units = [DIMENSIONS[p.unit] for p in found.parameters]
        off = {i: Quantity(float(found.x[i]), units[i], float(found.std[i])) for i in far}
        texts = [f"{found.parameters[i].name} {off[i]}" for i in far]
        length, angle = Quantity(LENGTH_TOLERANCE_M, "stated length"), Quantity(ANGLE_TOLERANCE_RAD, "angle")
        said.append(state("calibration.beyond-tolerance", deviations=texts, length=length, angle=angle))
    pairs = np.abs(np.triu(found.correlation, 1))[np.ix_(found.fixed, found.fixed)] > CORRELATION_SHOWN
    if pairs.any():
        level = f"{CORRELATION_SHOWN:g}"
        said.append(state("calibration.correlated-estimates", count=int(pairs.sum()), level=level))
    if found.request.data.touches:
        said.append(state("calibration.places-fitted", count=len(found.request.data.point_names)))
    known = found.identifiability.determined
    helped = [p.name for p, k, d in zip(found.parameters, found.fixed, known, strict=True) if k and not d]
    return [*said, *([state("calibration.by-prior", names=helped)] if helped else [])]
