"""``compare`` and ``compare_plans``: one task for several arms, or for several models of one arm."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from posture_opt.errors import InputError, Issue, NoSolutionError, SolverError
from posture_opt.interrupts import interruptible
from posture_opt.model.chain import stretched
from posture_opt.numerics import Array, Progress
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.comparison.comparison import ComparedAnswer, Comparison
from posture_opt.selection.comparison.predicted_error import JudgedAnswer, judged_answer
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.select_posture import at_one_feature, select_posture
from posture_opt.statements import Statement, state

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class OnDemand(Mapping[str, T], Generic[T]):
    """Values by name, each made when it is first asked for."""

    names: Collection[str]
    make: Callable[[str], T]
    _made: dict[str, T] = field(default_factory=dict)

    def __getitem__(self, name: str) -> T:
        if name not in self.names:
            raise KeyError(name)
        if name not in self._made:
            self._made[name] = self.make(name)
        return self._made[name]

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)


Reasons = tuple[str, ...]
"""Why there is no answer, in sentences."""


@interruptible()
def compare(
    problems: Mapping[str, ProblemData], *, seed: int | None = None, workers: int = 1,
    progress: Progress | None = None,
) -> Comparison:  # fmt: skip
    """Solve the task of the first problem with every arm, and predict the errors of each answer on all arms.

    Arms with the same joints predict each other's postures: mean error from the target, and spread about it.

    Args:
        problems: at least two, by name.
        seed, workers: of the searches, and processes that share them.
        progress: called with (done, all) arms.

    Returns:
        ``Comparison``: ``answers``, of each arm its posture [rad, m] and standard deviation [m]; ``to_dataframe()`` has
        what every arm says of each of them.

    Raises:
        InputError: fewer than two problems, no task, or a task that an arm cannot be given.
        NoSolutionError: no arm can do the task; the message gives the reasons of each.

    Example:
        >>> import posture_opt as po
        >>> names = ("insert_planar_2r", "insert_planar_2r_calibrated")
        >>> comparison = po.compare({name: po.load_problem(name) for name in names})
        >>> comparison.best
        'insert_planar_2r_calibrated'
        >>> {name: f"{1e3 * one.answer.sigma_max:.2g} mm" for name, one in comparison.answered.items()}
        {'insert_planar_2r': '14 mm', 'insert_planar_2r_calibrated': '0.16 mm'}
    """
    if len(problems) < 2:
        raise InputError(Issue("a comparison needs two problems", hint="name two problem files"))
    asked, notes = _same_task(problems)
    found: dict[str, Solution | Reasons] = {}
    for done, (name, problem) in enumerate(asked.items()):
        if progress is not None:
            progress(done, len(asked))
        try:
            found[name] = select_posture(problem, seed=seed, workers=workers)
        except (NoSolutionError, SolverError) as error:
            found[name] = tuple(str(error).splitlines())
    if all(isinstance(answer, tuple) for answer in found.values()):
        reasons = [f"{name}: {reason}" for name, why in found.items() if isinstance(why, tuple) for reason in why]
        raise NoSolutionError("\n".join(reasons))
    return Comparison({name: _column(asked, name, answer) for name, answer in found.items()}, notes=notes)


@interruptible()
def compare_plans(
    models: Mapping[str, ProblemData], *, seed: int | None = None, workers: int = 1, hint: str = "",
    measured: Array | None = None,
) -> Comparison | None:  # fmt: skip
    """The task planned with each model of an arm, every posture judged by each of them; None without a task.

    Of a task with features, the one that scatters most by the reference is planned, where the reference places it. A
    model that states no scatter takes that of the reference. Where the reference has no posture for the task, the
    others are not asked: the search for reasons is long, and theirs would be the same.

    Args:
        models: by name, the reference last: the model that describes the arm best.
        seed, workers: of the searches, and processes that share them.
        hint: stated beside the reasons where a model has no posture.
        measured: (N, n) postures that the reference was fitted to [rad or m].

    Returns:
        ``Comparison`` of the plans, postures in rad and m, standard deviations in m; None where a task is missing.

    Example:
        >>> import posture_opt as po
        >>> nominal, known = (po.load_problem(f"insert_planar_2r{end}") for end in ("", "_calibrated"))
        >>> comparison = po.compare_plans({"nominal": nominal, "calibrated": known})
        >>> judged = {name: one.judged["calibrated"].sigma_max for name, one in comparison.answered.items()}
        >>> {name: f"{1e3 * sigma:.2g} mm" for name, sigma in judged.items()}
        {'nominal': '0.29 mm', 'calibrated': '0.16 mm'}
    """
    *_, reference = models
    if any(model.task is None for model in models.values()):
        return None
    chosen: Solution | Reasons
    try:
        models = at_one_feature(models, models[reference], seed=seed, workers=workers)
        chosen = _planned(models[reference], seed, hint)
    except (NoSolutionError, InputError, SolverError) as error:
        chosen = tuple(str(error).splitlines())
    if isinstance(chosen, tuple):  # nor are the others asked
        reasons = {name: chosen if name == reference else () for name in models}
        return Comparison({name: ComparedAnswer(models[name], reasons=why) for name, why in reasons.items()}, reference)
    sources = models[reference].sources
    asked = {name: replace(one, sources=sources) if one.sources.empty else one for name, one in models.items()}

    column = partial(_planned_column, asked, reference, chosen, seed, hint, measured)
    return Comparison(OnDemand(tuple(asked), column), reference)


def _planned_column(
    asked: Mapping[str, ProblemData], reference: str, chosen: Solution, seed: int | None, hint: str,
    measured: Array | None, name: str,
) -> ComparedAnswer:  # fmt: skip
    # A function of the module: results are pickled, and a closure would not be.
    answer = chosen if name == reference else _planned(asked[name], seed, hint)
    return _column(asked, name, answer, basis=chosen.basis, measured=measured)


def _column(
    problems: Mapping[str, ProblemData], name: str, answer: Solution | Reasons, basis: Array | None = None,
    measured: Array | None = None,
) -> ComparedAnswer:  # fmt: skip
    problem = problems[name]
    if isinstance(answer, tuple):
        return ComparedAnswer(problem, reasons=answer)
    kinds = {judge: [joint.type for joint in other.robot.joints] for judge, other in problems.items()}
    judges = tuple(judge for judge, kind in kinds.items() if kind == kinds[name])
    judged = partial(_judged, problems, answer.stations, basis, measured)
    return ComparedAnswer(problem, answer, OnDemand(judges, judged))


def _judged(
    problems: Mapping[str, ProblemData], stations: Sequence[Solution], basis: Array | None, measured: Array | None,
    judge: str,
) -> JudgedAnswer:  # fmt: skip
    return judged_answer(problems[judge], stations, basis, measured)


def _same_task(problems: Mapping[str, ProblemData]) -> tuple[dict[str, ProblemData], tuple[Statement, ...]]:
    name, first = next(iter(problems.items()))
    if first.task is None:
        hint = f"add a task: section to {name}, name the file with the task first, or write --task and --position"
        raise InputError(Issue("there is no task to compare the arms by", ("task",), hint=hint))
    asked: dict[str, ProblemData] = {}
    notes = []
    for other, problem in problems.items():
        same = problem.task == first.task and problem.workpiece_sources.same_as(first.workpiece_sources)
        asked[other] = problem if same else problem.with_task_of(first)
        if not same:
            own = "shared" if problem.task is None else "replaced"
            notes.append(state(f"selection.task-{own}", name, arm=other))
    return asked, tuple(notes)


def _planned(problem: ProblemData, seed: int | None, hint: str) -> Solution | Reasons:
    hints = (hint,) if hint else ()
    if far := _far_away(problem):
        return (far, *hints)
    try:
        if problem.task is not None and problem.task.on_path:
            advice = "plan one point of it: task: {kind: trace, position: [...]}"
            raise InputError(Issue("models are not compared along a path", ("task", "path"), hint=advice))
        return PostureSelector(problem, compiled=False).solve_to_compare(seed)
    except (NoSolutionError, InputError, SolverError) as error:
        return (*str(error).splitlines(), *hints)


def _far_away(problem: ProblemData) -> str:
    (first, longest), task = stretched(problem.robot), problem.task
    if task is None or task.position is None:
        return ""
    distance = float(np.linalg.norm(np.array(task.position) - first))
    if distance <= longest:
        return ""
    at = ", ".join(f"{value:.2f}" for value in first + 0.0)
    return (
        f"the target is out of reach: {distance:.2f} m from the first joint, and the arm stretches to {longest:.2f} m; "
        f"that joint is at ({at}) m in the world frame, with a free base that of the instrument: state the target in it"
    )
