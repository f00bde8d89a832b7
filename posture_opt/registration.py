"""What results take from rooms above theirs: the package registers it, so that no room imports one above itself.

Light on purpose: ``import posture_opt`` loads this file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

Role = Literal["presenter", "evaluation", "explorer"]
"""``presenter``: what has the summary, the report, the figures and the files of a result; ``evaluation``: what the
predictions of a calibration are held against; ``explorer``: what starts the live page of a problem.
"""

_registered: dict[Role, Callable[[Any], Any]] = {}


def register(role: Role, made_for: Callable[[Any], Any]) -> None:
    """Has a role filled by what ``made_for`` gives for a result, in place of what was registered before."""
    _registered[role] = made_for


def registered(role: Role, result: object) -> Any:
    """What fills a role for a result.

    Raises:
        LookupError: nothing is registered.
    """
    if role not in _registered:
        raise LookupError(f"no {role} is registered for {type(result).__name__}")
    return _registered[role](result)
