"""One line about the machine and the versions: no time means anything without it."""

from __future__ import annotations

import os
import platform
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def machine_line(*packages: str) -> str:
    """Processor, cores, Python, and the versions of the packages that a run compares."""
    versions = ", ".join(f"{package} {_version(package)}" for package in packages)
    return f"{_processor()}, {os.cpu_count()} cores, Python {platform.python_version()}; {versions}"


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return _run_from_source(package)


def _run_from_source(package: str) -> str:
    try:
        return str(import_module(package).__version__)
    except ImportError:
        return "not installed"


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def load() -> str:
    """How busy the machine was in the last minute, in words."""
    try:
        busy = os.getloadavg()[0]
    except OSError:
        return "load unknown"
    idle = os.cpu_count() or 1
    return f"load {busy:.1f} on {idle} cores before it began" + ("" if busy < 0.5 else ", so times are too long")
