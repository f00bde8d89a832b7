"""``report.html``: the report as one page that needs nothing but itself and no network.

Figures are inside as base64, the interactive view with its library compressed. On a long page only the blocks of the
short report are open at first.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from base64 import b64encode
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any

from posture_opt import __version__
from posture_opt.files import packaged
from posture_opt.report.page.library import INSTALL, packed_json, plotly_js
from posture_opt.report.text.blocks import Document, Facts, Table

if TYPE_CHECKING:
    from jinja2 import Template

_MIN_OPEN_BLOCKS = (
    3  # blocks: a page with fewer is short, and nothing of it is folded; of others so many are open at least
)


class View(ABC):
    """What a page shows to be turned and chosen from, in plain numbers."""

    @property
    @abstractmethod
    def keys(self) -> frozenset[str]:
        """Of all that can be chosen: rows of tables with such a key show it."""

    @abstractmethod
    def document(self) -> dict[str, Any]:
        """What the script of the page reads."""


@dataclass(frozen=True)
class Page:
    """What is on a page.

    Args:
        images: PNG files by the name of the figure; ``captions`` say what they show.
        view: the interactive view; None: there is none.
        hint: whether to say how to get one.
        brief: titles of the blocks that are open at first; the others are folded. None: all are open.
        problem_file: its text, shown at the end.
    """

    report: Document
    images: Mapping[str, bytes] = field(default_factory=dict)
    captions: Mapping[str, str] = field(default_factory=dict)
    view: View | None = None
    hint: bool = False
    brief: Collection[str] | None = None
    problem_file: str = ""

    def html(self) -> str:
        """The page."""
        return _template().render(
            page=self,
            report=self.report,
            blocks=[(f"part-{k}", block) for k, block in enumerate(self.report.blocks, 1)],
            opened=self._opened,
            images={name: _encoded(data) for name, data in self.images.items()},
            encoded=_encoded,
            keys=self._keys,
            shown=self._shown,
            library="" if self.view is None else plotly_js(),
            data="" if self.view is None else packed_json(self.view.document()),
            style=_text("page.css"),
            script=_text("page.js") + ("" if self.view is None else _text("view.js")),
            install=INSTALL,
            version=__version__,
            kind=_kind,
        )

    @property
    def _keys(self) -> frozenset[str]:
        """The keys that rows of tables may have to show something in the view."""
        return frozenset() if self.view is None else self.view.keys

    def _shown(self, views: Sequence[str], k: int) -> str:
        """The key of what row or column k shows in the view; empty where that is nothing."""
        return views[k] if k < len(views) and views[k] in self._keys else ""

    @property
    def _opened(self) -> frozenset[str]:
        """Titles of the blocks that are open at first."""
        titles = [block.title for block in self.report.blocks]
        briefed = [title for title in titles if self.brief is None or title in self.brief]
        return frozenset(briefed if len(briefed) >= _MIN_OPEN_BLOCKS else (*briefed, *titles[:_MIN_OPEN_BLOCKS]))


def _encoded(data: bytes) -> str:
    """A file as a page holds it inside."""
    return b64encode(data).decode("ascii")


def _kind(item: str | Facts | Table) -> str:
    """``text``, ``facts`` or ``table``, by which the template chooses."""
    return "text" if isinstance(item, str) else type(item).__name__.lower()


def _text(name: str) -> str:
    """A file of the folder ``templates``."""
    return packaged("posture_opt.report", "templates", name)


@cache
def _template() -> Template:
    """The template of the page; texts of results are escaped, and a name that it does not get is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("posture_opt.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    return environment.get_template("report.html")
