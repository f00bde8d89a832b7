"""Parts of work that other processes import."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any


def squared(shared: int, item: int) -> list[int]:
    return [shared * item * item]


def failing(shared: Any, item: int) -> int:
    if item == 2:
        raise ValueError("two is no number")
    return item


def deadly(shared: Path, item: int) -> int:
    """The first worker that takes on item 3 is killed over it."""
    if item == 3 and not shared.exists():
        shared.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * item


def always_deadly(shared: Any, item: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return item


def slow(shared: float, item: int) -> int:
    time.sleep(shared)
    return os.getpid()
