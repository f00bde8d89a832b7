"""What a fresh interpreter loads: the promises about start-up time, where this one has everything loaded already."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def loaded_by(code, *modules):
    """Those of ``modules`` that are loaded once ``code`` has run, at the top of the repository."""
    asked = f"{code}\nimport sys; print(*(m for m in {modules!r} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, cwd=ROOT, check=True)
    return done.stdout.split()
