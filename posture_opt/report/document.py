"""JSON documents: the version first, finite numbers only."""

from __future__ import annotations

import json
import math
from typing import Any


def json_text(document: dict[str, Any]) -> str:
    """A document as JSON text with the version of the program in front; numbers that JSON lacks become null."""
    from posture_opt import __version__

    return json.dumps({"posture_opt": __version__, **finite(document)}, indent=2, ensure_ascii=False, allow_nan=False)


def finite(value: Any) -> Any:
    """The same nested data with null in place of NaN and infinity."""
    if isinstance(value, dict):
        return {str(key): finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
