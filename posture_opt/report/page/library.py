"""plotly.js, which draws the interactive view: it comes inside the Python package plotly, an optional extra.

A page holds the library and its data compressed, as base64: 2 MB in place of 5, and nothing in them can end a script
element. Browsers since 2023 unpack them (``DecompressionStream``); older ones show the static figure.
"""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from functools import cache
from importlib import import_module

from posture_opt.numerics import Json

INSTALL = "pip install 'posture_opt[viewer]'"
"""What brings the interactive view."""
_COMPRESSION_LEVEL = 5  # of 9, which takes twice the time and saves 1 % of plotly.js


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
    return b64encode(gzip.compress(text.encode(), _COMPRESSION_LEVEL, mtime=0)).decode("ascii")
