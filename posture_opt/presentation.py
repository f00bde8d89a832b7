"""Where results find what presents them: the package registers it, so that no room below the reports imports them.

Light on purpose: ``import posture_opt`` loads this file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

PresenterOf = Callable[[object], Any]
"""Gives the presenter of a result: the object that has its summary, its report, its figures and its files."""

_registered: list[PresenterOf] = []


def register_presenters(presenter_of: PresenterOf) -> None:
    """Has all results presented by what ``presenter_of`` gives, in place of what was registered before."""
    _registered[:] = [presenter_of]


def registered_presenter(result: object) -> Any:
    """The presenter of a result.

    Raises:
        LookupError: none is registered.
    """
    if not _registered:
        raise LookupError(f"no presenter is registered for {type(result).__name__}")
    return _registered[0](result)
