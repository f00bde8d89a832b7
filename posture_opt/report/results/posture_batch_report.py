"""The report on the answers to many problems: a row for each, and why some have none.

The order is that of the given problems, so that rows can be compared between two runs.
"""

from __future__ import annotations

from base64 import b64decode
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.report.figures.batch import plot_posture_batch
from posture_opt.report.page.presenter import Columns, Plots, Presenter
from posture_opt.report.page.save import Files, page_name
from posture_opt.report.text.blocks import Block, Document, Linked, Summary, Table
from posture_opt.statements.notation import count, length_unit, probability
from posture_opt.texts import csv_line
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.selection.posture_batch import BatchAnswer, PostureBatch

_MAX_BRIEF_ROWS = 12  # rows on one screen


class PostureBatchPresenter(Presenter["PostureBatch"]):
    """Many problems, one row each; ``answers.csv`` has all of them."""

    stem = "answers"
    plots: ClassVar[Plots] = {"answers": plot_posture_batch}
    delivers: ClassVar[tuple[str, ...]] = ("answers.csv",)
    problem_file = ""  # each answer has its own, on its own page

    def summary(self) -> Summary:
        facts = tuple((one.label or "Solved", one.text) for one in self.result.statements)
        return Summary(f"Postures for {count(len(self.result.answers), 'problem')}", facts)

    def document(self) -> Document:
        found: PostureBatch = self.result
        whole = replace(answers_table(found.answers), links=self._links)
        failed = Table(
            ("problem", "no answer because"), tuple((a.name, "; ".join(a.reasons)) for a in found.answers if a.code), 2
        )
        blocks = (
            *([Block("Without an answer", (failed,), brief=(failed.cut(_MAX_BRIEF_ROWS),))] if failed.rows else []),
            Block("Answers", (whole,), figure="answers", brief=(whole.cut(_MAX_BRIEF_ROWS),)),
        )
        return Document(f"Postures for {count(len(found.answers), 'problem')}", found.statements, blocks)

    def columns(self) -> Columns:
        answers = self.result.answers
        return {
            "problem": [answer.name for answer in answers],
            "code": [answer.code for answer in answers],
            "status": [answer.status for answer in answers],
            "sigma_max [m]": [answer.sigma_max for answer in answers],
            "success probability": [answer.success_probability for answer in answers],
            "reason": ["; ".join(answer.reasons) for answer in answers],
            "worst station": [answer.worst_station or "" for answer in answers],
        }

    def files(self) -> Files:
        def cell(value: object) -> str:
            if isinstance(value, float):
                return "" if np.isnan(value) else f"{value:.6g}"
            return str(value)

        columns = self.columns()
        rows = [columns, *zip(*columns.values(), strict=True)]
        pages = {
            link.file: answer.page.encode()
            for answer, link in zip(self.result.answers, self._links, strict=True)
            if link.file
        }
        return {"answers.csv": "".join(csv_line(map(cell, row)) + "\n" for row in rows).encode(), **pages}

    @property
    def _links(self) -> tuple[Linked, ...]:
        return tuple(
            Linked(page_name(k, answer.name), b64decode(answer.picture)) if answer.page else Linked()
            for k, answer in enumerate(self.result.answers, 1)
        )


def answers_table(answers: tuple[BatchAnswer, ...]) -> Table:
    """Name, status, standard deviation in the unit of the largest, probability of success; "-" where not known."""
    known = [answer.sigma_max for answer in answers if not np.isnan(answer.sigma_max)]
    unit, factor = length_unit(known or [0.0])
    rows = []
    for answer in answers:
        sigma, success = answer.sigma_max, answer.success_probability
        shown = "-" if np.isnan(sigma) else number(factor * sigma), "-" if np.isnan(success) else probability(success)
        rows.append((answer.name, answer.status, *shown))
    worst = int(np.nanargmax([answer.sigma_max for answer in answers])) if known else None
    return Table(("problem", "status", f"std. dev. [{unit}]", "success"), tuple(rows), text_columns=2, worst=worst)
