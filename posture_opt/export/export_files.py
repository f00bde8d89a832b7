"""``export_files``: a problem, or the posture that answers it, in the words of another program."""

from __future__ import annotations

from typing import get_args

from posture_opt.errors import InputError, Issue, one_of
from posture_opt.export import EXPORTS, PROGRAM_FORMATS
from posture_opt.export.export_format import Exported, ExportFormat, ExportSource
from posture_opt.export.program_format import ProgramFormat
from posture_opt.export.robot_program import MotionRequest, RobotProgram, posture_program
from posture_opt.interrupts import interruptible
from posture_opt.robot.posture import PostureLike, read_posture
from posture_opt.selection.problem_data import ProblemData


def export_kinds() -> dict[str, type[ExportFormat]]:
    """The formats by name."""
    return {str(get_args(listed.model_fields["kind"].annotation)[0]): listed for listed in EXPORTS}


@interruptible()
def export_files(
    problem: ProblemData,
    to: str,
    *,
    name: str = "",
    posture: PostureLike | None = None,
    speed: float = 10.0,
    wait: float = 0.0,
    approach: float | None = None,
    with_breaks: bool = False,
    seed: int | None = None,
    workers: int = 1,
) -> Exported:
    """A problem in another format: its arm, its covariance as code, or its best posture as a robot program.

    Args:
        problem: a ``Problem``.
        to: one of `export_kinds`.
        name: of functions, programs and files; each format has one of its own.
        posture: (n,) the stop of a robot program [rad or m]; default: the answer to the problem, which is planned.
        speed: of robot programs [percent].
        wait: at every stop of a robot program [s].
        approach: distance [m] of a point in front of every stop, or of a path, and of one to retract to; None: 50 mm,
            or what part and clearance of the cell need, where the task touches its target.
        with_breaks: whether a path that the arm has to leave on its way is written in parts.
        seed, workers: of the planning.

    Returns:
        ``Exported``: ``files``, file name -> text, and ``notes`` on what the format cannot hold.

    Raises:
        InputError: an unknown format, or one that cannot say it.
        NoSolutionError: the problem has no posture to write.

    Example:
        >>> import posture_opt as po
        >>> found = po.export_files(po.load_problem("insert_planar_2r"), "dh")
        >>> found.files["dh.csv"].splitlines()[0]
        'parameter, unit, nominal, correction, sum'
    """
    kinds = export_kinds()
    if to not in kinds:
        raise InputError(Issue("there is no such export", ("--to",), to, one_of(to, kinds, "formats")))
    asked, given = MotionRequest(speed, wait, approach, with_breaks), None
    if posture is not None and to in PROGRAM_FORMATS:
        given = posture_program(problem, "the given posture", read_posture(problem.robot, posture), [""], asked)
    source = ExportSource(problem, asked, seed, workers, given)
    return kinds[to](name=name).write(source)


def program_files(program: RobotProgram, to: str, name: str) -> Exported:
    """A robot program that is known, in one of the languages of controllers."""
    language = export_kinds()[to](name=name)
    assert isinstance(language, ProgramFormat)
    return language.written(program)
