"""Problems from a file, from a mapping, and from those that travel with the package."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path

from posture_opt.errors import InputError, Issue, did_you_mean, either, listed, nearest
from posture_opt.files import builtin_names as builtin_names
from posture_opt.files import is_file, is_there, nearest_file
from posture_opt.files import problems_folder as problems_folder
from posture_opt.problem.problem import Problem, build_problem
from posture_opt.problem.yaml_source import Plain, ProblemDocument, plain, read_yaml
from posture_opt.texts import one_line

# The files of a result that describe the arm: of a diagnosis, of a calibration
_DELIVERED = "extended.yaml", "calibrated.yaml"
_DEFAULT_PROBLEM = "insert_planar_2r"


def load_problem(path: str | PathLike[str]) -> Problem:
    """The problem in a YAML file, or, where there is none of that name, the built-in problem: ``insert_planar_2r``.

    Args:
        path: file, built-in name, or the folder of a diagnosis or calibration: then the arm that it delivered.

    Returns:
        ``Problem``: ``robot``, ``task``, ``sources``, ``cell`` and the rest of the file, in SI units and
        radians.

    Raises:
        InputError: everything wrong with the file, each with line, key and a hint.

    Example:
        >>> import posture_opt as po
        >>> po.load_problem("insert_planar_2r").task.kind
        'insert'
    """
    file, name = Path(path), fspath(path)
    if not is_there(file):
        if name in builtin_names():
            file = problems_folder() / f"{name}.yaml"
        elif near := _near_builtin(name):
            raise InputError(Issue(f"no such file: {name}", hint=near))
    file = next((file / delivered for delivered in _DELIVERED if is_file(file / delivered)), file)
    return build_problem(read_yaml(file), file.parent, one_line(file.stem))


def problem_from_dict(data: Mapping[str, Plain], folder: str | PathLike[str] = ".") -> Problem:
    """The problem of a mapping with the keys of a problem file.

    Args:
        data: sections and keys as in a file; quantities with units, or numbers in SI units and radians.
        folder: where relative file names in it start.

    Returns:
        ``Problem``: as `load_problem` returns it.

    Raises:
        InputError: everything wrong with the data, each with key and a hint.

    Example:
        >>> import posture_opt as po
        >>> arm = {"kind": "preset", "name": "ur5e"}
        >>> problem = po.problem_from_dict({"robot": arm, "uncertainty": {"repeatability": "0.03 mm"}})
        >>> problem.robot.joint_names[:2]
        ('shoulder_pan', 'shoulder_lift')
    """
    if not isinstance(data, Mapping):
        raise InputError(Issue(f"a problem is a mapping of sections, not {type(data).__name__}"))
    return build_problem(ProblemDocument(plain(data)), Path(folder), "problem")


def _near_builtin(name: str) -> str:
    if nearest_file(Path(name)):
        return ""
    begun = [known for known in builtin_names() if known.startswith(name)]
    near = begun[:4] or [nearest(name, builtin_names())]
    if near[0]:
        return f"did you mean the built-in {either(near)}?"
    bare = Path(name).name == name and not Path(name).suffix
    return f"the built-in problems are {listed(builtin_names(), 100)}" if bare else ""


def load_builtin(name: str) -> Problem:
    """The problem that travels with the package under ``name``."""
    if name not in builtin_names():
        raise InputError(Issue(f"there is no built-in problem '{name}'", (), name, did_you_mean(name, builtin_names())))
    return load_problem(problems_folder() / f"{name}.yaml")


def builtin_problem(task: str) -> Problem:
    """The built-in problem of a task: the planar 2R arm of the lecture."""
    own = f"{task}_planar_2r"
    problem = load_builtin(own if own in builtin_names() else _DEFAULT_PROBLEM)
    return problem if problem.task and problem.task.kind == task else problem.with_task(task)
