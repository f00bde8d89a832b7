"""The report on the answers to many problems: a row for each, and why some have none.

The order is that of the given problems, so that rows can be compared between two runs.
"""

from __future__ import annotations

from base64 import b64decode
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from posture_opt.csv_text import csv_line
from posture_opt.report.figures.batch import plot_posture_batch
from posture_opt.report.page.presenter import Columns, Drawings, Presenter
from posture_opt.report.page.save import Files, page_name
from posture_opt.report.text.blocks import Block, Document, Linked, Summary, Table
from posture_opt.statements.notation import count, length_unit, probability
from posture_opt.units import number

if TYPE_CHECKING:
    from posture_opt.selection.posture_batch import BatchAnswer, PostureBatch

_MAX_BRIEF_ROWS = 12  # rows on one screen


class PostureBatchPresenter(Presenter["PostureBatch"]):
    """Many problems, one row each; ``answers.csv`` has all of them."""

    stem = "answers"
    delivers: ClassVar[tuple[str, ...]] = ("answers.csv",)

    @property
    def problem_file(self) -> str:
        """None: each answer has its own, on its own page."""
        return ""

    def summary(self) -> Summary:
        """How many are solved, and the answers of least and largest standard deviation."""
        facts = tuple((one.label or "Solved", one.text) for one in self.result.statements)
        return Summary(f"Postures for {count(len(self.result.answers), 'problem')}", facts)

    def document(self) -> Document:
        """First the problems without an answer with their reasons, then the table of answers.

        On one screen both are cut after the first dozen.
        """
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

    def drawings(self) -> Drawings:
        """The spread of every answer."""
        return {"answers": partial(plot_posture_batch, self.result)}

    def columns(self) -> Columns:
        """A row for every problem, SI units.

        "code" is the exit code that the problem would have alone: 0 solved, 2 bad input, 3 no solution, 4 too few
        data, 1 a defect.
        """
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
        """``answers.csv``: the columns, with quotes where a text has a comma, a quote or a line break; own pages."""
        columns = self.columns()
        rows = [columns, *zip(*columns.values(), strict=True)]
        pages = {
            link.file: answer.page.encode()
            for answer, link in zip(self.result.answers, self._links, strict=True)
            if link.file
        }
        return {"answers.csv": "".join(csv_line(map(_cell, row)) + "\n" for row in rows).encode(), **pages}

    @property
    def _links(self) -> tuple[Linked, ...]:
        """The page of each answer that has one."""
        return tuple(
            Linked(page_name(k, answer.name), b64decode(answer.picture)) if answer.page else Linked()
            for k, answer in enumerate(self.result.answers, 1)
        )


def answers_table(answers: tuple[BatchAnswer, ...]) -> Table:
    """Name, status, standard deviation in the unit of the largest, probability of success; "-" where not known."""
    known = [answer.sigma_max for answer in answers if not np.isnan(answer.sigma_max)]
    unit, factor = length_unit(known or [0.0])
    rows = [
        (
            answer.name,
            answer.status,
            "-" if np.isnan(answer.sigma_max) else number(factor * answer.sigma_max),
            "-" if np.isnan(answer.success_probability) else probability(answer.success_probability),
        )
        for answer in answers
    ]
    worst = int(np.nanargmax([answer.sigma_max for answer in answers])) if known else None
    return Table(("problem", "status", f"std. dev. [{unit}]", "success"), tuple(rows), text_columns=2, worst=worst)


def _cell(value: object) -> str:
    """A value of the file: six digits, empty for NaN."""
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.6g}"
    return str(value)
