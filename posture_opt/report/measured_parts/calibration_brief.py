"""The first screen on a calibration: the answer, outliers, what is left open, and what to do next."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.report.measured_parts.calibration_parameters import determined_words, differing, undetermined_names
from posture_opt.report.measured_parts.error_table import ELSEWHERE, mm, reading_size, rows_words
from posture_opt.report.measured_parts.large_file_words import thinned_words
from posture_opt.report.measured_parts.other_file_words import file_words
from posture_opt.report.text.blocks import Block, Facts, Report
from posture_opt.statements.notation import count

if TYPE_CHECKING:
    from posture_opt.calibration.calibration import Calibration
    from posture_opt.selection.problem_data import ProblemData
    from posture_opt.validation.assessment import Assessment

_MAX_NAMED_PARAMETERS = 3  # parameters
_MAX_OUTLIER_LINES = 6  # of outliers
_MIN_NOISE_SHARE = 0.5**0.5  # of a standard deviation: less is less than half of the variance


def calibration_brief(problem: ProblemData, found: Calibration, seen: Assessment, lead: tuple[str, ...]) -> Report:
    """The lead of the whole report and a line on each of its parts, on one screen.

    Lines: measured, thinned, errors, test file, parameters, undetermined, outliers, next. Of these, thinned, test
    file, undetermined and outliers are left out where there is nothing to say.
    """
    facts = [
        ("Measured", _measured(problem, found)),
        *([("Thinned", thinned_words(found.large))] if found.large is not None else []),
        ("Errors", _errors(found)),
        *([("Test file", _test(found))] if found.test is not None else []),
        ("Parameters", _parameters(found)),
        *(
            [("Undetermined", open_names)]
            if (open_names := undetermined_names(found, 2 * _MAX_NAMED_PARAMETERS))
            else []
        ),
        *([("Outliers", _outliers(found))] if found.outliers else []),
        ("Next", "; ".join(next_steps(found, seen)) + "."),
    ]
    return Report(problem.name or "Calibration", lead, (Block("", (Facts(tuple(facts)),)),))


def _measured(problem: ProblemData, found: Calibration) -> str:
    """Rows, poses, file and instrument; of touched points how many there are.

    The σ of the instrument is that of one coordinate, as the file states it.
    """
    data = found.request.data
    rows = f"{rows_words(data, problem.robot)} ({Path(data.file).name or 'table'})"
    if data.touches:
        return f"{rows} at {count(len(data.point_names), 'touched point')}"
    sigma = position_sigma(problem, data)
    per = " per coordinate" if data.position is not None else ""
    places = f": {', '.join(data.point_names)}" if data.point_names else ""
    rows += "" if data.position is not None else f", {data.kind.noun}{places}"
    return f"{rows}; " + (f"instrument σ {reading_size(data, sigma)}{per}" if sigma else "no σ of the instrument")


def _errors(found: Calibration) -> str:
    """How long the errors of held-out rows are [mm]: the length that 95 % of them do not exceed, and the largest."""
    s = found.calibrated
    return f"calibrated, 95 % of the held-out rows are within {mm(s.p95)} mm, all within {mm(s.max)} mm"


def _test(found: Calibration) -> str:
    """RMS errors [mm] on the test file before and after, and how it was used.

    Rows outside of the joint ranges of the fit are counted: there a model extrapolates.
    """
    other = found.test
    assert other is not None
    before, after = (mm(other.models[name].rms) for name in ("nominal", "calibrated"))
    out = int(other.outside.sum())
    beyond = f"; {count(out, 'row')} outside the joint ranges measured" if out else ""
    words = file_words(other).rstrip(".").replace(": ", ", ")
    return f"{before} mm RMS before calibration, {after} mm calibrated ({words}{beyond})"


def _parameters(found: Calibration) -> str:
    """How many unknowns are determined, and which differ from the file."""
    return ". ".join(filter(None, (determined_words(found), differing(found, _MAX_NAMED_PARAMETERS))))


def _outliers(found: Calibration) -> str:
    """The lines that were left out."""
    lines = ", ".join(map(str, found.lines[:_MAX_OUTLIER_LINES])) + " …" * (len(found.lines) > _MAX_OUTLIER_LINES)
    return f"{count(len(found.outliers), 'row')} left out: line{'s' * (len(found.lines) > 1)} {lines}"


def stood_elsewhere(found: Calibration) -> bool:
    """Whether errors on the test file are so large that base or instrument may have been moved.

    More than ``ELSEWHERE`` times those of the first file, unless the frames were fitted again.
    """
    if found.test is None or found.request.refit_frames:
        return False
    return found.test.models["calibrated"].rms > ELSEWHERE * found.calibrated.rms


def next_steps(found: Calibration, seen: Assessment) -> tuple[str, ...]:
    """What the data call for, the most urgent first.

    A frame that was moved comes before a systematic error, this before parameters that are open, and repeats come
    last. With nothing left to do the step is to plan with ``calibrated.yaml``.
    """
    steps = []
    if stood_elsewhere(found):
        steps.append("--refit-frames fits base and tool again to the test file: base or instrument may have been moved")
    if not seen.calibrated.zero:
        steps.append("'diagnose' searches for the cause of the remaining systematic error")
    elif 0 < seen.instrument < _MIN_NOISE_SHARE * seen.calibrated.coordinate:
        steps.append("'diagnose' searches for the cause of the remaining error, most of which is not instrument noise")
    if found.identifiability.words:
        steps.append("'plan-measurements' proposes postures that determine more parameters")
    if seen.repeats is None and found.request.data.position is not None:
        steps.append("measure ten postures five times each to separate scatter from systematic error")
    return tuple(steps) or ("plan with calibrated.yaml, which --out DIR writes",)
