"""A finding in words, held against what the problem file states."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.model.effects.cause import FittedSizes

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes import Finding
    from posture_opt.problem.problem import Problem


def finding_words(finding: Finding, problem: Problem | None = None) -> str:
    """A finding in words; scatter of which the problem file states nothing is said to be so."""
    noise = finding.noise
    if noise is not None and noise.unstated and problem is not None and not _states(problem, finding):
        return noise.unstated.format(target=noise.target, size=noise.headline(FittedSizes(finding.estimate)))
    return finding.cause.words


def _states(problem: Problem, finding: Finding) -> bool:
    """Whether the file says how the joint of a finding scatters from repeat to repeat."""
    sources = problem.sources
    names = [] if finding.noise is None else finding.noise.scatter(problem.robot)
    return any(sources.scatter[i, i] > 0 for i, name in enumerate(sources.names) if name in names)
