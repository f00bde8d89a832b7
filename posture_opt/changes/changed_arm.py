"""The problem of a calibrated arm with one change of it, and nothing else, taken over."""

from __future__ import annotations

from collections.abc import Mapping

from posture_opt.experiments.possible_changes import PossibleChange
from posture_opt.model.effects import Effect
from posture_opt.selection.fitted_arm import FittedArm
from posture_opt.selection.problem_data import ProblemData


def changed_problem(problem: ProblemData, change: PossibleChange, estimate: Mapping[str, float]) -> ProblemData:
    """The same problem with the parameters of a change off by ``estimate`` [rad, m or SI of the effect]."""
    header = (f"Rechecked: {change.kind} of {change.target} is as new measurements have it, all else as it was.",)
    if change.effect is None:
        return problem.with_fit(FittedArm("", dict(estimate), header=header))
    return problem.replace(effects=_with_effect(problem, change.effect, estimate))


def _with_effect(problem: ProblemData, effect: Effect, estimate: Mapping[str, float]) -> list[object]:
    """The section ``effects`` with what changed added to the effect of that name, or with it as a further one."""
    entries = list(problem.to_dict().get("effects") or [])
    names = [known.name for known in problem.effects]
    step = [estimate[name] for name in effect.parameter_names]
    if effect.name not in names:
        return [*entries, effect.with_estimate(step).to_dict()]
    at = names.index(effect.name)
    known = problem.effects[at]
    assert isinstance(known, Effect)
    total = known.with_estimate([a + b for a, b in zip(known.values, step, strict=True)])
    entries[at] = {**entries[at], "estimate": total.to_dict()["estimate"]}
    return entries
