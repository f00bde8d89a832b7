"""Starter files: each loads and solves as it is, and so does every suggestion in it."""

from __future__ import annotations

import pytest

import posture_opt as po
from posture_opt.problem.problem import Problem
from posture_opt.problem.starter import starter_text
from posture_opt.problem.yaml_source import parse_yaml
from posture_opt.robot import preset_names

SUGGESTIONS = ("position", "region", "tool_axis", "tilt", "clearance", "criterion", "subject_to")


def started(preset: str, *suggestions: str) -> Problem:
    """The problem of a starter file with some of its suggestions taken up."""
    text = starter_text(preset).replace("starts: 32", "starts: 4")
    for word in suggestions:
        assert f"\n  # {word}:" in text
        text = text.replace(f"\n  # {word}:", f"\n  {word}:")
    return po.problem_from_dict(parse_yaml(text).data)


@pytest.mark.parametrize("preset", preset_names())
def test_starter_solves_as_it_is_and_at_the_place_that_it_suggests(preset: str) -> None:
    for suggestions in ((), ("position",)):
        problem = started(preset, *suggestions)
        assert not problem.sources.empty
        assert po.select_posture(problem).status in ("optimal", "feasible")


@pytest.mark.parametrize("suggestion", SUGGESTIONS)
def test_suggestions_are_valid(suggestion: str) -> None:
    for preset in ("planar_2r", "scara", "ur10e"):
        task = started(preset, suggestion).task
        assert task is not None
        assert suggestion in task.model_fields_set
