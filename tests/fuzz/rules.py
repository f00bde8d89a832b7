"""What must hold of every run, whatever its input."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any, NoReturn

from tests.fuzz.case import Case
from tests.fuzz.run import CPU, MEMORY, Run

CODES = (0, 2, 3, 4)
# Words that only a number which is none, or an absent value that was printed, can have put there.
_NO_ANSWER = re.compile(r"(?<![\w'./-])(nan|NaN|inf|-inf|Infinity|None)(?![\w'-]| is| of)")
_WARNING = re.compile(r"^.*\.py:\d+: \w*Warning: .*$", re.MULTILINE)
_TIME = re.compile(
    r'(?m)("seconds": )[\d.e+-]+|^\d+ [a-z]+ in [\d.:]+ (s|min): .* a second\n|\b[\d.]+ (ms|s|seconds)\b'
)
"""Times, and the line of the rate, which a work of under two seconds has not."""
_MAY_BE_NULL = """
    about adaptive after agrees base_frame before best_of_all bias_mahalanobis clearance corner_rms critical
    critical_budget critical_budget_groups curvature detectable direction floor goals highest_speed interval95 joint
    kkt left_rotation lever limiting_joint link mean_test most_manipulable mounting off_rotation own p_value
    pose_covariance_integration posture prior radius95 random reason refused refuted_sigma repeats
    share_within_95_of_cell share_within_95_of_own_posture shift sigma sigma_along sigma_between_repeats
    sigma_interval95 sigma_max sigma_stated size speed spin_sigma std success_all success_probability
    success_probability_interval95 task temperature_rise times times_allowed tool_frame typical_sigma_max
    worst_sigma_max worst_station would_need z
"""
"""Keys of documents whose value may be unknown, or none."""


def faults(case: Case, run: Run) -> Iterator[str]:
    """Everything that a run did wrong, one line each; nothing where it did well."""
    yield from run.left
    if run.cpu > CPU or run.code == -24:
        yield f"CPU {run.cpu:.1f} s"
    if run.memory > MEMORY:
        yield f"memory {run.memory:.0f} MB"
    if run.code not in CODES:
        yield f"exit {run.code}: {_last(run.err)}"
    told = "defect of this program" if "--debug" in case.words else "Traceback"  # which is what --debug shows
    if told in run.err or "defect of this program" in run.err:
        yield f"defect: {_last(run.err)}"
    if found := _WARNING.search(run.err):
        yield f"warning: {found[0].split(': ', 1)[1][:100]}"
    yield from _answer(case, run) if run.code == 0 else _refusal(case, run)


def _answer(case: Case, run: Run) -> Iterator[str]:
    options = {word.split("=")[0] for word in case.words}
    if not run.out.strip() and not run.made and not {"--quiet", "--out"} & options:
        yield "exit 0 without a word"
    if "--json" in options and run.out.strip() and not {"-h", "--help", "--version"} & options:
        yield from _json_faults(run.out, "standard output")
    else:
        yield from _no_answer(case, run.out, "standard output")
    for name, content in run.made.items():
        text = content.decode("utf-8", "replace")
        if name.endswith(".json"):
            yield from _json_faults(text, name)
        elif name.endswith((".csv", ".yaml", ".txt", ".script", ".src", ".dat", ".mod", ".urdf")):
            yield from _no_answer(case, text, name)


def _refusal(case: Case, run: Run) -> Iterator[str]:
    rows = case.words[:1] == ("batch",)  # a file that has no answer has a row that says why
    if run.code > 0 and not (run.err + run.out).strip() and not (rows and run.made):
        yield f"exit {run.code} without a message"
    left = [] if rows else sorted({*run.made} - {*case.kept})
    if run.code > 0 and left:
        yield f"exit {run.code}, and left {left[:3]}"
    said = run.err + run.out + (run.made.get("o/answers.csv", b"").decode() if rows else "")
    if run.code == 2 and not _names_input(case, said):
        yield f"a message that names nothing of the input: {run.err.strip()[:120]}"


def _names_input(case: Case, message: str) -> bool:
    """Whether a message says where the fault is: an option, a file, a key, or a value that was given."""
    if "--" in message or "'" in message or "Usage:" in message:
        return True
    given = (word.encode("unicode_escape").decode() for word in (*case.words, *case.files) if word)
    return any(word in message.encode("unicode_escape").decode().replace("\\\\", "\\") for word in given)


def _no_answer(case: Case, text: str, where: str) -> Iterator[str]:
    given = case.texts
    for found in _NO_ANSWER.finditer(text):
        if found[1] not in given:
            line = text[text.rfind("\n", 0, found.start()) + 1 :].split("\n")[0]
            yield f"{found[1]} in {where}: {line.strip()[:100]}"
            return


def _json_faults(text: str, where: str) -> Iterator[str]:
    try:
        document = json.loads(text, parse_constant=_refuse)
    except ValueError as error:
        yield f"{where} is no JSON: {error}"
    else:
        yield from (f"null in {where}: {key}" for key in sorted({*_nulls(document)} - {*_MAY_BE_NULL.split()}))


def _nulls(document: Any, key: str = "") -> Iterator[str]:
    """Names of the entries that are null; those of lists, and of what is listed by kind, by the name of the whole."""
    if isinstance(document, dict):
        for name, entry in document.items():
            yield from _nulls(entry, key if key == "detectable" else name)
    elif isinstance(document, list):
        for entry in document:
            yield from _nulls(entry, key)
    elif document is None:
        yield key


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number of JSON")


def _last(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1][:160] if lines else "without a message"


def same(first: Run, second: Run) -> Iterator[str]:
    """What differs between two runs of one case; times of the clock may."""
    pairs: tuple[tuple[str, Any, Any], ...] = (
        ("exit code", first.code, second.code),
        ("standard output", first.out, second.out),
        ("standard error", first.err, second.err),
    )
    for name, one, other in pairs:
        if _TIME.sub("", str(one)) != _TIME.sub("", str(other)):
            yield f"{name} differs from run to run"
