"""``select_posture``: the answer to a problem, whatever its task asks for: one posture, or one for each point."""

from __future__ import annotations

from posture_opt.numerics import Progress
from posture_opt.selection.paths.path_selector import PathSelector
from posture_opt.selection.paths.path_solution import PathSolution
from posture_opt.selection.selector import PostureSelector, task_of
from posture_opt.selection.solution import HasTask, Solution


def planned_posture(problem: HasTask, *, seed: int | None = None, workers: int = 1) -> Solution:
    """The one posture that stands for the answer to a problem: the worst one of a path.

    Raises:
        NoSolutionError, InputError: as `select_posture`.
    """
    found = select_posture(problem, seed=seed, workers=workers)
    return found.worst if isinstance(found, PathSolution) else found


def select_posture(
    problem: HasTask, *, seed: int | None = None, workers: int = 1, progress: Progress | None = None
) -> Solution | PathSolution:
    """The posture whose spread hurts the task least, with alternatives and evidence; for a path one at each point.

    By the criterion ``worst`` it is ``min_q λ_max(Bᵀ C(q) B)``, the largest variance in the directions that the task
    minds: C (3, 3) [m²] the covariance of the tool point, B (3, m) a basis of those directions, both world; subject to
    the target, the tool axis, the limits of the joints and what the task adds.

    Args:
        problem: with a task and uncertain parameters.
        seed: of the random starts; the same seed gives the same answer. Default: the problem's.
        workers: processes that share the batches of starts.
        progress: called with (done, most) batches.

    Raises:
        NoSolutionError: nothing feasible; carries the nearest posture and the reasons.
        InputError: no task, nothing uncertain, or a task that the arm cannot do.
    """
    if task_of(problem).on_path:
        return PathSelector.of(problem).solve(seed=seed)
    return PostureSelector(problem, compiled=False).solve_thoroughly(seed=seed, workers=workers, progress=progress)
