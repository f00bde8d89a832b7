"""A finding in words, held against what the problem file states."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.report.effect_words import cause_words, main_size

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes import Finding
    from posture_opt.problem.problem import Problem


def finding_words(finding: Finding, problem: Problem | None = None) -> str:
    """A finding in words; a joint that scatters is held against what the problem file states, if it states anything."""
    if finding.kind == "joint_noise" and problem is not None and not _states(problem, finding):
        return (
            f"{finding.target} scatters from visit to visit by {main_size(finding)}, of which the file states nothing"
        )
    return cause_words(finding.kind, finding.target, finding.estimate)


def _states(problem: Problem, finding: Finding) -> bool:
    """Whether the file says how the joint of a finding scatters from visit to visit."""
    sources = problem.sources
    names = [] if finding.noise is None else finding.noise.scatter(problem.robot)
    return any(sources.visit[i, i] > 0 for i, name in enumerate(sources.names) if name in names)
