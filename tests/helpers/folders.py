"""What a folder of results holds."""

from __future__ import annotations

import os
from pathlib import Path

from posture_opt.output import MANIFEST


def names(folder: Path) -> list[str]:
    """The files, without the list that the program keeps of them."""
    return sorted(name for name in os.listdir(folder) if name != MANIFEST)
