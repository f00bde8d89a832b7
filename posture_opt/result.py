"""``Result``: the face that every answer of this package shows, in Python, in notebooks and on the command line.

A result holds numbers and knows nothing of reports. Its presenter belongs to a room above, which the package itself
finds; it is loaded when a result is first looked at, so computing needs none of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from posture_opt import presenter_of
from posture_opt.encoding import Encoded
from posture_opt.numerics import DerivedAgain, Json, Progress
from posture_opt.statements import Statement, by_severity

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Summarised(DerivedAgain):
    """Prints in a few lines, in a terminal as in a notebook; a dataclass among these has ``repr=False``."""

    def summary(self) -> str:
        """What this is and its most important numbers, with units: at most 12 lines."""
        return str(self._presenter.summary_text())

    def __repr__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        return str(self._presenter.summary_html())

    @cached_property
    def _presenter(self) -> Any:
        """What presents this; the only way from the rooms below to the reports above."""
        return presenter_of(self)


class Result(Summarised, Encoded):
    """A frozen answer that prints in a few lines, reports, draws and saves itself.

    Subclasses are dataclasses with ``repr=False``; they name the keys of their document, or have ``fields_json``, and
    have ``statements``.
    """

    @property
    def statements(self) -> tuple[Statement, ...]:
        """What this result has to say, as data: the answer first, then whatever limits it."""
        return ()

    def to_json(self) -> dict[str, Json]:
        """The JSON document of this result: SI units and radians, and its statements, the gravest first."""
        return {**super().to_json(), "statements": [one.to_json() for one in by_severity(self.statements)]}

    def document(self) -> Any:
        """What every report of this result is made of: title, statements, tables, figures."""
        return self._presenter.document().whole

    def report(self, *, full: bool = True) -> str:
        """The report as plain text, as the command line prints it: the whole, or what fits on one screen."""
        return str(self._presenter.report_text(full))

    def figures(self) -> dict[str, Figure]:
        """Name -> matplotlib ``Figure``, the most important one first; they belong to no window."""
        return dict(self._presenter.figures())

    def plot(self) -> Figure:
        """The most important figure, as a matplotlib ``Figure``."""
        figure: Figure = self._presenter.plot()
        return figure

    def to_dataframe(self) -> Any:
        """The main table of this result as a pandas ``DataFrame``; the name of a column ends with its unit.

        Raises:
            InputError: pandas is not installed.
        """
        return self._presenter.dataframe()

    def save(
        self,
        folder: str | PathLike[str],
        *,
        figures: bool = True,
        beside: Mapping[str, bytes] | None = None,
        progress: Progress | None = None,
    ) -> tuple[Path, ...]:
        """Write the JSON document, the report as text and as a page, tables and figures: all of them, or nothing.

        Files of an earlier result of this package in ``folder`` are removed, measured or planned data are not.
        ``beside`` are further files by name; ``progress`` gets how many of how many parts are made.

        Raises:
            InputError: the folder cannot be written to.
        """
        written: tuple[Path, ...] = self._presenter.save(
            Path(folder), figures=figures, beside=beside or {}, progress=progress
        )
        return written
