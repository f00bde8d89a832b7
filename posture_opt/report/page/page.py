"""``report.html``: the report as one page that needs no network.

Figures are inside as base64; the interactive view and plotly.js (the extra ``viewer``) compressed, 2 MB in place of 5.
Browsers since 2023 unpack them (``DecompressionStream``); older ones show the static figure.
"""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from posture_opt import __version__
from posture_opt.files import packaged
from posture_opt.numerics import Json
from posture_opt.report.text.blocks import Document, Facts, Table
from posture_opt.report.text.text import render

if TYPE_CHECKING:
    from jinja2 import Template

INSTALL = "pip install 'posture_opt[viewer]'"
"""What brings the interactive view."""


@cache
def plotly_js() -> str:
    """The library as compressed base64; empty where it is not installed."""
    try:
        offline = import_module("plotly.offline")
    except ImportError:
        return ""
    return packed(offline.get_plotlyjs())


def packed_json(document: Json) -> str:
    """A document as compressed base64."""
    return packed(json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False))


def packed(text: str) -> str:
    """Text as base64 of its gzip form; the same text gives the same."""
    # Level 9 takes twice the time and saves 1 % of plotly.js.
    return b64encode(gzip.compress(text.encode(), 5, mtime=0)).decode("ascii")


_OPEN_WORDS = 500  # words: blocks that begin within the first so many are open, later ones are folded


@dataclass(frozen=True)
class Page:
    """What is on a page.

    Args:
        images: PNG files by the name of the figure; ``captions`` say what they show.
        view: the interactive view; None: there is none.
        hint: whether to say how to get one.
        problem_file: its text, shown at the end.
    """

    report: Document
    images: Mapping[str, bytes] = field(default_factory=dict)
    captions: Mapping[str, str] = field(default_factory=dict)
    view: Any = None
    hint: bool = False
    problem_file: str = ""

    def html(self) -> str:
        """The page."""
        view, keys = self.view, frozenset() if self.view is None else self.view.keys
        words = [len(render(Document("", (), (block,))).split()) for block in self.report.blocks]
        begins = accumulate(words, initial=0)
        opened = {block.title for block, at in zip(self.report.blocks, begins, strict=False) if at < _OPEN_WORDS}

        def shown(views: Sequence[str], k: int) -> str:
            """The key of what row or column k shows in the view; empty where that is nothing."""
            return views[k] if k < len(views) and views[k] in keys else ""

        def encoded(data: bytes) -> str:
            return b64encode(data).decode("ascii")

        def kind(item: str | Facts | Table) -> str:
            return "text" if isinstance(item, str) else type(item).__name__.lower()

        return _template().render(
            page=self,
            report=self.report,
            blocks=[(f"part-{k}", block) for k, block in enumerate(self.report.blocks, 1)],
            opened=opened,
            images={name: encoded(data) for name, data in self.images.items()},
            encoded=encoded,
            keys=keys,
            shown=shown,
            library="" if view is None else plotly_js(),
            data="" if view is None else packed_json(view.document()),
            style=_text("page.css"),
            script=_text("page.js") + ("" if view is None else _text("view.js")),
            install=INSTALL,
            version=__version__,
            kind=kind,
        )


def _text(name: str) -> str:
    """A file of the folder ``templates``."""
    return packaged("posture_opt.report", "templates", name)


@cache
def _template() -> Template:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("posture_opt.report")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    environment.trim_blocks = environment.lstrip_blocks = True
    return environment.get_template("report.html")
