"""``Comparison``: one task planned with several models, each answer judged by each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.result import Result
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.comparison.comparison_statements import comparison_statements
from posture_opt.selection.comparison.predicted_error import JudgedAnswer
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.search.clusters import clusters
from posture_opt.statements import Statement

_TIE = 1e-12  # of a standard deviation


@dataclass(frozen=True, eq=False)
class ComparedAnswer:
    """A column of a comparison: the answer planned with one model, or why there is none, and its judgements.

    Args:
        judged: name of a model -> what it predicts of the answer; models of arms with other joints have no entry.
    """

    problem: ProblemData
    answer: Solution | None = None
    judged: Mapping[str, JudgedAnswer] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()

    @property
    def stations(self) -> tuple[Solution, ...]:
        """The postures of the answer: one, one a feature, or one a listed point of a path."""
        return () if self.answer is None else self.answer.stations

    @property
    def sigma_max(self) -> float:
        """Largest standard deviation that the model itself predicts of its answer [m]."""
        return max(station.critical.sigma_max for station in self.stations)

    def to_json(self) -> dict[str, Any]:
        """The document of this answer: SI units and radians."""
        if self.answer is None:
            return {"status": "infeasible", "reasons": list(self.reasons)}
        return {
            "status": self.answer.status,
            "postures": [station.posture for station in self.stations],
            "sigma_max": self.sigma_max,
            "judged_by": {name: judged.to_json() for name, judged in self.judged.items()},
            "reasons": [],
        }

    def judged_json(self, reference: str) -> dict[str, Any] | None:
        """The one posture, the σ that its model predicts, and what the reference predicts; None without a posture."""
        if self.answer is None:
            return None
        (station,), predicted = self.stations, self.judged[reference].worst
        parts, distance = predicted.parts, predicted.from_measured
        return {
            "posture": station.posture,
            "predicted_sigma_max": self.sigma_max,
            **self.judged[reference].to_json(),
            "miss": predicted.miss.tolist(),
            **({} if parts is None else {"spread": parts.to_json()}),
            **({} if distance is None else {"from_measured": distance.to_json()}),
        }


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    """One task for several arms, or for several models of one arm: a matrix of answers and models that judge them.

    The entry ``answers[planned].judged[judge]`` is what the model ``judge`` predicts of the postures that were planned
    with the model ``planned``.

    Args:
        answers: the columns, by the name of the arm or model that they were planned with.
        reference: of models of one arm, the one that knows it best; empty where arms are compared.
        notes: on what was not the same.
    """

    answers: Mapping[str, ComparedAnswer]
    reference: str = ""
    notes: tuple[Statement, ...] = ()

    @property
    def arms(self) -> Mapping[str, ComparedAnswer]:
        """The answers by the arm that they were planned with."""
        return self.answers

    @property
    def problem(self) -> ProblemData:
        """The reference, or the first arm, with the task."""
        return self.answers[self.reference or next(iter(self.answers))].problem

    @property
    def answered(self) -> dict[str, ComparedAnswer]:
        """The arms or models that have an answer."""
        return {name: compared for name, compared in self.answers.items() if compared.answer is not None}

    def answers_task(self, name: str) -> bool:
        """Whether there is a model or arm of this name, and it has an answer."""
        return name in self.answers and self.answers[name].answer is not None

    @property
    def judges(self) -> tuple[str, ...]:
        """The models that judge an answer, as a report shows them: the reference alone where there is one."""
        if self.reference:
            return (self.reference,)
        return tuple(name for name in self.answers if any(name in found.judged for found in self.answered.values()))

    @property
    def best(self) -> str | None:
        """The one that predicts the smallest spread for itself, the first in a tie; None where none has an answer."""
        if not self.answered:
            return None
        sigmas = {name: compared.judged[name].sigma_max for name, compared in self.answered.items()}
        least = min(sigmas.values())
        return next(name for name, sigma in sigmas.items() if sigma <= least * (1 + _TIE))

    def same_posture(self, one: str, other: str) -> bool:
        """Whether the one posture of two models is the same but for what the models correct, and for whole turns."""
        (first,), (second,) = self.answers[one].stations, self.answers[other].stations
        ignored = () if second.engine is None else second.engine.indifferent
        return len(clusters(np.array([first.q, second.q]), self.problem.robot, ignored=ignored)[0]) == 1

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why there are answers missing, in sentences, each once."""
        return tuple(dict.fromkeys(reason for compared in self.answers.values() for reason in compared.reasons))

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """What the comparison has to say, the answer first."""
        return comparison_statements(self)

    def fields_json(self) -> dict[str, Any]:
        """The document ``comparison.json``, with a reference the part ``posture`` of others: SI units and radians."""
        if self.reference:
            judged = {name: compared.judged_json(self.reference) for name, compared in self.answers.items()}
            return {**judged, "reasons": list(self.reasons)}
        task = self.problem.task
        return {
            "name": self.problem.name,
            "task": None if task is None else task.kind,
            "arms": {name: compared.to_json() for name, compared in self.answers.items()},
            "best": self.best,
            "notes": [str(note) for note in self.notes],
        }
