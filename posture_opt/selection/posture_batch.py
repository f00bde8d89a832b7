"""``select_postures``: the answers to many problems, in one result."""

from __future__ import annotations

import math
import time
from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from posture_opt import presenter_of
from posture_opt.encoding import Encoded
from posture_opt.errors import InputError, Issue, NoSolutionError, PostureOptError
from posture_opt.limits import MOST_PROBLEM_FILES
from posture_opt.numerics import Progress
from posture_opt.result import Result
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.select_posture import select_posture
from posture_opt.statements import Quantity, Statement, state
from posture_opt.workers import Executor, opened
from posture_opt.workers.record_pattern import Either, recorded

if TYPE_CHECKING:
    from posture_opt.selection.answer.solution import Solution

MOST_PAGES = 20  # answers that bring a page of their own: drawing an arm takes a second or two, and a page some 0.5 MB
_FAILURES = {2: "with bad input", 3: "without a solution", 4: "with too few data", 1: "stopped by a defect"}


@dataclass(frozen=True, eq=False)
class BatchAnswer(
    Encoded,
    json="name code status sigma_max worst_station success_probability reasons solution=document",
):
    """What became of one problem.

    Args:
        name: under which it was asked.
        code: the exit code that it has alone: 0, or why there is no answer.
        reasons: in words, where there is none.
        document: of its answer, as ``solution.json`` has it; the nearest posture where the problem has no solution.
        page: its own report as HTML, where pages were asked for; ``picture`` the arm as a small PNG in base64.
    """

    name: str
    code: int
    reasons: tuple[str, ...]
    document: Mapping[str, Any] | None
    page: str = ""
    picture: str = ""

    @property
    def status(self) -> str:
        """``optimal``, ``feasible``, ``infeasible``, or ``failed`` where nothing was computed."""
        return "failed" if self.document is None else str(self.document["status"])

    @property
    def _solution(self) -> Mapping[str, Any]:
        return {} if self.code or self.document is None else self.document

    @property
    def sigma_max(self) -> float:
        """Largest standard deviation of the part that counts [m], over all postures; NaN without a solution."""
        return float(self._solution.get("sigma_max", math.nan))

    @property
    def worst_station(self) -> str | None:
        """The feature or point that ``sigma_max`` is of; None where there is one target, or no solution."""
        return self._solution.get("worst_station")

    @property
    def success_probability(self) -> float:
        """To stay within the clearance, at the worst feature or point; NaN without one."""
        value = self._solution.get("success_probability")
        return math.nan if value is None else float(value)


@dataclass(frozen=True, eq=False, repr=False)
class PostureBatch(Result):
    """The answers to many problems.

    Args:
        problem: the first of those that could be read.
        answers: one for each, in the order in which they were asked.
        seconds: wall time.
    """

    problem: ProblemData
    answers: tuple[BatchAnswer, ...]
    seconds: float

    @property
    def code(self) -> int:
        """Zero where every problem has an answer; else the least of the other exit codes: what to fix first."""
        return min((answer.code for answer in self.answers if answer.code), default=0)

    @cached_property
    def solved(self) -> tuple[BatchAnswer, ...]:
        """Those that have a solution."""
        return tuple(answer for answer in self.answers if not answer.code)

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """How many are solved, why the others are not, and the answers of least and largest standard deviation."""
        codes, ordered = [answer.code for answer in self.answers], sorted(self.solved, key=lambda one: one.sigma_max)
        failures = tuple(f"{codes.count(code)} {why}" for code, why in _FAILURES.items() if code in codes)
        ends = {"smallest": ordered[0], "largest": ordered[-1]} if len(ordered) > 1 else {}
        return (
            state("selection.batch-solved", solved=len(ordered), problems=len(codes)),
            *([state("selection.batch-failed", failures=failures)] if failures else []),
            *(state(f"selection.batch-{end}", one.name, sigma=Quantity(one.sigma_max)) for end, one in ends.items()),
        )

    def fields_json(self) -> dict[str, object]:
        """The document ``answers.json``: SI units, finite numbers only."""
        return {
            "problems": len(self.answers),
            "solved": len(self.solved),
            "code": self.code,
            "answers": self.answers,
            "seconds": self.seconds,
        }


def select_postures(
    problems: Mapping[str, ProblemData | PostureOptError],
    *,
    seed: int | None = None,
    pages: bool = False,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> PostureBatch:
    """The answer of `select_posture` to each of many problems; what fails does not keep the others from theirs.

    Args:
        problems: by the names that they are to have; in place of one that could not be read, the error.
        seed: of the random starts; default: each problem's.
        pages: whether the first ``MOST_PAGES`` answers bring their own reports, each with a picture: some seconds each.
        workers: processes that share the problems; no answer depends on it.
        executor: of `concurrent.futures`, or a Dask client, to share them instead; it stays open.
        progress: called with (done, total) problems.

    Returns:
        ``PostureBatch``: ``answers`` in the order of the problems, each a ``Solution`` or the error that was
        met.

    Raises:
        InputError: no problem at all, too many, or none that could be read.

    Example:
        >>> import posture_opt as po
        >>> found = po.select_postures({name: po.load_problem(name) for name in ("insert_planar_2r", "insert_scara")})
        >>> [(answer.name, answer.status, f"{1e3 * answer.sigma_max:.2g} mm") for answer in found.answers]
        [('insert_planar_2r', 'optimal', '14 mm'), ('insert_scara', 'optimal', '0.0031 mm')]
    """
    began = time.perf_counter()
    MOST_PROBLEM_FILES.check_at(len(problems), ("problems",))
    readable = {name: problem for name, problem in problems.items() if not isinstance(problem, PostureOptError)}
    if not readable:
        issues = [issue for error in problems.values() if isinstance(error, InputError) for issue in error.issues]
        raise InputError(issues or Issue("no problem is named", hint="name problem files"))
    found = {name: _failed(error) for name, error in problems.items() if isinstance(error, PostureOptError)}
    names = list(readable)
    with opened(workers, executor) as pool:
        items = [(problem, pages and k < MOST_PAGES) for k, problem in enumerate(readable.values())]
        for k, row in pool.run(solved, seed, items):
            found[names[k]] = row
            if progress is not None:
                progress(len(found), len(problems))
    answers = tuple(
        BatchAnswer(name, code, tuple(why), one, *(page or ()))
        for name in problems
        for code, why, one, page in [found[name]]
    )
    return PostureBatch(readable[names[0]], answers, time.perf_counter() - began)


_UNKNOWN = {"status": str}
_KNOWN = {
    "status": str,
    "sigma_max": float,
    "worst_station": Either(str, None),
    "success_probability": Either(float, None),
}
_PAGE = Either(None, (str, str))
# The pattern of what `solved` returns: of a document what is read of it.
_ANSWER = Either(
    (frozenset({0}), [str], _KNOWN, _PAGE), (frozenset({1, 2, 3, 4}), [str], Either(None, _UNKNOWN), _PAGE)
)


@recorded(lambda seed, item: _ANSWER)
def solved(seed: int | None, item: tuple[ProblemData, bool]) -> list[Any]:
    """Exit code, reasons, document, and page with picture or None; a defect is its own problem's too."""
    problem, paged = item
    try:
        solution = select_posture(problem, seed=seed)
        return [0, [], solution.to_json(), _page_of(solution) if paged else None]
    except NoSolutionError as error:
        near = error.solution
        if near is None:
            return _failed(error)
        page = _page_of(near) if paged else None
        return [error.exit_code, str(error).splitlines(), near.to_json(), page]
    except PostureOptError as error:
        return _failed(error)
    except Exception as error:
        return [1, [f"{type(error).__name__}: {error} (a defect of this program)"], None, None]


def _page_of(solution: Solution) -> list[str]:
    page, picture = presenter_of(solution).illustrated_page()
    return [page, b64encode(picture).decode("ascii")]


def _failed(error: PostureOptError) -> list[Any]:
    return [error.exit_code, str(error).splitlines(), None, None]
