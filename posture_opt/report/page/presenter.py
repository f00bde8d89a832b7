"""``Presenter``: how one kind of result is reported, tabulated, drawn and filed.

The file ``report/results/some_thing_report.py`` presents the class ``SomeThing`` by its class ``SomeThingPresenter``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import count
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeAlias, TypeVar, cast

from posture_opt.errors import InputError, Issue
from posture_opt.numerics import Array, Mask, Progress
from posture_opt.report.page.page import Page, plotly_js
from posture_opt.report.page.save import CAPTIONS, Files, report_files, save_files, summary_html
from posture_opt.report.page.style import THUMBNAIL_DPI, image
from posture_opt.report.text.blocks import Block, Document, Summary
from posture_opt.report.text.screen import on_a_screen
from posture_opt.report.text.text import render, render_summary, terminal_width
from posture_opt.result import Result, Summarised

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from posture_opt.selection.problem_data import ProblemData

Plots: TypeAlias = "Mapping[str, Callable[[Any], Figure]]"


T = TypeVar("T")
S = TypeVar("S", bound=Summarised)
R = TypeVar("R", bound=Result)

Drawings = dict[str, Callable[[], "Figure | None"]]
"""Name of a figure -> what draws it, or says that there is nothing to draw; the most important one first."""
Columns = Mapping[str, Sequence[Any] | Array | Mask]
"""Head of a column with its unit -> its cells."""


def problem_of(result: Any) -> ProblemData:
    """What was asked, as reports need it: whole, and not only a robot with its sources."""
    return cast("ProblemData", result.problem)


class SummaryPresenter(ABC, Generic[S]):
    """One object in a few lines."""

    def __init__(self, result: S) -> None:
        self.result: S = result

    @abstractmethod
    def summary(self) -> Summary:
        """What it is, and its three or four most important numbers."""

    def summary_text(self) -> str:
        """The summary as plain text, at most 12 lines."""
        return render_summary(self.summary())

    def summary_html(self) -> str:
        """The summary as a small table for notebooks."""
        return summary_html(self.summary())


def pandas_module() -> Any:
    """The library pandas, where it is installed.

    Raises:
        InputError: it is not.
    """
    try:
        return import_module("pandas")
    except ImportError:
        hint = "install it (pip install pandas), or use to_json()"
        raise InputError(Issue("to_dataframe needs the library pandas", hint=hint)) from None


class Presenter(SummaryPresenter[R]):
    """One result with what only its report needs, worked out when it is asked for.

    Args:
        stem: of the JSON document, ``map`` of ``map.json``.
        title: of a report whose problem has no name; ``heading`` of the summary, by default the title.
        asked: the attribute of the result that has the problem; empty: the result itself.
        plots: name of a figure -> function of the result that draws it.
        delivers: the further files of ``save`` that people look for.
    """

    stem: ClassVar[str]
    title: ClassVar[str] = ""
    heading: ClassVar[str] = ""
    asked: ClassVar[str] = ""
    plots: ClassVar[Plots] = {}
    delivers: ClassVar[tuple[str, ...]] = ()

    @property
    def problem(self) -> ProblemData:
        """What was asked; its file is at the end of the page."""
        return cast("ProblemData", attrgetter(f"{self.asked}.problem" if self.asked else "problem")(self.result))

    @property
    def problem_file(self) -> str:
        """The end of the page: the text of the problem file; empty where there is no one file."""
        return self.problem.to_yaml()

    def summary(self) -> Summary:
        """What it is, and its three or four most important numbers."""
        return Summary(f"{self.heading or self.title}: {self.problem.name}", tuple(self.facts()))

    def facts(self) -> Iterable[tuple[str, str]]:
        """The most important numbers with their labels."""
        return ()

    def document(self) -> Document:
        """What the result has to say, with its tables and figures."""
        return Document(self.problem.name or self.title, self.result.statements, tuple(self.blocks()))

    def blocks(self) -> Iterable[Block]:
        """Tables and figures of the report, a block a question."""
        return ()

    @abstractmethod
    def columns(self) -> Columns:
        """The main table."""

    def files(self) -> Files:
        """Further files of ``save`` by name."""
        return {}

    def delivered(self) -> tuple[str, ...]:
        """Those of them that people look for."""
        return self.delivers

    def report_text(self, full: bool = True) -> str:
        """The report, or one screen of it, as plain text, as wide as the terminal."""
        width, report = terminal_width(), self.document().whole
        saved = (*self.delivered(), f"{self.stem}.json")
        return render(report if full else on_a_screen(report, width, saved), width)

    def drawings(self) -> Drawings:
        """The figures, not drawn yet."""
        return {name: partial(plot, self.result) for name, plot in self.plots.items()}

    def view(self) -> Any:
        """The interactive view; None where there is nothing to choose from."""
        return None

    def figures(self) -> dict[str, Figure]:
        """All figures by name, drawn."""
        drawn = {name: draw() for name, draw in self.drawings().items()}
        return {name: figure for name, figure in drawn.items() if figure is not None}

    def plot(self) -> Figure:
        """The first figure.

        Raises:
            InputError: this result has none.
        """
        for draw in self.drawings().values():
            if (figure := draw()) is not None:
                return figure
        raise InputError(f"there is nothing to draw of this {type(self.result).__name__}")

    def dataframe(self) -> Any:
        """The main table.

        Raises:
            InputError: pandas is not installed.
        """
        return pandas_module().DataFrame(dict(self.columns()))

    def save(
        self, folder: Path, *, figures: bool = True, beside: Mapping[str, bytes], progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """Writes document, reports, further files and figures into ``folder``, all or none; their paths."""
        return save_files(folder, {**self.contents(figures=figures, progress=progress), **beside})

    def contents(self, *, figures: bool = True, progress: Progress | None = None) -> Files:
        """File name -> content of all that `save` writes."""
        drawings = self.drawings() if figures else {}
        parts, done = 3 * len(drawings) + 2, count(1)

        def made(part: T) -> T:
            if progress is not None:
                progress(next(done), parts)
            return part

        document, page = made(self.result.to_json()), made(self._page(figures))
        drawn = {name: made(draw()) for name, draw in drawings.items()}
        there = {name: figure for name, figure in drawn.items() if figure is not None}
        return {**report_files(self.stem, document, page, there, made), **self.files()}

    def illustrated_page(self) -> tuple[str, bytes]:
        """The page with the picture of the arm alone, and that picture small, as PNG; empty where nothing is drawn."""
        drawings = self.drawings()
        name = "arm" if "arm" in drawings else next(iter(drawings), "")
        drawn = drawings[name]() if name else None
        if drawn is None:
            return self._page(False).html(), b""
        page = replace(self._page(False), images={name: image(drawn, "png")}, captions=CAPTIONS)
        return page.html(), image(drawn, "png", THUMBNAIL_DPI)

    def _page(self, pictures: bool) -> Page:
        report = self.document().whole
        viewed = pictures and type(self).view is not Presenter.view
        view = self.view() if viewed and plotly_js() else None
        return Page(report, view=view, hint=viewed and view is None, problem_file=self.problem_file)
